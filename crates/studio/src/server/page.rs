//! Files of the page (`web/dist`), embedded in the program.

use axum::body::Body;
use axum::http::header::{ACCEPT, CACHE_CONTROL, CONTENT_SECURITY_POLICY, CONTENT_TYPE, ETAG, HOST, IF_NONE_MATCH};
use axum::http::{HeaderMap, StatusCode, Uri};
use axum::response::{IntoResponse, Redirect, Response};
use genmanip_core::hexadecimal;
use rust_embed::{EmbeddedFile, RustEmbed};

use super::answer::not_found;

#[derive(RustEmbed)]
#[folder = "../../web/dist"]
#[allow_missing = true]
struct Files;

/// Content security policy: scripts, data and WebSockets come from this server alone. The page itself makes `blob:` and
/// `data:` URLs and inline styles. Not every browser counts WebSockets of the same host as `'self'`, so the host, which
/// was checked before, is named.
fn policy(headers: &HeaderMap) -> String {
    let host = headers.get(HOST).and_then(|host| host.to_str().ok());
    let sockets = host.map_or_else(String::new, |host| format!(" ws://{host} wss://{host}"));
    format!(
        "default-src 'self'; img-src 'self' blob: data:; connect-src 'self'{sockets} blob:; style-src 'self' \
         'unsafe-inline'; worker-src 'self' blob:; frame-ancestors 'none'; base-uri 'none'"
    )
}

/// A file of the page; `index.html` for `/`, to which a browser is sent from addresses where nothing is.
pub async fn file(headers: HeaderMap, uri: Uri) -> Response {
    let path = match uri.path().trim_start_matches('/') {
        "" => "index.html",
        path => path,
    };
    match Files::get(path) {
        Some(file) => answer(path, file, &headers),
        None if path == "index.html" => {
            not_found("this program was built without its page; build it again in a whole checkout")
        }
        // Somebody with a browser and a mistyped address.
        None if wants_page(&headers) && !path.starts_with("api/") => Redirect::to("/").into_response(),
        None => not_found("nothing is here; the page is at /"),
    }
}

fn wants_page(headers: &HeaderMap) -> bool {
    headers.get(ACCEPT).and_then(|accept| accept.to_str().ok()).is_some_and(|accept| accept.contains("text/html"))
}

fn answer(path: &str, file: EmbeddedFile, headers: &HeaderMap) -> Response {
    let tag = format!("\"{}\"", hexadecimal(&file.metadata.sha256_hash()[..16]));
    let is_known = headers.get(IF_NONE_MATCH).is_some_and(|known| known.as_bytes() == tag.as_bytes());
    // File names do not depend on the content, so browsers must revalidate.
    let head = [
        (CONTENT_TYPE, media_type(path).to_owned()),
        (ETAG, tag),
        (CACHE_CONTROL, "no-cache".to_owned()),
        (CONTENT_SECURITY_POLICY, policy(headers)),
    ];
    if is_known {
        return (StatusCode::NOT_MODIFIED, head).into_response();
    }
    (head, Body::from(file.data.into_owned())).into_response()
}

fn media_type(path: &str) -> &'static str {
    match path.rsplit_once('.').map_or("", |(_, ending)| ending) {
        "html" => "text/html; charset=utf-8",
        "js" => "text/javascript; charset=utf-8",
        "css" => "text/css; charset=utf-8",
        "txt" => "text/plain; charset=utf-8",
        "json" => "application/json",
        "svg" => "image/svg+xml",
        "png" => "image/png",
        "woff2" => "font/woff2",
        _ => "application/octet-stream",
    }
}
