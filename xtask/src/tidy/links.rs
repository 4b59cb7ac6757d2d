//! Relative links of Markdown pages lead to files and headings that exist.

use super::repository::{Entry, Tree};
use super::violation::Violation;
use crate::markdown;
use std::collections::BTreeMap;

/// Every link that leads nowhere.
pub fn check(files: &[Entry], tree: &Tree) -> Vec<Violation> {
    let pages: BTreeMap<&str, markdown::Page> = (files.iter())
        .filter(|file| file.path.ends_with(".md"))
        .map(|file| (file.path.as_str(), markdown::read(file.text.as_deref().unwrap_or_default())))
        .collect();
    let mut found = Vec::new();
    for (path, page) in &pages {
        for link in page.links().iter().filter(|link| is_relative(&link.target)) {
            if let Some((what, hint)) = fault(path, &link.target, &pages, tree) {
                found.push(Violation { place: format!("{path}:{}", link.line), what, hint });
            }
        }
    }
    found
}

/// True unless the target names a scheme such as `https:`.
fn is_relative(target: &str) -> bool {
    let scheme = target.split(':').next().unwrap_or_default();
    !target.contains(':') || !scheme.chars().all(|letter| letter.is_ascii_alphanumeric() || letter == '+')
}

fn fault(from: &str, target: &str, pages: &BTreeMap<&str, markdown::Page>, tree: &Tree) -> Option<(String, String)> {
    let (file, anchor) = target.split_once('#').map_or((target, None), |(file, anchor)| (file, Some(anchor)));
    let path = if file.is_empty() { Some(from.to_owned()) } else { resolved(from, file) };
    let Some(path) = path.filter(|path| tree.has(path)) else {
        return Some((
            format!("the link leads nowhere: {target}"),
            "name a file or folder of the repository, relative to this page".into(),
        ));
    };
    let anchor = anchor?;
    let anchors = pages.get(path.as_str())?.anchors();
    (!anchors.iter().any(|one| one == anchor)).then(|| {
        let near = anchors.iter().filter(|one| anchor.split('-').any(|word| word.len() > 3 && one.contains(word)));
        let near: Vec<&str> = near.map(String::as_str).collect();
        let near = if near.is_empty() { anchors.join(", #") } else { near.join(", #") };
        (format!("{path} has no heading #{anchor}"), format!("headings there: #{near}"))
    })
}

/// Path from the repository's root; `None` when it leads out of it.
fn resolved(from: &str, target: &str) -> Option<String> {
    let mut parts: Vec<&str> = from.split('/').collect();
    parts.pop();
    for part in target.split('/') {
        match part {
            "" | "." => {}
            ".." => drop(parts.pop()?),
            name => parts.push(name),
        }
    }
    Some(parts.join("/"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn links_lead_to_files_and_headings() {
        let page = |path: &str, text: &str| Entry { path: path.into(), text: Some(text.into()) };
        let files = [
            page(
                "docs/guides/a.md",
                "[ok](b.md) [ok](../c.md#two-words) [ok](https://x.y/z) [ok](#here) [ok](../images/) [ok](../../README.md)\n\
                 [bad](d.md) [bad](../c.md#two) [bad](#there)\n[bad](../../../x.md)\n# Here\n",
            ),
            page("docs/guides/b.md", ""),
            page("docs/c.md", "## Two words\n"),
            page("docs/images/x.png", ""),
            page("README.md", "[ok](docs/guides/a.md#here) [bad](guides/a.md)"),
        ];
        let found = check(&files, &Tree::new(&files));
        let said: Vec<String> = found.iter().map(|one| format!("{} {}", one.place, one.what)).collect();
        assert_eq!(
            said,
            [
                "README.md:1 the link leads nowhere: guides/a.md",
                "docs/guides/a.md:2 the link leads nowhere: d.md",
                "docs/guides/a.md:2 docs/c.md has no heading #two",
                "docs/guides/a.md:2 docs/guides/a.md has no heading #there",
                "docs/guides/a.md:3 the link leads nowhere: ../../../x.md",
            ]
        );
        assert_eq!(found[2].hint, "headings there: #two-words");
    }
}
