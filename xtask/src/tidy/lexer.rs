//! Splits Rust source into names, marks, string literals and comments, with their lines.

/// One token or comment.
#[derive(Debug, PartialEq)]
pub struct Piece {
    /// Line on which it begins, from 1.
    pub line: usize,
    pub kind: Kind,
    /// Source text; of string literals and comments without the delimiters.
    pub text: String,
}

/// Kind of a [`Piece`]; character literals, numbers and lifetimes are dropped.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Kind {
    Name,
    /// `::` or a single character.
    Mark,
    Literal,
    /// `//` and `/* */`, doc comments excluded.
    Comment,
    /// `///` and `/** */`.
    Doc,
    /// `//!` and `/*! */`.
    InnerDoc,
}

/// Names and marks alone.
pub fn words_and_marks(text: &str) -> Vec<String> {
    let is_code = |piece: &Piece| matches!(piece.kind, Kind::Name | Kind::Mark);
    pieces(text).into_iter().filter(is_code).map(|piece| piece.text).collect()
}

/// All pieces in their order.
pub fn pieces(text: &str) -> Vec<Piece> {
    let mut lexer = Lexer { letters: text.chars().collect(), at: 0, line: 1, found: Vec::new() };
    while lexer.at < lexer.letters.len() {
        lexer.step();
    }
    lexer.found
}

struct Lexer {
    letters: Vec<char>,
    at: usize,
    /// Line of `at`.
    line: usize,
    found: Vec<Piece>,
}

impl Lexer {
    fn letter(&self, ahead: usize) -> char {
        self.letters.get(self.at + ahead).copied().unwrap_or('\0')
    }

    /// Reads one piece, or skips one character.
    fn step(&mut self) {
        let letter = self.letter(0);
        match letter {
            '/' if self.letter(1) == '/' => self.line_comment(),
            '/' if self.letter(1) == '*' => self.block_comment(),
            '"' => self.literal(),
            '\'' if self.letter(1) == '\\' => {
                let end = (self.at + 3..self.letters.len()).find(|&k| self.letters[k] == '\'');
                self.advance(end.map_or(self.letters.len(), |end| end + 1));
            }
            '\'' if self.letter(2) == '\'' => self.advance(self.at + 3),
            '\'' => self.advance(self.end_of_name(self.at + 1)),
            _ if letter.is_ascii_digit() => self.advance(self.end_of_name(self.at)),
            _ if is_part_of_name(letter) => self.name(),
            ':' if self.letter(1) == ':' => self.push(Kind::Mark, self.at..self.at + 2, self.at + 2),
            _ if letter.is_whitespace() => self.advance(self.at + 1),
            _ => self.push(Kind::Mark, self.at..self.at + 1, self.at + 1),
        }
    }

    /// Moves to `end` and counts the lines passed.
    fn advance(&mut self, end: usize) {
        let end = end.min(self.letters.len());
        self.line += self.letters[self.at..end].iter().filter(|letter| **letter == '\n').count();
        self.at = end;
    }

    /// Adds the piece that consists of `range`, and moves to `end`.
    fn push(&mut self, kind: Kind, range: std::ops::Range<usize>, end: usize) {
        let range = range.start.min(self.letters.len())..range.end.min(self.letters.len());
        let text = self.letters[range].iter().collect();
        self.found.push(Piece { line: self.line, kind, text });
        self.advance(end);
    }

    fn end_of_name(&self, from: usize) -> usize {
        (from..self.letters.len()).find(|&i| !is_part_of_name(self.letters[i])).unwrap_or(self.letters.len())
    }

    fn line_comment(&mut self) {
        let end = (self.at..self.letters.len()).find(|&k| self.letters[k] == '\n').unwrap_or(self.letters.len());
        let (kind, marks) = self.comment_kind('/');
        self.push(kind, self.at + marks..end.max(self.at + marks), end);
    }

    fn block_comment(&mut self) {
        let (kind, marks) = self.comment_kind('*');
        let (mut open, mut end) = (0, self.at);
        while end < self.letters.len() {
            match (self.letters[end], self.letters.get(end + 1)) {
                ('/', Some('*')) => (open, end) = (open + 1, end + 2),
                ('*', Some('/')) => (open, end) = (open - 1, end + 2),
                _ => end += 1,
            }
            if open == 0 {
                break;
            }
        }
        let begin = self.at + marks;
        self.push(kind, begin..end.saturating_sub(2).max(begin), end);
    }

