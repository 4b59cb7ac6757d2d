//! The parts of Markdown that the checks need: headings, links, code spans, fenced blocks and prose.

/// A page, taken apart.
#[derive(Debug, Default)]
pub struct Page {
    /// Lines outside of fenced code and HTML comments, with their number from 1.
    pub prose: Vec<(usize, String)>,
    pub blocks: Vec<Block>,
    pub comments: Vec<Comment>,
}

/// A fenced code block.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Block {
    /// Line of the opening fence, from 1.
    pub line: usize,
    /// Info string.
    pub language: String,
    /// Content without the fence's indentation.
    pub lines: Vec<String>,
}

/// An HTML comment on lines of its own.
#[derive(Debug, Clone, PartialEq)]
pub struct Comment {
    /// Line of its beginning, from 1.
    pub line: usize,
    /// Line of its end.
    pub end: usize,
    /// Content between the marks, trimmed.
    pub text: String,
}

/// Target of a link or an image.
#[derive(Debug, PartialEq)]
pub struct Link {
    pub line: usize,
    pub target: String,
}

/// Reads a page.
pub fn read(text: &str) -> Page {
    let mut page = Page::default();
    let mut fence: Option<(String, usize)> = None;
    let mut comment: Option<Comment> = None;
    for (number, line) in text.lines().enumerate().map(|(index, line)| (index + 1, line)) {
        let trimmed = line.trim_start();
        if let Some((mark, indent)) = &fence {
            if trimmed.starts_with(mark.as_str()) && trimmed.trim_end().trim_start_matches(mark.as_str()).is_empty() {
                fence = None;
            } else if let Some(block) = page.blocks.last_mut() {
                let blank = line.chars().take(*indent).take_while(|letter| *letter == ' ').count();
                block.lines.push(line[blank..].to_owned());
            }
        } else if let Some(open) = &mut comment {
            let (inside, is_end) = line.split_once("-->").map_or((line, false), |(inside, _)| (inside, true));
            open.text = format!("{}\n{}", open.text, inside).trim().to_owned();
            if is_end {
                page.comments.extend(comment.take().map(|open| Comment { end: number, ..open }));
            }
        } else if let Some(mark) = fence_mark(trimmed) {
            let language = trimmed[mark.len()..].trim().to_owned();
            fence = Some((mark, line.len() - trimmed.len()));
            page.blocks.push(Block { line: number, language, lines: Vec::new() });
        } else if let Some(inside) = trimmed.strip_prefix("<!--") {
            match inside.split_once("-->") {
                Some((inside, _)) => {
                    page.comments.push(Comment { line: number, end: number, text: inside.trim().to_owned() });
                }
                None => comment = Some(Comment { line: number, end: number, text: inside.trim().to_owned() }),
            }
        } else {
            page.prose.push((number, line.to_owned()));
        }
    }
    page
}

impl Page {
    /// Comments on the lines right above a block.
    pub fn comments_above(&self, block: &Block) -> Vec<&Comment> {
        let mut above = Vec::new();
        let mut line = block.line;
        while let Some(comment) = self.comments.iter().find(|comment| comment.end + 1 == line) {
            line = comment.line;
            above.insert(0, comment);
        }
        above
    }

    /// Anchors that GitHub gives to the headings.
    pub fn anchors(&self) -> Vec<String> {
        let mut anchors: Vec<String> = Vec::new();
        for (_, line) in &self.prose {
            let title = line.trim_start_matches('#');
            let level = line.len() - title.len();
            if (1..=6).contains(&level) && title.starts_with(' ') {
                let slug = slug(title);
                let again = |count: &usize| *count == 0 || !anchors.contains(&format!("{slug}-{count}"));
                let count = if anchors.contains(&slug) { (1..).find(again).unwrap_or(1) } else { 0 };
                anchors.push(if count == 0 { slug } else { format!("{slug}-{count}") });
            }
            for name in ["id=\"", "name=\""] {
                anchors.extend(line.match_indices(name).filter_map(|(at, _)| {
                    let value = &line[at + name.len()..];
                    line.contains("<a ").then(|| value.split('"').next().unwrap_or_default().to_owned())
                }));
            }
        }
        anchors
    }

    /// Links and images outside of code.
    pub fn links(&self) -> Vec<Link> {
        let mut links = Vec::new();
        for (line, text) in &self.prose {
            let text = without_code(text);
            let mut add = |target: &str| links.push(Link { line: *line, target: target.to_owned() });
            for (at, _) in text.match_indices("](") {
                let rest = &text[at + 2..];
                let target = rest.strip_prefix('<').map_or_else(|| until_closed(rest), |rest| rest.split('>').next());
                let target = target.unwrap_or_default();
                add(target.split(" \"").next().unwrap_or_default().trim());
            }
            for attribute in ["src=\"", "href=\""] {
                for (at, _) in text.match_indices(attribute) {
                    add(text[at + attribute.len()..].split('"').next().unwrap_or_default());
                }
            }
            if let Some((label, target)) = text.split_once("]: ").filter(|_| text.starts_with('['))
                && !label.contains(']')
            {
                add(target.split_whitespace().next().unwrap_or_default());
            }
        }
        links
    }

