//! AWS Signature Version 4 with payload hash, in the `authorization` header.

use genmanip_core::hexadecimal;
use sha2::{Digest, Sha256};

use crate::access::Access;

/// A request to be signed.
pub(crate) struct Unsigned<'a> {
    /// HTTP method, upper case.
    pub(crate) method: &'a str,
    /// Percent-encoded path with its leading slash.
    pub(crate) path: &'a str,
    /// Percent-encoded query, sorted by name.
    pub(crate) query: &'a str,
    /// Names in lower case and values, sorted, including `host`, `x-amz-content-sha256` and `x-amz-date`.
    pub(crate) headers: &'a [(&'static str, String)],
}

/// Value of the `authorization` header; `payload` is the hexadecimal SHA-256, `time` in the format of [`time`].
pub(crate) fn authorization(request: &Unsigned, payload: &str, time: &str, access: &Access) -> String {
    let day = time.get(..8).unwrap_or_default();
    let names: Vec<&str> = request.headers.iter().map(|(name, _)| *name).collect();
    let names = names.join(";");
    let headers: String = request.headers.iter().map(|(name, value)| format!("{name}:{}\n", value.trim())).collect();
    let Unsigned { method, path, query, .. } = request;
    let canonical = format!("{method}\n{path}\n{query}\n{headers}\n{names}\n{payload}");
    let scope = format!("{day}/{}/s3/aws4_request", access.region);
    let text = format!("AWS4-HMAC-SHA256\n{time}\n{scope}\n{}", hexadecimal(&Sha256::digest(canonical.as_bytes())));
    let key = [day, &access.region, "s3", "aws4_request"]
        .iter()
        .fold(format!("AWS4{}", access.secret).into_bytes(), |key, part| hmac(&key, part.as_bytes()).to_vec());
    let signature = hexadecimal(&hmac(&key, text.as_bytes()));
    format!("AWS4-HMAC-SHA256 Credential={}/{scope},SignedHeaders={names},Signature={signature}", access.key_id)
}

/// Unix time in seconds, formatted as `YYYYMMDDTHHMMSSZ`.
pub(crate) fn time(since_1970_s: u64) -> String {
    let (days, second) = (since_1970_s / 86_400, since_1970_s % 86_400);
    // H. Hinnant, chrono-compatible low-level date algorithms: eras of 400 years that begin in March.
    let shifted = days + 719_468;
    let (era, day) = (shifted / 146_097, shifted % 146_097);
    let year_of_era = (day - day / 1_460 + day / 36_524 - day / 146_096) / 365;
    let day_of_year = day - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let from_march = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * from_march + 2) / 5 + 1;
    let month = if from_march < 10 { from_march + 3 } else { from_march - 9 };
    let year = year_of_era + 400 * era + u64::from(month <= 2);
    format!("{year:04}{month:02}{day:02}T{:02}{:02}{:02}Z", second / 3600, second / 60 % 60, second % 60)
}

/// Percent-encoding as in S3 signatures; slashes are kept if `path` is set.
pub(crate) fn encoded(text: &str, path: bool) -> String {
    let mut encoded = String::with_capacity(text.len());
    for byte in text.bytes() {
        match byte {
            b'A'..=b'Z' | b'a'..=b'z' | b'0'..=b'9' | b'-' | b'_' | b'.' | b'~' => encoded.push(char::from(byte)),
            b'/' if path => encoded.push('/'),
            _ => encoded += &format!("%{byte:02X}"),
        }
    }
    encoded
}

/// HMAC-SHA256 (RFC 2104).
fn hmac(key: &[u8], text: &[u8]) -> [u8; 32] {
    const BLOCK: usize = 64;
    let mut padded = [0_u8; BLOCK];
    match key.len() > BLOCK {
        true => padded[..32].copy_from_slice(&Sha256::digest(key)),
        false => padded[..key.len()].copy_from_slice(key),
    }
    let part = |mask: u8, rest: &[u8]| {
        let mut hasher = Sha256::new();
        hasher.update(padded.map(|byte| byte ^ mask));
        hasher.update(rest);
        let mut hash = [0; 32];
        hash.copy_from_slice(&hasher.finalize());
        hash
    };
    part(0x5c, &part(0x36, text))
}

#[cfg(test)]
mod tests {
    use super::*;

    const EMPTY: &str = "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855";

    /// Examples from Amazon's documentation, *Signature Calculations for the Authorization Header*.
    #[test]
    fn signatures_match_amazons_examples() {
        let access = Access::from_variables(|name| match name {
            "AWS_ACCESS_KEY_ID" => Some("AKIAIOSFODNN7EXAMPLE".into()),
            "AWS_SECRET_ACCESS_KEY" => Some("wJalrXUtnFEMI/K7MDENG/bPxRfiCYEXAMPLEKEY".into()),
            _ => None,
        })
        .unwrap();
        let time = time(1_369_353_600);
        assert_eq!(time, "20130524T000000Z");
        let put = hexadecimal(&Sha256::digest(b"Welcome to Amazon S3."));
        type Headers = [(&'static str, &'static str)];
        let cases: [(&str, &str, &str, &str, &Headers, &str); 4] = [
            (
                "GET",
                "/test.txt",
                "",
                EMPTY,
                &[("range", "bytes=0-9")],
                "f0e8bdb87c964420e857bd35b5d6ed310bd44f0170aba48dd91039c6036bdb41",
            ),
            (
                "PUT",
                "/test%24file.text",
                "",
                &put,
                &[("date", "Fri, 24 May 2013 00:00:00 GMT"), ("x-amz-storage-class", "REDUCED_REDUNDANCY")],
                "98ad721746da40c64f1a55b78f14c238d841ea1380cd77a1b5971af0ece108bd",
            ),
            ("GET", "/", "lifecycle=", EMPTY, &[], "fea454ca298b7da1c68078a5d1bdbfbbe0d65c699e0f91ac7a200a0136783543"),
            (
                "GET",
                "/",
                "max-keys=2&prefix=J",
                EMPTY,
                &[],
                "34b48302e7b5fa45bde8084f4b7868a86f0a534bc59db6670ed5711ef69dc6f7",
            ),
        ];
        for (method, path, query, payload, more, expected) in cases {
            let mut headers = vec![
                ("host", "examplebucket.s3.amazonaws.com".to_owned()),
                ("x-amz-content-sha256", payload.to_owned()),
                ("x-amz-date", time.clone()),
            ];
            headers.extend(more.iter().map(|(name, value)| (*name, (*value).to_owned())));
            headers.sort();
            let request = Unsigned { method, path, query, headers: &headers };
            let signed = authorization(&request, payload, &time, &access);
            assert!(signed.ends_with(&format!("Signature={expected}")), "{method} {path}?{query}: {signed}");
        }
    }

    #[test]
    fn times_and_names_are_encoded_for_signing() {
        for (seconds, expected) in [
            (0, "19700101T000000Z"),
            (951_782_399, "20000228T235959Z"),
            (951_782_400, "20000229T000000Z"),
            (1_767_225_600, "20260101T000000Z"),
            (4_107_542_400, "21000301T000000Z"),
        ] {
            assert_eq!(time(seconds), expected);
        }
        assert_eq!(encoded("a b/ü+=.mp4", true), "a%20b/%C3%BC%2B%3D.mp4");
        assert_eq!(encoded("a/b", false), "a%2Fb");
    }
}
