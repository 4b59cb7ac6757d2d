//! The pages describe every policy and every format of datasets.

use genmanip_pipeline::export::Format;
use genmanip_pipeline::policies::POLICIES;

#[test]
fn the_guide_describes_every_policy() {
    let guide = include_str!("../../../../docs/guides/evaluate.md");
    for name in POLICIES.map(|entry| entry.name) {
        let is_row = |line: &str| [format!("`{name}`"), format!("`{name}:")].iter().any(|said| line.contains(said));
        let mut rows = guide.lines().filter(|line| line.starts_with("| `"));
        assert!(rows.any(is_row), "docs/guides/evaluate.md has no row of the policy `{name}`");
    }
}

#[test]
fn the_pages_describe_every_export_format() {
    let [own, others] = [
        include_str!("../../../../docs/formats/lerobot-dataset.md"),
        include_str!("../../../../docs/formats/export-formats.md"),
    ];
    for name in Format::ALL.map(Format::name) {
        let (page, text) = if name == "lerobot" { ("lerobot-dataset", own) } else { ("export-formats", others) };
        let is_said = text.contains(&format!("--to {name}"));
        assert!(is_said, "docs/formats/{page}.md does not show `genmanip export --to {name}`");
    }
}
