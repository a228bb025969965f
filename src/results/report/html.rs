//! Texts and JSON values in HTML, and tables of them.

use crate::base::text::short;
use maud::{Markup, PreEscaped, Render, html};
use serde_json::{Map, Value};

/// A text in HTML: escaped, and without control characters, which HTML forbids.
pub struct Text<'a>(pub &'a str);

impl Render for Text<'_> {
    fn render_to(&self, buffer: &mut String) {
        let allowed = |c: char| !c.is_control() || matches!(c, '\t' | '\n');
        let shown = |c| if allowed(c) { c } else { '\u{fffd}' };
        let text: String = self.0.chars().map(shown).collect();
        text.render_to(buffer);
    }
}

/// A value as a person reads it; a dash for an unknown one.
pub fn shown(value: &Value) -> Markup {
    match value {
        Value::Null => html! { "–" },
        Value::Bool(true) => html! { "yes" },
        Value::Bool(false) => html! { "no" },
        Value::String(text) => html! { (Text(text)) },
        Value::Number(number) => match (number.as_u64(), number.as_f64()) {
            (Some(whole), _) => html! { (whole) },
            (None, Some(number)) => html! { (short(number)) },
            (None, None) => html! { (number.to_string()) },
        },
        Value::Array(list) if list.len() > 8 => html! { (list.len()) " values" },
        Value::Array(list) => joined(list.iter().map(shown), ", "),
        Value::Object(map) => object(map),
    }
}

/// A quantum cost as its value and its label, which says how it was obtained; any other object as
/// its keys and values.
fn object(map: &Map<String, Value>) -> Markup {
    match map.get("label") {
        Some(label) => html! {
            @if let Some(value) = map.get("value") { (shown(value)) }
            " " span class="faint" { (Text(label.as_str().unwrap_or_default())) }
        },
        None => {
            let part = |(key, value): (&String, &Value)| html! { (Text(key)) " " (shown(value)) };
            joined(map.iter().map(part), "; ")
        }
    }
}

fn joined(parts: impl Iterator<Item = Markup>, between: &str) -> Markup {
    let parts: Vec<String> = parts.map(PreEscaped::into_string).collect();
    PreEscaped(parts.join(between))
}

/// Rows of a table, each with a label and a value. Unknown values have no row.
#[derive(Default)]
pub struct ReportRows(Vec<(String, Markup)>);

impl ReportRows {
    /// Adds a row for each of `keys` whose value is not null, with its label.
    pub fn values(&mut self, keys: &[(&str, &str)], values: &Value) {
        for (key, label) in keys {
            if !values[key].is_null() {
                self.0.push(((*label).to_owned(), shown(&values[key])));
            }
        }
    }

    /// Adds a row of text, unless the text is missing or empty.
    pub fn text(&mut self, label: &str, text: Option<String>) {
        if let Some(text) = text.filter(|text| !text.is_empty()) {
            self.0.push((label.to_owned(), html! { (Text(&text)) }));
        }
    }

    /// The table; nothing without rows.
    pub fn table(&self) -> Markup {
        html! {
            @if !self.0.is_empty() {
                table {
                    @for (label, value) in &self.0 {
                        tr { th { (Text(label)) } td class="number" { (value) } }
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn markup_in_texts_is_escaped() {
        let text = Text("<b a=\"1\" c='2'>&\u{1}\n").render().into_string();
        assert_eq!(text, "&lt;b a=&quot;1&quot; c='2'&gt;&amp;\u{fffd}\n");
        // Attributes are in double quotes, so a single quote does not end them.
        let attribute = html! { p title=(Text("' onclick='")) {} }.into_string();
        assert_eq!(attribute, "<p title=\"' onclick='\"></p>");
        let value = shown(&serde_json::json!({ "<k>": ["<v>"] })).into_string();
        assert!(!value.contains("<k>") && !value.contains("<v>"));
        let figure = shown(&serde_json::json!({ "label": "exact", "value": 0.25 }));
        assert_eq!(figure.into_string(), "0.25 <span class=\"faint\">exact</span>");
    }
}
