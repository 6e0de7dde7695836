//! Points as lines of numbers: `.xyz`, `.txt`, `.asc`, `.csv` and `.pts`.
//!
//! Accepted are blanks, tabs, commas or semicolons between the numbers; comments after `#` or `//`; a count before
//! the points; names of the columns, also in a comment (`//X Y Z`); a decimal comma; and a first column that counts
//! the lines. If columns have names, those other than the coordinates may hold text. Ambiguous files are refused.

use super::columns::Layout;
use super::fields::{split, without_quoted};
use super::lines::{self, decode, excerpt, without_comment};
use super::{CloudFile, Note, Position};
use crate::dataset::Point;
use std::borrow::Cow;

/// The columns of one file, and what is known of them.
#[derive(Default)]
struct Table {
    /// The columns' names, if a line has them.
    named: Option<Names>,
    /// Whether the names are separated by tabs, and so all lines.
    tabs: bool,
    /// Whether the first column has no name: it numbers or names the lines.
    row_names: bool,
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

/// What a line of names tells.
struct Names {
    layout: Layout,
    /// How many there are.
    count: usize,
    /// Whether they stand in a comment, which may say something else.
    in_comment: bool,
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
        // An empty field between tabs is one, at the ends of a line as well.
        let is_tab = |c: char| self.tabs && c == '\t';
        let content = content.trim_matches(|c: char| c.is_whitespace() && !is_tab(c));
        if content.trim().is_empty() {
            let named = self.names(comment.trim_start_matches(['#', '/']), true);
            self.named = self.named.take().or(named);
            return Ok(());
        }
        let mut fields = self.fields(content)?;
        if let Some(named) = &self.named
            && content.ends_with([',', ';', '\t'])
            && fields.len() < named.count
        {
            fields.resize(named.count, "".into());
        }
        if self.columns == 0 {
            self.match_names(&fields)?;
        }
        let named = self.named.as_ref();
        let is_coordinate = |at: usize| named.is_none_or(|n| n.layout.point.contains(&at));
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
        let is_before = self.columns == 0 && self.named.is_none();
        self.named = self.names(content, false);
        self.tabs = self.named.is_some() && content.contains('\t');
        let has_number = fields.iter().any(|field| number(field).is_some());
        match self.named {
            Some(_) => Ok(()),
            None if is_before && !has_number => Err(format!(
                "expected three coordinates, or the names of the columns, of which three are x, y and z (or easting, northing, elevation); found \"{}\"",
                excerpt(content)
            )),
            None => Err(format!(
                "expected three coordinates, found \"{}\"",
                excerpt(content)
            )),
        }
    }

    /// Compares the names with the fields of the first line of numbers.
    fn match_names(&mut self, fields: &[Cow<str>]) -> Result<(), String> {
        let Some(named) = &mut self.named else {
            return Ok(());
        };
        let (names, columns) = (named.count, fields.len());
        // A count of points before them.
        if columns == 1 || names == columns {
            return Ok(());
        }
        if names + 1 == columns {
            named.layout.shift();
            self.row_names = true;
            return Ok(());
        }
        if named.in_comment {
            self.named = None;
            return Ok(());
        }
        let hint = match self.commas && !self.fractions && columns == 2 * names {
            true => "; if these are decimal commas, separate the numbers by semicolons",
            false => "",
        };
        Err(format!(
            "{columns} columns, where the first line names {names}{hint}"
        ))
    }

