//! Writes JSON values as Lua tables. A key that is a number becomes an index.

use serde_json::Value;

/// The longest line of a table, in columns.
const COLUMNS: usize = 118;

/// The value as a Lua expression. Its first line begins at the column `column`, and its other lines are indented by
/// `indent` columns. Short entries share a line.
pub fn expression(value: &Value, column: usize, indent: usize) -> String {
    let line = one_line(value);
    if column + line.len() < COLUMNS || !value.is_array() && !value.is_object() {
        return line;
    }
    let inner = indent + 2;
    let mut lines = vec![String::new()];
    for (key, value) in entries(value) {
        let name = key.map_or_else(String::new, |key| format!("{key} = "));
        let entry = format!("{name}{},", expression(value, inner + name.len(), inner));
        let is_short = !entry.contains('\n');
        match lines.last_mut() {
            Some(line) if is_short && inner + line.len() + entry.len() < COLUMNS && !line.contains('\n') => {
                line.push_str(if line.is_empty() { "" } else { " " });
                line.push_str(&entry);
            }
            _ => lines.push(entry),
        }
    }
    let lines = lines.iter().filter(|line| !line.is_empty());
    let lines: String = lines.map(|line| format!("{:inner$}{line}\n", "")).collect();
    format!("{{\n{lines}{:indent$}}}", "")
}

fn one_line(value: &Value) -> String {
    match value {
        Value::Null => "nil".to_owned(),
        Value::Bool(_) | Value::Number(_) => value.to_string(),
        Value::String(text) => quoted(text),
        Value::Array(_) | Value::Object(_) => {
            let entries = entries(value).into_iter().map(|(key, value)| match key {
                Some(key) => format!("{key} = {}", one_line(value)),
                None => one_line(value),
            });
            format!("{{ {} }}", entries.collect::<Vec<_>>().join(", "))
        }
    }
}

/// The entries of a table with their keys, sorted, without null entries. The entries of an array have no keys.
fn entries(value: &Value) -> Vec<(Option<String>, &Value)> {
    let Value::Object(object) = value else {
        return value.as_array().into_iter().flatten().map(|value| (None, value)).collect();
    };
    let there = object.iter().filter(|(_, value)| !value.is_null());
    let mut entries: Vec<(Option<u64>, &String, &Value)> =
        there.map(|(key, value)| (key.parse().ok(), key, value)).collect();
    entries.sort_by_key(|(number, key, _)| (*number, *key));
    let key = |number: Option<u64>, key: &str| number.map_or_else(|| key.to_owned(), |number| format!("[{number}]"));
    entries.into_iter().map(|(number, name, value)| (Some(key(number, name)), value)).collect()
}

/// The text as a Lua string literal, with quotes and escape sequences.
fn quoted(text: &str) -> String {
    format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\"").replace('\n', "\\n"))
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn numbers_become_indices_and_long_tables_several_lines() {
        let value = json!({"10": "b\"\\", "9": [1, true], "name": null});
        assert_eq!(expression(&value, 0, 0), r#"{ [9] = { 1, true }, [10] = "b\"\\" }"#);
        let long = json!({"a": vec!["x"; 30], "b": 1, "c": 2});
        let text = expression(&long, 0, 0);
        assert!(
            text.starts_with("{\n  a = {\n    \"x\", \"x\", ") && text.ends_with("  },\n  b = 1, c = 2,\n}"),
            "{text}"
        );
        assert!(text.lines().all(|line| line.len() <= COLUMNS), "{text}");
    }
}
