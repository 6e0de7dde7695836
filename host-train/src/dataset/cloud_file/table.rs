//! Points as lines of numbers: `.xyz`, `.txt`, `.asc`, `.csv` and `.pts`.
//!
//! Accepted are blanks, tabs, commas or semicolons between the numbers; comments after `#` or `//`; a count before
//! the points; names of the columns, also in a comment (`//X Y Z`); a decimal comma; and a first column that counts
//! the lines. If columns have names, those other than the coordinates may hold text. Ambiguous files are refused.

use super::columns::Layout;
use super::lines::{self, decode, excerpt, without_comment};
use super::{CloudFile, Note, Position};
use crate::dataset::Point;
use std::borrow::Cow;

/// The columns of one file, and what is known of them.
#[derive(Default)]
struct Table {
    /// The columns' meaning, if a line names them.
    named: Option<Layout>,
    /// Numbers, row by row; NaN for text.
    numbers: Vec<f64>,
    /// Numbers per row; 0 before the first row.
    columns: usize,
    /// Whether numbers have a decimal comma; `None` while unknown.
    decimal_comma: Option<bool>,
    /// Whether a number has a point or an exponent.
    fractions: bool,
    /// Whether the columns are separated by commas.
    commas: bool,
    /// Sum of the counts before the points.
    counted: Option<u64>,
}

pub(super) fn parse(bytes: &[u8]) -> Result<CloudFile, String> {
    let mut file = CloudFile::default();
    let text = decode(bytes, &mut file.notes)?;
    let mut table = Table::default();
    for (line, text) in (1..).zip(text.lines()) {
        table
            .read(text)
            .map_err(|reason| format!("line {line}: {reason}"))?;
    }
    table.finish(&mut file)?;
    Ok(file)
}

impl Table {
    /// Reads one line.
    fn read(&mut self, text: &str) -> Result<(), String> {
        let slashes = text.find("//").unwrap_or(text.len());
        let content = without_comment(&text[..slashes]).0;
        let comment = &text[content.len()..];
        let content = content.trim();
        if content.is_empty() {
            let named = self.names(comment.trim_start_matches(['#', '/']));
            self.named = self.named.take().or(named);
            return Ok(());
        }
        let fields = self.fields(content)?;
        let named = self.named.as_ref();
        let is_coordinate = |at: usize| named.is_none_or(|layout| layout.point.contains(&at));
        let value = |(at, field): (usize, &Cow<str>)| {
            number(field).or((!is_coordinate(at)).then_some(f64::NAN))
        };
        let row: Option<Vec<f64>> = fields.iter().enumerate().map(value).collect();
        match row.as_deref() {
            Some(&[count]) if count >= 0.0 && count.fract() == 0.0 => {
                *self.counted.get_or_insert_default() += count as u64;
                return Ok(());
            }
            Some(row) if row.len() >= 3 => {
                if self.columns == 0 {
                    self.columns = row.len();
                }
                if self.columns != row.len() {
                    return Err(format!(
                        "{} columns, where the lines before have {}",
                        row.len(),
                        self.columns
                    ));
                }
                self.numbers.extend(row);
                return Ok(());
            }
            _ => {}
        }
        self.named = self.names(content);
        match self.named {
            Some(_) => Ok(()),
            None => Err(format!(
                "expected three coordinates, found \"{}\"",
                excerpt(content)
            )),
        }
    }

