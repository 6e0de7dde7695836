//! Fields of a line of text.

use std::borrow::Cow;

/// The fields between separators, without those that are empty at the end, and between blanks without any that is empty. A separator in quotes belongs to its field, as RFC 4180 has it.
pub(super) fn split(content: &str, separator: char) -> Vec<Cow<'_, str>> {
    let content = content.trim_end_matches([separator, ' ']);
    if !content.contains('"') {
        return match separator == ' ' {
            true => content.split_whitespace().map(Cow::from).collect(),
            false => content
                .split(separator)
                .map(|field| field.trim().into())
                .collect(),
        };
    }
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .delimiter(separator as u8)
        .trim(csv::Trim::All)
        .from_reader(content.as_bytes());
    let record = reader.records().next().and_then(Result::ok);
    let fields = record.iter().flatten();
    let fields = fields.filter(|field| separator != ' ' || !field.is_empty());
    fields.map(|field| field.to_owned().into()).collect()
}

/// A line without what stands in quotes.
pub(super) fn without_quoted(content: &str) -> Cow<'_, str> {
    if !content.contains('"') {
        return content.into();
    }
    content.split('"').step_by(2).collect::<String>().into()
}
