//! Finds the comments in C and C++ sources, each with the function that it belongs to.

/// A comment, and the name of its function: the one around it or directly below it; `None` for a comment on the whole file.
#[derive(Debug, PartialEq, Eq)]
pub struct Comment {
    pub function: Option<String>,
    pub text: String,
}

/// A token of a C or C++ source. Only as many kinds of tokens are distinguished as finding functions needs.
enum Piece<'a> {
    Comment(&'a str),
    Word(&'a str),
    /// A character of code that is neither a blank nor part of a comment or word.
    Sign(char),
    /// A blank line, which separates a comment from the function below it.
    Gap,
}

/// All comments of a source, in their order.
pub fn comments(text: &str) -> Vec<Comment> {
    let mut found = Vec::new();
    // The index in `found` of the first comment that stands directly above the next function, if a function follows.
    let mut above = 0;
    let mut function: Option<(String, usize)> = None;
    let mut depth = 0;
    let mut head = Head::default();
    for piece in pieces(text) {
        match piece {
            Piece::Comment(text) => {
                found.push(Comment { function: function.as_ref().map(|(name, _)| name.clone()), text: text.to_owned() })
            }
            Piece::Gap if head.is_empty() => above = found.len(),
            Piece::Sign('{') => {
                depth += 1;
                if function.is_none()
                    && let Some(name) = head.function()
                {
                    for comment in &mut found[above..] {
                        comment.function = Some(name.to_owned());
                    }
                    function = Some((name.to_owned(), depth));
                }
                head = Head::default();
                above = found.len();
            }
            Piece::Sign('}') => {
                if function.as_ref().is_some_and(|(_, body)| *body == depth) {
                    function = None;
                }
                depth = depth.saturating_sub(1);
                head = Head::default();
                above = found.len();
            }
            Piece::Sign(';') => {
                head = Head::default();
                above = found.len();
            }
            Piece::Sign(sign) => head.sign(sign),
            Piece::Word(word) => head.word(word),
            Piece::Gap => {}
        }
    }
    found
}

/// The tokens before a `{`, since the end of the last statement or block. They show whether the `{` opens the body of a
/// function, or a namespace, a struct or an initialiser.
#[derive(Default)]
struct Head<'a> {
    last_word: Option<&'a str>,
    /// The word before the first `(`. It is the name of the function, if the tokens are the head of a function.
    called: Option<&'a str>,
    assigned: bool,
    parentheses: usize,
    any: bool,
}

impl<'a> Head<'a> {
    fn is_empty(&self) -> bool {
        !self.any
    }

    fn word(&mut self, word: &'a str) {
        self.any = true;
        self.last_word = Some(word);
    }

    fn sign(&mut self, sign: char) {
        self.any = true;
        match sign {
            '(' => {
                if self.parentheses == 0 && self.called.is_none() {
                    self.called = self.last_word;
                }
                self.parentheses += 1;
            }
            ')' => self.parentheses = self.parentheses.saturating_sub(1),
            '=' if self.parentheses == 0 => self.assigned = true,
            _ => {}
        }
    }

    fn function(&self) -> Option<&'a str> {
        self.called.filter(|_| !self.assigned && self.parentheses == 0)
    }
}

/// Splits a source into tokens. Preprocessor lines and literals are left out.
fn pieces(text: &str) -> Vec<Piece<'_>> {
    let mut pieces = Vec::new();
    let mut rest = text;
    let mut line_start = true;
    while let Some(c) = rest.chars().next() {
        let is_word = |c: char| c.is_alphanumeric() || c == '_';
        let len = if rest.starts_with("//") {
            let len = rest.find('\n').unwrap_or(rest.len());
            pieces.push(Piece::Comment(&rest[..len]));
            len
        } else if let Some(opened) = rest.strip_prefix("/*") {
            let len = opened.find("*/").map_or(rest.len(), |end| end + "/**/".len());
            pieces.push(Piece::Comment(&rest[..len]));
            len
        } else if c == '\n' {
            if line_start {
                pieces.push(Piece::Gap);
            }
            1
        } else if c == '#' && line_start {
            preprocessor_len(rest)
        } else if c == '"' || c == '\'' {
            literal_len(rest, c)
        } else if is_word(c) {
            let len = rest.find(|c| !is_word(c)).unwrap_or(rest.len());
            pieces.push(Piece::Word(&rest[..len]));
            len
        } else {
            if !c.is_whitespace() {
                pieces.push(Piece::Sign(c));
            }
            c.len_utf8()
        };
        line_start = c == '\n' || (line_start && c.is_whitespace());
        rest = &rest[len..];
    }
    pieces
}

/// The length in bytes of a preprocessor line, including lines that a backslash joins to it, up to the end or to a comment in
/// it.
fn preprocessor_len(text: &str) -> usize {
    let mut previous = ' ';
    for (at, c) in text.char_indices() {
        let comment = text[at..].starts_with("//") || text[at..].starts_with("/*");
        if comment || (c == '\n' && previous != '\\') {
            return at;
        }
        if c != '\r' {
            previous = c;
        }
    }
    text.len()
}

fn literal_len(text: &str, quote: char) -> usize {
    let mut escaped = false;
    for (at, c) in text.char_indices().skip(1) {
        if c == quote && !escaped {
            return at + 1;
        }
        escaped = c == '\\' && !escaped;
    }
    text.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(text: &str) -> Vec<(String, String)> {
        let shown = |comment: &Comment| (comment.function.clone().unwrap_or("-".into()), comment.text.clone());
        comments(text).iter().map(shown).collect()
    }

    #[test]
    fn comments_belong_to_the_function_around_or_below() {
        let text = r#"/* of the file */

#include <x.h> // of the include
#define BLOCK(x) \
    { x }

// above
static int read_once(const char *s) /* beside */
{
    if (s[0] == '{') { // in
        puts("// no comment } \" {");
    }
    return 0; // last
}
// behind

int table[] = { 1, 2 }; // of the table

extern "C" {
/* the main one */
int main(void) { /* body */ }
} // end
"#;
        let expected = [
            ("-", "/* of the file */"),
            ("-", "// of the include"),
            ("read_once", "// above"),
            ("read_once", "/* beside */"),
            ("read_once", "// in"),
            ("read_once", "// last"),
            ("-", "// behind"),
            ("-", "// of the table"),
            ("main", "/* the main one */"),
            ("main", "/* body */"),
            ("-", "// end"),
        ];
        assert_eq!(found(text), expected.map(|(function, text)| (function.to_owned(), text.to_owned())));
    }

    #[test]
    fn cpp_heads_are_understood() {
        let text = "namespace a { struct B : C {\n// of run\nvoid run(int i = 0) const noexcept {}\n}; }\n// free\n\
                    template <class T> T Board::open(T t) { auto f = [](int) { /* lambda */ }; }";
        let functions: Vec<_> = found(text).into_iter().map(|(function, _)| function).collect();
        assert_eq!(functions, ["run", "open", "open"]);
    }

    #[test]
    fn an_end_in_the_middle_is_no_harm() {
        for text in ["/* open", "\"open", "'", "int main() {", "}}}", "#define A \\", "// é", "#"] {
            comments(text);
        }
    }
}
