//! Finds the line of a field in a TOML text, and the field at a position of the text.

use std::ops::Range;

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::address::text::line_at;

/// A TOML text, which is known to be valid, with the positions of its fields.
pub(super) struct Places<'t> {
    text: &'t str,
    root: DeTable<'t>,
}

impl<'t> Places<'t> {
    /// Reads the positions of a text.
    ///
    /// # Errors
    /// The text is no TOML: the line, and what is wrong.
    pub(super) fn new(text: &'t str) -> Result<Self, (usize, String)> {
        match DeTable::parse(text) {
            Ok(root) => Ok(Self { text, root: root.into_inner() }),
            Err(error) => {
                let at = error.span().map_or(0, |span| span.start);
                Err((line_at(text, at), error.message().trim_end().replace('\n', ", ")))
            }
        }
    }

    /// The value of a field that is outside all tables; `None` if the text has no such field.
    pub(super) fn top(&self, name: &str) -> Option<&DeValue<'t>> {
        self.root.iter().find(|(key, _)| key.get_ref() == name).map(|(_, value)| value.get_ref())
    }

    /// The line of a field. If the text does not have the field, the line of the innermost table that would contain it;
    /// 1 if there is no such table either. In `path`, elements of an array are numbered from 1.
    pub(super) fn line(&self, path: &[&str]) -> usize {
        let mut line = 1;
        let mut value: Option<&DeValue<'_>> = None;
        for name in path {
            let below = match value {
                None => of_table(&self.root, name),
                Some(DeValue::Table(table)) => of_table(table, name),
                Some(DeValue::Array(array)) => {
                    let index = name.parse::<usize>().ok().and_then(|number| number.checked_sub(1));
                    index.and_then(|index| array.get(index)).map(|element| (element.span().start, element.get_ref()))
                }
                Some(_) => None,
            };
            let Some((at, below)) = below else { break };
            line = line_at(self.text, at);
            value = Some(below);
        }
        line
    }

    /// The innermost field at a position of the text, with its line.
    pub(super) fn field(&self, at: usize) -> (Vec<String>, usize) {
        let mut path = Vec::new();
        descend(&self.root, at, &mut path);
        (path, line_at(self.text, at))
    }
}

fn of_table<'a, 't>(table: &'a DeTable<'t>, name: &str) -> Option<(usize, &'a DeValue<'t>)> {
    let (key, value) = table.iter().find(|(key, _)| key.get_ref() == name)?;
    Some((key.span().start, value.get_ref()))
}

fn descend(table: &DeTable<'_>, at: usize, path: &mut Vec<String>) {
    let within = |span: Range<usize>| span.start <= at && at < span.end.max(span.start + 1);
    for (key, value) in table {
        let is_here = within(key.span()) || within(value.span());
        let before = path.len();
        path.push(key.get_ref().to_string());
        below(value, at, path);
        // A table may be written in several parts of the text, so its span does not cover all its fields. A field that
        // contains the position therefore counts even if the span of its table does not contain it.
        if is_here || path.len() > before + 1 {
            return;
        }
        path.pop();
    }
}

fn below(value: &Spanned<DeValue<'_>>, at: usize, path: &mut Vec<String>) {
    match value.get_ref() {
        DeValue::Table(table) => descend(table, at, path),
        DeValue::Array(array) => {
            for (number, element) in (1_usize..).zip(array.iter()) {
                let before = path.len();
                path.push(number.to_string());
                below(element, at, path);
                if element.span().contains(&at) || path.len() > before + 1 {
                    return;
                }
                path.pop();
            }
        }
        _ => {}
    }
}
