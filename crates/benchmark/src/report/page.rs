//! HTML page of one episode in the folder of a full report; its film strip is a separate file in that folder.

use super::task::section;
use super::{ImagePlan, TaskSection};
use genmanip_viz::markup::escape;

/// Contents of the page.
#[derive(Clone, Debug)]
pub struct EpisodePage<'a> {
    /// The episode with its task.
    pub section: &'a TaskSection,
    /// Path of the episode's film strip, relative to the page; `None` without images.
    pub strip: Option<String>,
    /// Description of the damage that prevents showing the episode; `None` if it is intact.
    pub damaged: Option<&'a str>,
    /// Id of the episode.
    pub id: &'a str,
    /// Path of the overview page, relative to the page.
    pub index: &'a str,
}

/// The page as an HTML file, also well-formed XML, that is complete without scripts.
pub fn episode_page(page: &EpisodePage) -> String {
    let plan = ImagePlan { film_step: None, thumbnails: false };
    let strip = page.strip.as_ref().map_or(String::new(), |strip| {
        let (strip, about) = (escape(strip), escape(&format!("Film strip of {}, from left to right", page.id)));
        format!("<div class=\"strip\"><a href=\"{strip}\"><img src=\"{strip}\" alt=\"{about}\" /></a></div>\n")
    });
    let damaged = page.damaged.map_or(String::new(), |why| format!("<p class=\"note\">Damaged: {}</p>\n", escape(why)));
    format!(
        concat!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\" />\n",
            "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\" />\n",
            "<meta name=\"color-scheme\" content=\"light dark\" />\n",
            "<title>{id}</title>\n<style>\n{style}</style>\n</head>\n<body>\n<main>\n",
            "<p class=\"kicker\"><a href=\"{index}#episodes\">All episodes</a> / {id}</p>\n{damaged}{strip}{section}",
            "</main>\n</body>\n</html>\n"
        ),
        id = escape(page.id),
        style = include_str!("style.css"),
        index = escape(page.index),
        damaged = damaged,
        strip = strip,
        section = section(0, page.section, None, plan),
    )
}
