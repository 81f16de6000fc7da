//! Finds the tests in Rust sources, each with its comments.

use std::ops::Range;

use proc_macro2::{Delimiter, TokenStream, TokenTree};

/// A test function with its comments: those in its body, its doc comments, and line comments directly above it.
#[derive(Debug, PartialEq, Eq)]
pub struct Test {
    pub name: String,
    pub comments: String,
}

/// The tests and strings of a Rust source.
#[derive(Debug, Default)]
pub struct Source {
    pub tests: Vec<Test>,
    /// The contents of its string literals.
    pub strings: Vec<String>,
}

/// Reads a source. Tests are the functions with an attribute `#[test]` or one whose path ends in `test`, also inside macros
/// such as `proptest!`.
///
/// # Errors
/// The text is not valid Rust; the error says why.
pub fn read(text: &str) -> Result<Source, String> {
    let stream: TokenStream = text.parse().map_err(|error: proc_macro2::LexError| error.to_string())?;
    let mut reader = Reader { text, tokens: Vec::new(), tests: Vec::new(), strings: Vec::new() };
    reader.walk(stream, 0);
    let tests = reader.tests.iter().map(|(name, range)| Test { name: name.clone(), comments: reader.comments(range) });
    Ok(Source { tests: tests.collect(), strings: reader.strings })
}

struct Reader<'a> {
    text: &'a str,
    /// The byte ranges of all tokens, in order. The bytes between them are blanks and comments, including doc comments.
    tokens: Vec<Range<usize>>,
    tests: Vec<(String, Range<usize>)>,
    strings: Vec<String>,
}

impl Reader<'_> {
    /// Reads a stream of tokens that begins after byte `before` of the text. A comment directly above the first token is
    /// searched for from there on.
    fn walk(&mut self, stream: TokenStream, before: usize) {
        let trees: Vec<TokenTree> = stream.into_iter().collect();
        let mut attributes_end = 0;
        for (at, tree) in trees.iter().enumerate() {
            if at >= attributes_end && is_punct(tree, '#') {
                let (count, is_test) = attributes(&trees[at..]);
                attributes_end = at + count;
                if is_test && let Some((name, end)) = function(&trees[attributes_end..]) {
                    let above = at.checked_sub(1).map_or(before, |i| trees[i].span().byte_range().end);
                    let start = self.start_of_comment(above..tree.span().byte_range().start);
                    self.tests.push((name, start..end));
                }
            }
            self.note(tree);
        }
    }

    /// Adds a token and the tokens inside it.
    fn note(&mut self, tree: &TokenTree) {
        let range = tree.span().byte_range();
        // A doc comment appears as the tokens of an attribute, each of which has the range of the whole comment.
        if self.text[range.clone()].starts_with("//") || self.text[range.clone()].starts_with("/*") {
            return;
        }
        match tree {
            TokenTree::Group(group) => {
                let [open, close] = [group.span_open(), group.span_close()].map(|span| span.byte_range());
                self.tokens.push(open.clone());
                self.walk(group.stream(), open.end);
                self.tokens.push(close);
            }
            TokenTree::Literal(literal) => {
                let written = literal.to_string();
                if let (Some(open), Some(close)) = (written.find('"'), written.rfind('"')) {
                    self.strings.push(written[(open + 1).min(close)..close].to_owned());
                }
                self.tokens.push(range);
            }
            TokenTree::Ident(_) | TokenTree::Punct(_) => self.tokens.push(range),
        }
    }

    /// The byte at which the line comments directly above the end of `gap` begin. `gap` is the range between two tokens.
    fn start_of_comment(&self, gap: Range<usize>) -> usize {
        let text = &self.text[gap.clone()];
        let last_line = text.rfind('\n').map_or(0, |end| end + 1);
        let mut start = last_line;
        for line in text[..last_line].split_inclusive('\n').rev() {
            let begin = start - line.len();
            // A comment in the first line of the gap belongs to the token before it, except at the beginning of the file.
            if line.trim().is_empty() || (begin == 0 && gap.start != 0) {
                break;
            }
            start = begin;
        }
        gap.start + start
    }

    /// The text between the tokens in `range`: its comments.
    fn comments(&self, range: &Range<usize>) -> String {
        let mut comments = String::new();
        let mut at = range.start;
        let first = self.tokens.partition_point(|token| token.end <= range.start);
        for token in self.tokens[first..].iter().take_while(|token| token.start < range.end) {
            comments.push_str(&self.text[at..token.start]);
            comments.push('\n');
            at = token.end;
        }
        comments
    }
}

/// The number of trees at the beginning of `trees` that are attributes, and whether one of the attributes is `#[test]`.
fn attributes(trees: &[TokenTree]) -> (usize, bool) {
    let mut count = 0;
    let mut is_test = false;
    while let Some([hash, TokenTree::Group(group)]) = trees.get(count..count + 2)
        && is_punct(hash, '#')
        && group.delimiter() == Delimiter::Bracket
    {
        let path =
            group.stream().into_iter().take_while(|tree| is_punct(tree, ':') || matches!(tree, TokenTree::Ident(_)));
        is_test |= path.last().is_some_and(|tree| is_word(&tree, "test"));
        count += 2;
    }
    (count.max(1), is_test)
}

