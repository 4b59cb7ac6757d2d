//! HTML page with an overview of a dataset.

use std::fmt::Write;

use genmanip_viz::markup::{base64, escape};

/// Film strip of one episode.
#[derive(Clone, Debug)]
pub struct FilmStrip {
    /// Caption above the images.
    pub caption: String,
    /// JPEG files in chronological order.
    pub pictures: Vec<Vec<u8>>,
}

/// HTML page with a heading, a note, tables (first row: column headings) and film strips.
pub fn dataset_page(title: &str, note: &str, tables: &[(&str, &[Vec<String>])], strips: &[FilmStrip]) -> String {
    let mut body = String::new();
    for (heading, rows) in tables {
        let _ = write!(body, "<section>\n<h2>{}</h2>\n<table>\n", escape(heading));
        for (index, row) in rows.iter().enumerate() {
            let tag = if index == 0 { "th" } else { "td" };
            let cells: String = row.iter().map(|cell| format!("<{tag}>{}</{tag}>", escape(cell))).collect();
            let _ = writeln!(body, "<tr>{cells}</tr>");
        }
        body += "</table>\n</section>\n";
    }
    if !strips.is_empty() {
        let _ = write!(body, "<section>\n<h2>Pictures</h2>\n{}</section>\n", figures(strips));
    }
    page("Dataset", title, note, &body)
}

/// HTML page without external resources.
pub(crate) fn page(heading: &str, title: &str, note: &str, body: &str) -> String {
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<title>{title}</title>\n<style>\n{style}</style>\n\
         </head>\n<body>\n<header>\n<h1>{heading}</h1>\n<p>{title}</p>\n<pre>{note}</pre>\n</header>\n{body}</body>\n</html>\n",
        title = escape(title),
        note = escape(note),
        style = include_str!("report/style.css"),
    )
}

/// Film strips with their captions as HTML.
pub(crate) fn figures(strips: &[FilmStrip]) -> String {
    let mut html = String::new();
    for FilmStrip { caption, pictures } in strips {
        let images: String = pictures
            .iter()
            .map(|jpeg| format!("<img alt=\"\" src=\"data:image/jpeg;base64,{}\">", base64(jpeg)))
            .collect();
        let _ = writeln!(
            html,
            "<figure><div class=\"strip\">{images}</div><figcaption>{}</figcaption></figure>",
            escape(caption)
        );
    }
    html
}