    /// Splits a line at its separators: semicolons if there are any, else commas unless they are decimal, else
    /// white space. A decimal comma becomes a point.
    fn fields<'a>(&mut self, content: &'a str) -> Result<Vec<Cow<'a, str>>, String> {
        let plain = |field: &'a str| Cow::from(field.trim().trim_matches('"'));
        let pointed = |field: &'a str| Cow::from(plain(field).replacen(',', ".", 1));
        let by_blanks = || content.split_whitespace();
        let semicolons = content.contains(';');
        let ends_cut = |separator| content.trim_end_matches(separator).split(separator);
        if semicolons && !content.contains(',') {
            self.note_point(content)?;
            return Ok(ends_cut(';').map(plain).collect());
        }
        if !content.contains(',') {
            self.note_point(content)?;
            return Ok(by_blanks().map(plain).collect());
        }
        let decimal: Vec<Cow<str>> = if semicolons {
            ends_cut(';').map(pointed).collect()
        } else {
            by_blanks().map(pointed).collect()
        };
        let is_decimal = !content.contains('.')
            && decimal.len() >= 3
            && decimal.iter().all(|field| number(field).is_some())
            && !by_blanks().any(|word| word.ends_with(',') || word.starts_with(','));
        if is_decimal {
            if self.decimal_comma.replace(true) == Some(false) {
                return Err("a decimal comma, where the lines before have points".into());
            }
            return Ok(decimal);
        }
        if semicolons {
            // The fields are not numbers: they are names, or the line will be refused.
            return Ok(ends_cut(';').map(plain).collect());
        }
        if self.decimal_comma == Some(true) {
            return Err(format!(
                "expected numbers with a decimal comma, found \"{}\"",
                excerpt(content)
            ));
        }
        self.commas = true;
        self.note_point(content)?;
        Ok(ends_cut(',').map(plain).collect())
    }

    /// Records that numbers have a decimal point, if this line shows it.
    fn note_point(&mut self, content: &str) -> Result<(), String> {
        let pointed = content.contains('.') && content.contains(|c: char| c.is_ascii_digit());
        self.fractions |= pointed || content.contains(['e', 'E']);
        if !pointed {
            return Ok(());
        }
        match self.decimal_comma.replace(false) {
            Some(true) => Err("a decimal point, where the lines before have commas".into()),
            _ => Ok(()),
        }
    }

    /// The meaning of the columns, if this line before the points names them.
    fn names(&self, text: &str) -> Option<Layout> {
        if self.columns > 0 || self.named.is_some() {
            return None;
        }
        let separator = [';', ',', '\t'].into_iter().find(|&c| text.contains(c));
        let words: Vec<&str> = match separator {
            Some(c) => text.split(c).collect(),
            None => text.split_whitespace().collect(),
        };
        let name = |word: &str| {
            let word = word.trim().trim_matches('"').to_lowercase();
            word.split(['[', '('])
                .next()
                .unwrap_or("")
                .trim()
                .to_owned()
        };
        let names: Vec<String> = words.into_iter().map(name).collect();
        Layout::named(&names)
    }

    /// Fills in the points and their attributes.
    fn finish(self, file: &mut CloudFile) -> Result<(), String> {
        if self.numbers.is_empty() {
            return Ok(());
        }
        let rows = self.numbers.len() / self.columns;
        if self.commas && !self.fractions && self.columns >= 6 && self.named.is_none() {
            return Err(format!(
                "{} whole numbers a line with commas between them: these could be decimal commas; separate the \
                 numbers by semicolons, or name the columns on the first line",
                self.columns
            ));
        }
        if self.decimal_comma == Some(true) {
            file.notes.push(Note::DecimalComma);
        }
        if let Some(claimed) = self.counted.filter(|&claimed| claimed != rows as u64) {
            file.notes.push(Note::Count {
                what: "points",
                claimed,
                read: rows,
            });
        }
        let row = |i: usize| &self.numbers[i * self.columns..][..self.columns];
        let column = |at: usize| (0..rows).map(move |i| row(i)[at]);
        let triple = |[x, y, z]: [usize; 3]| -> Vec<Position> {
            (0..rows)
                .map(|i| [row(i)[x], row(i)[y], row(i)[z]])
                .collect()
        };
        let single = |triples: Vec<Position>| -> Vec<Point> {
            triples.into_iter().map(|t| t.map(|x| x as f32)).collect()
        };
        let is_guess = self.named.is_none();
        let mut layout = match self.named {
            Some(layout) if layout.point.iter().all(|&at| at < self.columns) => layout,
            Some(_) => return Err("its first line names more columns than the points have".into()),
            None => {
                let counts =
                    |first: f64| column(0).zip(0..).all(|(x, i)| x == first + f64::from(i));
                let index = self.columns > 3 && rows > 1 && (counts(0.0) || counts(1.0));
                if index {
                    file.notes.push(Note::IndexColumn);
                }
                Layout::guessed(usize::from(index), self.columns, |at| {
                    column(at).all(|x| (0.0..=255.0).contains(&x) && x.fract() == 0.0)
                })
            }
        };
        let has = |at: [usize; 3]| at.iter().all(|&at| at < self.columns);
        file.points = triple(layout.point);
        let normals = layout.normal.filter(|&at| has(at));
        file.normals = normals.map(|at| single(triple(at)));
        // Without names, columns that are not unit vectors may be something else.
        if is_guess && !file.normals.as_deref().is_none_or(super::are_units) {
            file.normals = None;
            layout.ignored = "the last three columns".into();
        }
        let colours = layout.colour.filter(|&at| has(at));
        file.colours = colours.and_then(|at| super::colours(&triple(at)));
        let intensity = layout.intensity.filter(|&at| at < self.columns);
        file.intensities = intensity.map(|at| column(at).map(|x| x as f32).collect());
        if !layout.ignored.is_empty() {
            file.notes.push(Note::Ignored {
                what: layout.ignored,
            });
        }
        Ok(())
    }
}

/// A number, or NaN for an empty field.
fn number(field: &str) -> Option<f64> {
    match field {
        "" => Some(f64::NAN),
        _ => lines::number(field),
    }
}

/// Writes lines of `x y z` and the attributes, in the shortest form that reads back the same. The first line names
/// the columns if there are attributes.
pub(super) fn emit(file: &CloudFile) -> Vec<u8> {
    let mut names = String::new();
    let mut push = |present: bool, name: &str| {
        if present {
            names += name;
        }
    };
    push(file.intensities.is_some(), " intensity");
    push(file.colours.is_some(), " red green blue");
    push(file.normals.is_some(), " nx ny nz");
    let mut text = match names.is_empty() {
        true => String::new(),
        false => format!("# x y z{names}\n"),
    };
    for (i, [x, y, z]) in file.points.iter().enumerate() {
        text += &format!("{x} {y} {z}");
        if let Some(intensities) = &file.intensities {
            text += &format!(" {}", intensities[i]);
        }
        if let Some(colours) = &file.colours {
            let [r, g, b] = colours[i];
            text += &format!(" {r} {g} {b}");
        }
        if let Some(normals) = &file.normals {
            let [x, y, z] = normals[i];
            text += &format!(" {x} {y} {z}");
        }
        text += "\n";
    }
    text.into_bytes()
}