    /// Code spans with their line.
    pub fn spans(&self) -> Vec<(usize, String)> {
        let mut spans = Vec::new();
        for (line, text) in &self.prose {
            let parts: Vec<&str> = text.split('`').collect();
            // Between the first and the second mark, the third and the fourth, and so on; an odd one opens nothing.
            let inside = parts.iter().enumerate().filter(|(i, _)| i % 2 == 1 && i + 1 < parts.len());
            spans.extend(inside.map(|(_, span)| (*line, (*span).to_owned())));
        }
        spans
    }
}

/// Prose of a page: [`Page::prose`].
pub fn prose(text: &str) -> Vec<(usize, String)> {
    read(text).prose
}

/// "```", or more of its letters.
fn fence_mark(trimmed: &str) -> Option<String> {
    let letter = trimmed.chars().next().filter(|letter| matches!(letter, '`' | '~'))?;
    let mark: String = trimmed.chars().take_while(|one| *one == letter).collect();
    (mark.len() >= 3 && !trimmed[mark.len()..].contains('`')).then_some(mark)
}

/// Text without its code spans.
fn without_code(text: &str) -> String {
    let parts: Vec<&str> = text.split('`').collect();
    let outside = |(i, part): (usize, &&str)| (i % 2 == 0 || i + 1 == parts.len()).then(|| (*part).to_owned());
    parts.iter().enumerate().filter_map(outside).collect::<Vec<_>>().join("`")
}

/// Up to the parenthesis that closes the link.
fn until_closed(text: &str) -> Option<&str> {
    let mut open = 1;
    let end = text.char_indices().find(|(_, letter)| {
        open += i32::from(*letter == '(') - i32::from(*letter == ')');
        open == 0
    });
    end.map(|(at, _)| &text[..at])
}

/// Anchor of a heading.
fn slug(title: &str) -> String {
    let mut text = title.trim().to_owned();
    // Of a link its text counts.
    while let Some((open, close)) = text.find("](").and_then(|at| Some((at, at + 2 + text[at + 2..].find(')')?))) {
        text.replace_range(open..=close, "");
    }
    let kept = text.to_lowercase();
    let kept = kept.chars().filter(|letter| letter.is_alphanumeric() || matches!(letter, ' ' | '-' | '_'));
    kept.map(|letter| if letter == ' ' { '-' } else { letter }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const PAGE: &str = "\
# One *big* `title`: [a link](x.md)

See [this](b.md#two) and ![image](i.png \"title\"), not `[that](c.md)`.
<!-- docs: fails -->
<!-- two
lines -->
```sh
genmanip  # [no](link)
```

## Two
## Two

1. item

   ```python
   if x:
       y
   ```

<img src=\"j.png\"> [x]: [label](<d e.md>)
[ref]: f.md
";

    #[test]
    fn blocks_and_the_comments_above_them() {
        let page = read(PAGE);
        assert_eq!(page.blocks.len(), 2);
        let (first, second) = (&page.blocks[0], &page.blocks[1]);
        assert_eq!(
            (first.line, first.language.as_str(), first.lines.join("\n").as_str()),
            (7, "sh", "genmanip  # [no](link)")
        );
        assert_eq!((second.line, second.lines.join("\n").as_str()), (16, "if x:\n    y"));
        let above: Vec<&str> = page.comments_above(first).iter().map(|comment| comment.text.as_str()).collect();
        assert_eq!(above, ["docs: fails", "two\nlines"]);
        assert!(page.comments_above(second).is_empty());
    }

    #[test]
    fn anchors_are_those_of_github() {
        assert_eq!(read(PAGE).anchors(), ["one-big-title-a-link", "two", "two-1"]);
        assert_eq!(slug("`collect --cameras`: what's new?"), "collect---cameras-whats-new");
    }

    #[test]
    fn links_and_spans() {
        let page = read(PAGE);
        let links = page.links();
        let links: Vec<(usize, &str)> = links.iter().map(|link| (link.line, link.target.as_str())).collect();
        let links_of = |text: &str| read(text).links().into_iter().map(|link| link.target).collect::<Vec<_>>();
        let expected = [(1, "x.md"), (3, "b.md#two"), (3, "i.png"), (21, "d e.md"), (21, "j.png"), (22, "f.md")];
        assert_eq!(links, expected);
        assert_eq!(links_of("[a](b_(c).md) text"), ["b_(c).md"]);
        assert_eq!(page.spans(), [(1, "title".to_owned()), (3, "[that](c.md)".to_owned())]);
    }
}