/// The name of the function at the beginning of `trees`, and the index of the byte after its body; `None` if there is no
/// function.
fn function(trees: &[TokenTree]) -> Option<(String, usize)> {
    let keyword = trees.iter().position(|tree| is_word(tree, "fn"))?;
    let qualifies = |tree: &TokenTree| match tree {
        TokenTree::Ident(word) => ["pub", "async", "const", "unsafe", "extern"].iter().any(|known| word == known),
        TokenTree::Group(group) => group.delimiter() == Delimiter::Parenthesis,
        TokenTree::Literal(_) => true,
        TokenTree::Punct(_) => false,
    };
    if !trees[..keyword].iter().all(qualifies) {
        return None;
    }
    let name = trees.get(keyword + 1)?.to_string();
    let body = trees[keyword + 1..].iter().find_map(|tree| match tree {
        TokenTree::Group(group) if group.delimiter() == Delimiter::Brace => Some(group.span_close().byte_range().end),
        _ => None,
    })?;
    Some((name, body))
}

fn is_punct(tree: &TokenTree, c: char) -> bool {
    matches!(tree, TokenTree::Punct(punct) if punct.as_char() == c)
}

fn is_word(tree: &TokenTree, word: &str) -> bool {
    matches!(tree, TokenTree::Ident(ident) if ident == word)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The names of the tests, each with the words of its comments.
    fn tests(text: &str) -> Vec<(String, String)> {
        let tests = read(text).unwrap().tests;
        let marks = ["//", "///"];
        let words = |comments: &str| {
            comments.split_whitespace().filter(|word| !marks.contains(word)).collect::<Vec<_>>().join(" ")
        };
        tests.iter().map(|test| (test.name.clone(), words(&test.comments))).collect()
    }

    fn pairs(expected: &[(&str, &str)]) -> Vec<(String, String)> {
        expected.iter().map(|(name, words)| (name.to_string(), words.to_string())).collect()
    }

    #[test]
    fn comments_above_and_inside_a_test_are_its_own() {
        let text = "
//! of the file

/// of a helper
fn helper() {} // behind the helper
// above
/// doc
#[test] // beside
#[should_panic(expected = \"// no comment\")]
// between
pub(crate) fn first() { // in
    let x = \"SK-1.1 /* no comment */\"; /* block */
    { // deep
    }
} // behind
";
        assert_eq!(tests(text), pairs(&[("first", "above doc beside between in /* block */ deep")]));
    }

    #[test]
    fn comments_that_do_not_touch_a_test_are_not_its_own() {
        let text = "// far\n\n#[test]\nfn a() {}\n// far\n\n// near\n#[test]\nfn b() {}\n// after\nfn c() {}";
        assert_eq!(tests(text), pairs(&[("a", ""), ("b", "near")]));
        assert_eq!(tests("// near\n#[test]\nfn a() {}"), pairs(&[("a", "near")]));
    }

    #[test]
    fn a_function_without_the_attribute_is_no_test() {
        let text = "
/// helper
fn a() {}
/// cfg
#[cfg(test)]
fn b() {}
/// a module
#[cfg(test)]
mod tests {
    /// inner
    #[test]
    fn c() {}
    // an allocator test
    #[other::test]
    async fn d() {}
}
/// not a function
#[test]
struct E;
/// nor its neighbour
fn f() {}
";
        assert_eq!(tests(text), pairs(&[("c", "inner"), ("d", "an allocator test")]));
    }

    #[test]
    fn tests_in_macros_are_found() {
        let text = "
proptest! {
    #![proptest_config(small())]

    /// one
    #[test]
    fn every_value(value in 0..=u8::MAX, text in \".*\") {
        // inside é
        prop_assert!(value < 255);
    }

    // two
    #[test]
    fn second(x: u8) {}
}
";
        assert_eq!(tests(text), pairs(&[("every_value", "one inside é"), ("second", "two")]));
    }

    #[test]
    fn the_last_letter_of_a_doc_comment_counts() {
        let text = "/// ü\n/// SK-5.12\n#[test]\nfn a() {}\n/** SK-5.13 */\n#[test]\nfn b() {}";
        assert_eq!(tests(text), pairs(&[("a", "ü SK-5.12"), ("b", "/** SK-5.13 */")]));
    }

    #[test]
    fn strings_are_kept_and_nonsense_is_an_error() {
        let strings =
            read("const A: [&str; 3] = [\"one\", r#\"two \"2\"\"#, \"\"]; const B: &[u8] = b\"c\";").unwrap().strings;
        assert_eq!(strings, ["one", "two \"2\"", "", "c"]);
        assert!(read("fn a( {").is_err());
    }
}
