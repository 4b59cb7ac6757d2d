//! S3 addresses.

use crate::S3Error;

/// A bucket and the key prefix of a folder.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Address {
    /// Name of the bucket.
    pub bucket: String,
    /// Key prefix without leading and trailing slashes; empty for the whole bucket.
    pub prefix: String,
}

impl Address {
    /// Reads `s3://BUCKET/PREFIX`.
    ///
    /// # Errors
    /// [`S3Error::Address`] with the reason why the address is invalid.
    pub fn parse(text: &str) -> Result<Self, S3Error> {
        let wrong = |why: &str| S3Error::Address { got: text.into(), why: why.into() };
        let rest = text.strip_prefix("s3://").ok_or_else(|| wrong("it does not begin with s3://"))?;
        let (bucket, prefix) = rest.split_once('/').unwrap_or((rest, ""));
        // Amazon's naming rule for buckets, simplified.
        let fits = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-' || c == '.';
        if !(3..=63).contains(&bucket.len()) || !bucket.chars().all(fits) {
            return Err(wrong("a bucket has 3 to 63 lower-case letters, digits, dots and hyphens"));
        }
        let prefix = prefix.trim_matches('/');
        if prefix.split('/').any(|part| matches!(part, "." | "..")) || prefix.contains("//") {
            return Err(wrong("a path component is empty, `.` or `..`"));
        }
        Ok(Self { bucket: bucket.into(), prefix: prefix.into() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_have_a_bucket_and_an_optional_prefix() {
        for (text, expected) in [
            ("s3://my-bucket", Some(("my-bucket", ""))),
            ("s3://my-bucket/", Some(("my-bucket", ""))),
            ("s3://my.bucket/a/b c/", Some(("my.bucket", "a/b c"))),
            ("my-bucket/a", None),
            ("s3://My-Bucket/a", None),
            ("s3://ab", None),
            ("s3:///a", None),
            ("s3://my-bucket/a/../b", None),
            ("s3://my-bucket/a//b", None),
        ] {
            let got = Address::parse(text).ok();
            let got = got.as_ref().map(|address| (address.bucket.as_str(), address.prefix.as_str()));
            assert_eq!(got, expected, "{text}");
        }
    }
}
