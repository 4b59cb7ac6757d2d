//! HTML page with an overview of a dataset.

use std::fmt::Write;

use genmanip_viz::markup::{base64, escape};

/// Film strip of one episode.
#[derive(Clone, Debug)]
pub struct FilmStrip {
    /// Caption.
    pub caption: String,
    /// JPEG files in chronological order.
    pub pictures: Vec<Vec<u8>>,
}

/// HTML page with a heading, a note, tables (first row: column headings) and film strips.
pub fn dataset_page(title: &str, note: &str, tables: &[(&str, &[Vec<String>])], strips: &[FilmStrip]) -> String {
    let mut html = format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<title>{title}</title>\n<style>\n{style}</style>\n\
         </head>\n<body>\n<header>\n<h1>Dataset</h1>\n<p>{title}</p>\n<pre>{note}</pre>\n</header>\n",
        title = escape(title),
        note = escape(note),
        style = include_str!("report/style.css"),
    );
    for (heading, rows) in tables {
        let _ = write!(html, "<section>\n<h2>{}</h2>\n<table>\n", escape(heading));
        for (index, row) in rows.iter().enumerate() {
            let tag = if index == 0 { "th" } else { "td" };
            let cells: String = row.iter().map(|cell| format!("<{tag}>{}</{tag}>", escape(cell))).collect();
            let _ = writeln!(html, "<tr>{cells}</tr>");
        }
        html += "</table>\n</section>\n";
    }
    if !strips.is_empty() {
        html += "<section>\n<h2>Pictures</h2>\n";
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
        html += "</section>\n";
    }
    html + "</body>\n</html>\n"
}
