//! Protection against web pages of other sites that send requests through a user's browser (CSRF and DNS rebinding).
//!
//! The services have no authentication, and any page may send simple requests to loopback addresses. A browser states
//! the origin of the page (`Origin`) and the host name that it resolved (`Host`); other clients send no `Origin`.

use axum::http::HeaderMap;
use axum::http::header::{HOST, ORIGIN};

/// Reason to refuse a request, from its headers; `None` for clients that are not browsers and for pages of this server.
///
/// - `Origin` must be that of this server, so that no page of another site can call it.
/// - A server on a loopback address answers only to loopback host names. Otherwise, pages of a foreign name that
/// resolves to
///   the address (DNS rebinding) would count as pages of this server.
pub fn refusal(headers: &HeaderMap, listens_on_loopback: bool) -> Option<String> {
    let text = |name| headers.get(name).map(|value| value.to_str().unwrap_or("not text"));
    let host = text(HOST).unwrap_or_default();
    if listens_on_loopback && !host.is_empty() && !is_loopback(host_name(host)) {
        return Some(format!("the request names the host {host:?}; expected localhost or a loopback address"));
    }
    let origin = text(ORIGIN)?;
    let own = origin.strip_prefix("http://").is_some_and(|of_page| of_page.eq_ignore_ascii_case(host));
    (!own).then(|| format!("a page of {origin:?} may not use this service; call it from a program instead"))
}

/// Host without port and without the brackets of an IPv6 address.
fn host_name(host: &str) -> &str {
    match host.strip_prefix('[').and_then(|rest| rest.split_once(']')) {
        Some((address, _)) => address,
        None => host.rsplit_once(':').map_or(host, |(name, _)| name),
    }
}

fn is_loopback(name: &str) -> bool {
    name.eq_ignore_ascii_case("localhost") || name.parse().is_ok_and(|address: std::net::IpAddr| address.is_loopback())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pages_of_other_sites_are_refused_and_programs_are_not() {
        // host, origin, listens on loopback, refused
        let cases: &[(Option<&str>, Option<&str>, bool, bool)] = &[
            (Some("127.0.0.1:8091"), None, true, false),
            (Some("localhost:8091"), None, true, false),
            (Some("LOCALHOST"), None, true, false),
            (Some("[::1]:8091"), None, true, false),
            (None, None, true, false),
            (Some("127.0.0.1:8091"), Some("http://127.0.0.1:8091"), true, false),
            (Some("localhost:8091"), Some("http://localhost:8091"), true, false),
            (Some("localhost:8091"), Some("https://example.org"), true, true),
            (Some("localhost:8091"), Some("http://localhost:3000"), true, true),
            (Some("localhost:8091"), Some("null"), true, true),
            (Some("rebound.example.org:8091"), None, true, true),
            (Some("rebound.example.org:8091"), Some("http://rebound.example.org:8091"), true, true),
            (Some("127.0.0.1.example.org"), None, true, true),
            (Some("gpu-server:8091"), None, false, false),
            (Some("gpu-server:8091"), Some("http://gpu-server:8091"), false, false),
            (Some("gpu-server:8091"), Some("https://example.org"), false, true),
        ];
        for &(host, origin, on_loopback, refused) in cases {
            let mut headers = HeaderMap::new();
            for (name, value) in [(HOST, host), (ORIGIN, origin)] {
                value.map(|value| headers.insert(name, value.parse().unwrap()));
            }
            let reason = refusal(&headers, on_loopback);
            assert_eq!(reason.is_some(), refused, "{host:?} {origin:?} {on_loopback}: {reason:?}");
        }
    }
}
