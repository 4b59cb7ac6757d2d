//! The commands of a page in the order in which they run.

use super::marks::{self, Mark};
use crate::markdown::{self, Block};
use crate::problem::{Problem, Result};

/// Languages whose blocks run.
const SHELLS: [&str; 2] = ["sh", "bash"];
const PYTHON: &str = "python";
/// Languages whose blocks are shown alone.
const SHOWN: [&str; 10] = ["text", "json", "jsonl", "toml", "yaml", "xml", "html", "rust", "mermaid", "diff"];

/// Everything that is to be run of a page.
#[derive(Debug, Default, PartialEq)]
pub struct Plan {
    /// Reason why nothing is.
    pub off: Option<String>,
    /// Pages that run first.
    pub needs: Vec<String>,
    pub steps: Vec<Step>,
}

/// One block, or one hidden command.
#[derive(Debug, PartialEq)]
pub struct Step {
    /// Line of the opening fence or of the mark.
    pub line: usize,
    pub language: Language,
    pub script: String,
    /// Exit code of success.
    pub expected: i32,
    pub when: When,
    /// Kept running; see [`Mark::Background`].
    pub background: Option<Option<u16>>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Language {
    Shell,
    Python,
}

/// Runs in which a step takes part.
#[derive(Debug, Clone, PartialEq)]
pub enum When {
    Always,
    Interop,
    /// With the reason.
    Never(String),
}

/// Reads a page; `path` is for messages.
pub fn read(path: &str, text: &str) -> Result<Plan> {
    let page = markdown::read(text);
    let mut plan = Plan::default();
    let mut used = Vec::new();
    for block in &page.blocks {
        let mut all = Vec::new();
        for comment in page.comments_above(block) {
            used.push(comment.line);
            all.extend(marks::read(path, comment)?.unwrap_or_default());
        }
        let (of_page, of_block): (Vec<Mark>, Vec<Mark>) = all.into_iter().partition(Mark::is_of_page);
        of_page.into_iter().for_each(|mark| plan.add(mark));
        plan.steps.extend(steps(path, block, of_block)?);
    }
    for comment in page.comments.iter().filter(|comment| !used.contains(&comment.line)) {
        for mark in marks::read(path, comment)?.into_iter().flatten() {
            if !mark.is_of_page() {
                return Err(Problem {
                    what: format!("{path}:{}: the mark is above no code block", comment.line),
                    expected: "a fenced block on the next line".into(),
                    hint: "only `needs` and `off` are about the whole page".into(),
                });
            }
            plan.add(mark);
        }
    }
    Ok(plan)
}

impl Plan {
    fn add(&mut self, mark: Mark) {
        match mark {
            Mark::Needs(page) => self.needs.push(page),
            Mark::Off(reason) => self.off = Some(reason),
            _ => {}
        }
    }
}

fn steps(path: &str, block: &Block, marks: Vec<Mark>) -> Result<Vec<Step>> {
    let wrong = |what: String, hint: &str| Problem {
        what: format!("{path}:{}: {what}", block.line),
        expected: format!("{}, {PYTHON}, or {}", SHELLS.join(", "), SHOWN.join(", ")),
        hint: hint.into(),
    };
    let language = match block.language.as_str() {
        name if SHELLS.contains(&name) => Language::Shell,
        PYTHON => Language::Python,
        name if SHOWN.contains(&name) && marks.is_empty() => return Ok(Vec::new()),
        name if SHOWN.contains(&name) => {
            return Err(wrong(format!("a mark above a `{name}` block, which is not run"), "remove the mark"));
        }
        name => return Err(wrong(format!("the language of the block is {name:?}"), "`text` is for what is not run")),
    };
    let line = block.line;
    let mut step = Step {
        line,
        language,
        script: block.lines.join("\n") + "\n",
        expected: 0,
        when: When::Always,
        background: None,
    };
    let mut steps = Vec::new();
    for mark in marks {
        match mark {
            Mark::Skip(reason) => step.when = When::Never(reason),
            Mark::Interop => step.when = When::Interop,
            Mark::Background(port) => step.background = Some(port),
            Mark::Fails(code) => step.expected = code,
            Mark::Replace(from, to) => {
                if !step.script.contains(&from) {
                    return Err(wrong(format!("the block does not hold `{from}`"), "correct the mark `replace`"));
                }
                step.script = step.script.replace(&from, &to);
            }
            Mark::Run(command) => steps.push(command),
            Mark::Needs(_) | Mark::Off(_) => {}
        }
    }
    let when = step.when.clone();
    let hidden = |command: String| Step {
        line,
        language: Language::Shell,
        script: command + "\n",
        expected: 0,
        when: when.clone(),
        background: None,
    };
    Ok(steps.into_iter().map(hidden).chain([step]).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_become_steps() {
        let page = "\
<!-- docs: needs docs/guides/b.md -->
# Page

<!-- docs: run mkdir out -->
<!-- docs: replace --count 9 => --count 1 -->
```sh
genmanip layout --count 9
```

```text
not run
```

<!-- docs: skip needs a GPU -->
```python
import torch
```

<!-- a remark -->
<!-- docs: fails
docs: background 8000 -->
```bash
false
```
";
        let plan = read("a.md", page).unwrap();
        assert_eq!((plan.off, plan.needs), (None, vec!["docs/guides/b.md".to_owned()]));
        let shown: Vec<(usize, &str, &When)> =
            plan.steps.iter().map(|step| (step.line, step.script.trim(), &step.when)).collect();
        let never = When::Never("needs a GPU".into());
        let expected = [
            (6, "mkdir out", &When::Always),
            (6, "genmanip layout --count 1", &When::Always),
            (15, "import torch", &never),
            (22, "false", &When::Always),
        ];
        assert_eq!(shown, expected);
        assert_eq!((plan.steps[3].expected, plan.steps[3].background), (1, Some(Some(8000))));
        assert_eq!(plan.steps[2].language, Language::Python);
    }

    #[test]
    fn a_page_may_be_off() {
        let plan = read("a.md", "<!-- docs: off being rewritten -->\n# Page\n\n```sh\nfalse\n```\n").unwrap();
        assert_eq!(plan.off.as_deref(), Some("being rewritten"));
    }

    #[test]
    fn mistakes_are_named_with_their_line() {
        for (page, said) in [
            ("```\nx\n```\n", "a.md:1: the language of the block is \"\""),
            ("\n```console\n$ x\n```\n", "a.md:2: the language of the block is \"console\""),
            ("<!-- docs: fails -->\n```text\nx\n```\n", "a.md:2: a mark above a `text` block"),
            ("<!-- docs: fails -->\n\n```sh\nx\n```\n", "a.md:1: the mark is above no code block"),
            ("<!-- docs: replace a => b -->\n```sh\nx\n```\n", "a.md:2: the block does not hold `a`"),
            ("<!-- docs: what -->\n```sh\nx\n```\n", "a.md:1: not a mark"),
        ] {
            let error = read("a.md", page).unwrap_err();
            assert!(error.what.contains(said), "{page}: {error}");
        }
    }
}