    /// Kind of the comment that begins here, and the length of its opening.
    fn comment_kind(&self, repeated: char) -> (Kind, usize) {
        match (self.letter(2), self.letter(3)) {
            ('!', _) => (Kind::InnerDoc, 3),
            (mark, next) if mark == repeated && next != repeated && next != '/' => (Kind::Doc, 3),
            _ => (Kind::Comment, 2),
        }
    }

    fn literal(&mut self) {
        let mut end = self.at + 1;
        while end < self.letters.len() && self.letters[end] != '"' {
            end += if self.letters[end] == '\\' { 2 } else { 1 };
        }
        self.push(Kind::Literal, self.at + 1..end, end + 1);
    }

    /// A name, a raw name, or a literal with a prefix.
    fn name(&mut self) {
        let end = self.end_of_name(self.at);
        let word: String = self.letters[self.at..end].iter().collect();
        let next = self.letters.get(end).copied().unwrap_or('\0');
        if matches!(word.as_str(), "r" | "br" | "cr")
            && let Some((text, behind)) = self.raw_literal(end)
        {
            self.push(Kind::Literal, text, behind);
        } else if word == "r" && next == '#' {
            self.advance(end + 1); // a raw name: the word behind is the name
        } else if matches!(word.as_str(), "b" | "c") && matches!(next, '"' | '\'') {
            self.advance(end);
        } else {
            self.push(Kind::Name, self.at..end, end);
        }
    }

    /// Content and end of `#"…"#`, with any number of `#`; `None` where no literal begins.
    fn raw_literal(&self, from: usize) -> Option<(std::ops::Range<usize>, usize)> {
        let marks = self.letters[from..].iter().take_while(|letter| **letter == '#').count();
        let begin = from + marks;
        if self.letters.get(begin) != Some(&'"') {
            return None;
        }
        let is_end =
            |&i: &usize| self.letters[i] == '"' && (1..=marks).all(|ahead| self.letters.get(i + ahead) == Some(&'#'));
        let end = (begin + 1..self.letters.len()).find(is_end).unwrap_or(self.letters.len());
        Some((begin + 1..end, end + marks + 1))
    }
}

fn is_part_of_name(letter: char) -> bool {
    letter.is_alphanumeric() || letter == '_'
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_have_kind_line_and_text() {
        let text = "//! Crate.\n/// Doc.\nfn f() { // why\n    g(r#\"raw \"x\"\n\"#, \"text \\\" on\"); /* block\n */ }\n//// rule\n";
        let found: Vec<(usize, Kind, String)> = (pieces(text).into_iter())
            .filter(|piece| piece.kind != Kind::Mark)
            .map(|piece| (piece.line, piece.kind, piece.text))
            .collect();
        let expected = [
            (1, Kind::InnerDoc, " Crate."),
            (2, Kind::Doc, " Doc."),
            (3, Kind::Name, "fn"),
            (3, Kind::Name, "f"),
            (3, Kind::Comment, " why"),
            (4, Kind::Name, "g"),
            (4, Kind::Literal, "raw \"x\"\n"),
            (5, Kind::Literal, "text \\\" on"),
            (5, Kind::Comment, " block\n "),
            (7, Kind::Comment, "// rule"),
        ];
        assert_eq!(found, expected.map(|(line, kind, text)| (line, kind, text.to_owned())));
    }

    #[test]
    fn characters_numbers_and_lifetimes_are_dropped() {
        let text = "fn f<'a>(x: &'a str) { m('\"', '\\'', b'x', 0x1f, r#type) }";
        assert_eq!(words_and_marks(text).concat(), "fnf<>(x:&str){m(,,,,type)}");
    }

    #[test]
    fn unfinished_text_ends_with_the_file() {
        for text in ["\"a", "r#\"a", "/* a", "'", "//", "/*"] {
            assert!(pieces(text).len() <= 1, "{text}");
        }
    }
}