    /// Splits a line at its separators: semicolons if there are any, else tabs if it has text or the names have them, else
    /// commas unless they are decimal, else white space. A decimal comma becomes a point. What stands in quotes is one field.
    fn fields<'a>(&mut self, content: &'a str) -> Result<Vec<Cow<'a, str>>, String> {
        let bare = without_quoted(content);
        let pointed = |field: &Cow<'a, str>| Cow::from(field.replacen(',', ".", 1));
        let words = || split(content, ' ');
        let commas = bare.contains(',');
        let all_numbers = || bare == content && words().iter().all(|word| number(word).is_some());
        let separator = if bare.contains(';') {
            Some(';')
        } else {
            (bare.contains('\t') && (self.tabs || !all_numbers())).then_some('\t')
        };
        if let Some(separator) = separator {
            let fields = split(content, separator);
            let decimal: Vec<Cow<str>> = fields.iter().map(pointed).collect();
            let mut with_comma = fields
                .iter()
                .zip(&decimal)
                .filter(|(of, _)| of.contains(','));
            if commas && !bare.contains('.') && with_comma.any(|(_, of)| number(of).is_some()) {
                self.note_comma()?;
                return Ok(decimal);
            }
            if !commas {
                self.note_point(content)?;
            }
            return Ok(fields);
        }
        if !commas {
            self.note_point(content)?;
            return Ok(words());
        }
        let decimal: Vec<Cow<str>> = words().iter().map(pointed).collect();
        let is_decimal = !content.contains('.')
            && decimal.len() >= 3
            && decimal.iter().all(|field| number(field).is_some())
            && !words()
                .iter()
                .any(|word| word.ends_with(',') || word.starts_with(','));
        if is_decimal {
            self.note_comma()?;
            return Ok(decimal);
        }
        if self.decimal_comma == Some(true) {
            return Err(format!(
                "expected numbers with a decimal comma, found \"{}\"",
                excerpt(content)
            ));
        }
        self.commas = true;
        self.note_point(content)?;
        Ok(split(content, ','))
    }

    /// Records that numbers have a decimal comma.
    fn note_comma(&mut self) -> Result<(), String> {
        match self.decimal_comma.replace(true) {
            Some(false) => Err("a decimal comma, where the lines before have points".into()),
            _ => Ok(()),
        }
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
    fn names(&self, text: &str, in_comment: bool) -> Option<Names> {
        if self.columns > 0 || self.named.is_some() {
            return None;
        }
        let bare = without_quoted(text);
        let separator = [';', ',', '\t'].into_iter().find(|&c| bare.contains(c));
        let words = split(text, separator.unwrap_or(' ')).into_iter();
        let name = |word: Cow<str>| {
            let word = word.to_lowercase();
            let word = word.split(['[', '(']).next().unwrap_or("");
            word.trim().to_owned()
        };
        let names: Vec<String> = words.map(name).collect();
        let layout = Layout::named(&names)?;
        Some(Names {
            layout,
            count: names.len(),
            in_comment,
        })
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
        let has_index = self.columns > 3
            && numbers_lines(
                column(0),
                (1..self.columns).any(|at| column(at).any(|x| x.fract() != 0.0)),
            );
        let mut layout = match self.named {
            Some(_) if self.row_names && !(has_index || column(0).all(f64::is_nan)) => {
                return Err(format!(
                    "{} columns, where the first line names {}, and the first does not number the lines",
                    self.columns,
                    self.columns - 1
                ));
            }
            Some(named) => named.layout,
            None => Layout::guessed(usize::from(has_index), self.columns, |at| {
                column(at).all(|x| (0.0..=255.0).contains(&x) && x.fract() == 0.0)
            }),
        };
        if self.row_names || is_guess && has_index {
            file.notes.push(Note::IndexColumn);
        }
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

/// Whether a column numbers the lines: from 0 or 1 on, or, if other columns have `fractions`, by whole numbers of which each stands
/// once.
fn numbers_lines(column: impl Iterator<Item = f64> + Clone, fractions: bool) -> bool {
    let rows = column.clone().count();
    let counts = |first: f64| {
        column
            .clone()
            .zip(0..)
            .all(|(x, i)| x == first + f64::from(i))
    };
    if rows > 1 && (counts(0.0) || counts(1.0)) {
        return true;
    }
    let is_whole = |x: f64| x >= 0.0 && x.fract() == 0.0 && x < 1e15;
    if rows < 3 || !fractions || !column.clone().all(is_whole) {
        return false;
    }
    let mut sorted: Vec<u64> = column.map(|x| x as u64).collect();
    sorted.sort_unstable();
    sorted.array_windows().all(|[a, b]| a < b)
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
