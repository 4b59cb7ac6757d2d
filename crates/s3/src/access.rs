//! Credentials, region and endpoint from the standard AWS environment variables.

use std::fmt;

use crate::S3Error;

/// Default region for signing; servers other than Amazon's ignore it.
const REGION: &str = "us-east-1";

/// Credentials, region and endpoint for signed requests.
#[derive(Clone)]
pub struct Access {
    pub(crate) key_id: String,
    pub(crate) secret: String,
    pub(crate) token: Option<String>,
    pub(crate) region: String,
    pub(crate) endpoint: Option<Endpoint>,
}

/// An endpoint other than Amazon's.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Endpoint {
    /// Scheme of the URL: `http` or `https`.
    pub(crate) scheme: &'static str,
    /// Host, with its port unless it is the scheme's default.
    pub(crate) host: String,
}

impl Access {
    /// Reads `AWS_ACCESS_KEY_ID`, `AWS_SECRET_ACCESS_KEY`, `AWS_SESSION_TOKEN`, `AWS_REGION` or `AWS_DEFAULT_REGION`,
    /// and `AWS_ENDPOINT_URL_S3` or `AWS_ENDPOINT_URL`.
    ///
    /// # Errors
    /// [`S3Error::Environment`] for a missing or invalid variable.
    pub fn from_environment() -> Result<Self, S3Error> {
        Self::from_variables(|name| std::env::var(name).ok())
    }

    /// As [`Access::from_environment`], with a custom lookup function.
    ///
    /// # Errors
    /// As [`Access::from_environment`].
    pub fn from_variables(variable: impl Fn(&str) -> Option<String>) -> Result<Self, S3Error> {
        let given = |name: &str| variable(name).filter(|value| !value.trim().is_empty());
        let secret = |name: &'static str| {
            let missing = S3Error::Environment { variable: name, expected: "a key", got: "nothing".into() };
            let value = given(name).ok_or(missing)?;
            // The value goes into HTTP headers.
            match value.chars().all(|c| c.is_ascii_graphic()) {
                true => Ok(value),
                false => Err(S3Error::Environment {
                    variable: name,
                    expected: "printable ASCII without spaces",
                    got: "other characters".into(),
                }),
            }
        };
        let token = given("AWS_SESSION_TOKEN").map(|_| secret("AWS_SESSION_TOKEN")).transpose()?;
        let region = given("AWS_REGION").or_else(|| given("AWS_DEFAULT_REGION")).unwrap_or_else(|| REGION.into());
        if !region.chars().all(|c| c.is_ascii_alphanumeric() || c == '-') {
            return Err(S3Error::Environment { variable: "AWS_REGION", expected: "a region", got: region });
        }
        let endpoint = given("AWS_ENDPOINT_URL_S3").or_else(|| given("AWS_ENDPOINT_URL"));
        Ok(Self {
            key_id: secret("AWS_ACCESS_KEY_ID")?,
            secret: secret("AWS_SECRET_ACCESS_KEY")?,
            token,
            region,
            endpoint: endpoint.map(|url| Endpoint::parse(&url)).transpose()?,
        })
    }
}

impl Endpoint {
    fn parse(url: &str) -> Result<Self, S3Error> {
        let wrong = || S3Error::Environment {
            variable: "AWS_ENDPOINT_URL",
            expected: "http://HOST:PORT or https://HOST",
            got: format!("{url:?}"),
        };
        let (scheme, rest, usual) = if let Some(rest) = url.strip_prefix("https://") {
            ("https", rest, ":443")
        } else {
            ("http", url.strip_prefix("http://").ok_or_else(wrong)?, ":80")
        };
        let host = rest.trim_end_matches('/');
        let fits = |c: char| c.is_ascii_alphanumeric() || "-._:[]".contains(c);
        if host.is_empty() || !host.chars().all(fits) {
            return Err(wrong());
        }
        Ok(Self { scheme, host: host.strip_suffix(usual).unwrap_or(host).to_ascii_lowercase() })
    }
}

impl fmt::Debug for Access {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // Credentials never appear in debug output.
        f.debug_struct("Access").field("region", &self.region).field("endpoint", &self.endpoint).finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn access(changes: &[(&str, &str)]) -> Result<Access, S3Error> {
        let all = [("AWS_ACCESS_KEY_ID", "me"), ("AWS_SECRET_ACCESS_KEY", "hush")];
        Access::from_variables(|name| {
            let found = changes.iter().chain(&all).find(|(known, _)| *known == name);
            found.map(|(_, value)| (*value).to_owned())
        })
    }

    #[test]
    fn variables_set_credentials_and_endpoint() {
        let plain = access(&[]).unwrap();
        assert_eq!((plain.region.as_str(), plain.endpoint), ("us-east-1", None));
        for (url, expected) in [
            ("http://127.0.0.1:9000/", Some(("http", "127.0.0.1:9000"))),
            ("https://S3.example.org:443", Some(("https", "s3.example.org"))),
            ("http://[::1]:80", Some(("http", "[::1]"))),
            ("ftp://example.org", None),
            ("http://", None),
            ("http://a/b", None),
            ("http://user@host", None),
        ] {
            let got = access(&[("AWS_ENDPOINT_URL", url)]);
            let got = got.ok().and_then(|access| access.endpoint);
            assert_eq!(got.as_ref().map(|endpoint| (endpoint.scheme, endpoint.host.as_str())), expected, "{url}");
        }
    }

    #[test]
    fn missing_keys_are_named_and_no_key_is_shown() {
        let error = access(&[("AWS_SECRET_ACCESS_KEY", " ")]).unwrap_err().to_string();
        assert_eq!(error, "AWS_SECRET_ACCESS_KEY: expected a key, got nothing");
        let error = access(&[("AWS_SECRET_ACCESS_KEY", "two\nlines")]).unwrap_err().to_string();
        assert!(!error.contains("lines"), "{error}");
        let shown = format!("{:?}", access(&[("AWS_SESSION_TOKEN", "secret-token")]).unwrap());
        assert!(!shown.contains("hush") && !shown.contains("secret-token"), "{shown}");
    }
}
