//! HTML page on the training of a policy.

use genmanip_viz::markup::escape;

use crate::dataset_page::{FilmStrip, figures, page};
use crate::line_chart::LineChart;

/// A point in a demonstration with the policy's prediction.
#[derive(Clone, Debug)]
pub struct PredictedMoment {
    /// Name of the point, as a heading.
    pub name: String,
    /// Images that the policy observes at this point, JPEG.
    pub images: FilmStrip,
    /// Charts of predicted and recorded actions.
    pub charts: Vec<LineChart>,
}

/// HTML page with the training curves, and predictions at points of the demonstrations.
pub fn training_page(title: &str, note: &str, curves: &[LineChart], moments: &[PredictedMoment]) -> String {
    let charts = |charts: &[LineChart]| -> String {
        let figures: String = charts.iter().map(LineChart::figure).collect();
        format!("<div class=\"two\">\n{figures}</div>\n")
    };
    let mut body = format!("<section>\n<h2>Course</h2>\n{}</section>\n", charts(curves));
    if !moments.is_empty() {
        body += "<section>\n<h2>Predictions</h2>\n";
        for PredictedMoment { name, images, charts: actions } in moments {
            body += &format!("<h3>{}</h3>\n", escape(name));
            if !images.pictures.is_empty() {
                body += &figures(std::slice::from_ref(images));
            }
            body += &charts(actions);
        }
        body += "</section>\n";
    }
    page("Training", title, note, &body)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_needs_no_network_and_no_script() {
        let curves = [LineChart::of("L1 error", "steps", vec![[0.0, 1.0], [9.0, 0.1]])];
        let images = FilmStrip { caption: "static".into(), pictures: vec![vec![1, 2, 3]] };
        let moments = [PredictedMoment { name: "row 7 of <a>".into(), images, charts: curves.to_vec() }];
        let page = training_page("out/<policy>", "1 demonstration", &curves, &moments);
        assert_eq!((page.matches("<svg").count(), page.matches("data:image/jpeg").count()), (2, 1));
        assert!(page.contains("out/&lt;policy&gt;") && page.contains("row 7 of &lt;a&gt;"));
        assert!(page.contains("prefers-color-scheme: dark") && !page.contains("http") && !page.contains("<script"));
    }
}
