//! CSV files, read with messages that name file, line and column.

use crate::error::bad_input;
use anyhow::Result;
use std::collections::BTreeMap;
use std::io::{self, Read};
use std::path::Path;
use std::str::FromStr;

/// Other names for columns: `wanted=in the file`, separated by commas.
#[derive(Clone, Debug, Default)]
pub(crate) struct ColumnNames(BTreeMap<String, String>);

impl FromStr for ColumnNames {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        text.split(',')
            .filter(|pair| !pair.is_empty())
            .map(|pair| match pair.split_once('=') {
                Some((wanted, given)) if !wanted.is_empty() && !given.is_empty() => {
                    Ok((wanted.trim().to_owned(), given.trim().to_owned()))
                }
                _ => Err(format!("'{pair}' is not of the form wanted=in_the_file")),
            })
            .collect::<Result<_, _>>()
            .map(Self)
    }
}

impl ColumnNames {
    fn in_file<'a>(&'a self, wanted: &'a str) -> &'a str {
        self.0.get(wanted).map_or(wanted, String::as_str)
    }
}

/// What a file is called in messages; `-` is standard input.
pub(crate) fn file_name(path: &Path) -> String {
    if is_standard_input(path) {
        "standard input".to_owned()
    } else {
        path.display().to_string()
    }
}

fn is_standard_input(path: &Path) -> bool {
    path.as_os_str() == "-"
}

fn read(path: &Path) -> io::Result<Vec<u8>> {
    if !is_standard_input(path) {
        return std::fs::read(path);
    }
    let mut content = Vec::new();
    io::stdin().lock().read_to_end(&mut content)?;
    Ok(content)
}

/// A CSV file with a header line.
pub(crate) struct Table {
    /// What it is called in messages.
    path: String,
    names: ColumnNames,
    renaming: &'static str,
    headers: csv::StringRecord,
    content: Vec<u8>,
}

/// One line of a [`Table`].
pub(crate) struct Row<'a> {
    pub(crate) line: usize,
    table: &'a Table,
    fields: csv::StringRecord,
}

/// A column that a [`Table`] has.
#[derive(Clone, Copy)]
pub(crate) struct Column<'a> {
    name: &'a str,
    index: usize,
}

const COMMENT: u8 = b'#';

impl Table {
    /// Reads a file, or standard input where it is called `-`, and its header. `names`, given by the
    /// option called `renaming`, may rename the columns in `known`.
    pub(crate) fn open(
        path: &Path,
        names: &ColumnNames,
        renaming: &'static str,
        known: &[&str],
    ) -> Result<Self> {
        let shown_path = file_name(path);
        if let Some(stranger) = names.0.keys().find(|name| !known.contains(&name.as_str())) {
            return Err(bad_input!(
                "{renaming} {}=...: no column is called that here (but {})",
                shown(stranger),
                known.join(", ")
            ));
        }
        let content =
            read(path).map_err(|error| bad_input!("{shown_path}: cannot be read: {error}"))?;
        if let Err(error) = std::str::from_utf8(&content) {
            let sound = content.get(..error.valid_up_to()).unwrap_or_default();
            let line = 1 + sound.iter().filter(|&&b| b == b'\n').count();
            return Err(bad_input!(
                "{shown_path}: line {line}: not text (invalid UTF-8)"
            ));
        }
        let headers = reader(&content)
            .headers()
            .map_err(|error| bad_input!("{shown_path}: line 1: {}", shown(&error.to_string())))?
            .clone();
        if headers.is_empty() {
            return Err(bad_input!(
                "{shown_path}: the file is empty; the first line must name the columns"
            ));
        }
        if let Some(separator) = [";", "\t"]
            .iter()
            .find(|&&s| headers.len() == 1 && headers.iter().any(|h| h.contains(s)))
        {
            return Err(bad_input!(
                "{shown_path}: line 1: the columns are separated by {separator:?}; only commas are read"
            ));
        }
        Ok(Self {
            path: shown_path,
            names: names.clone(),
            renaming,
            headers,
            content,
        })
    }

    /// The column called `wanted`, or what that is called here, if there is one.
    pub(crate) fn find<'a>(&self, wanted: &'a str) -> Result<Option<Column<'a>>> {
        let name = self.names.in_file(wanted);
        let mut places = (0..).zip(&self.headers).filter(|(_, h)| *h == name);
        let first = places.next();
        if places.next().is_some() {
            return Err(bad_input!(
                "{}: line 1: there are two columns '{}'",
                self.path,
                shown(name)
            ));
        }
        Ok(first.map(|(index, _)| Column {
            name: wanted,
            index,
        }))
    }

    /// The column called `wanted`.
    pub(crate) fn require<'a>(&self, wanted: &'a str) -> Result<Column<'a>> {
        self.find(wanted)?.ok_or_else(|| {
            let present = self.headers.iter().collect::<Vec<_>>().join(", ");
            bad_input!(
                "{}: line 1: there is no column '{}' (found: {}); \
                 {} {wanted}=NAME tells what it is called here",
                self.path,
                shown(self.names.in_file(wanted)),
                shown(&present),
                self.renaming
            )
        })
    }

    /// Hands each line to `take`; stops at the first error.
    pub(crate) fn for_each(&self, mut take: impl FnMut(&Row<'_>) -> Result<()>) -> Result<u64> {
        let path = &self.path;
        let mut rows = 0;
        for fields in reader(&self.content).records() {
            // Lines of any length are taken, and the file is text: nothing is
            // left that can be wrong with a record.
            let fields =
                fields.map_err(|error| bad_input!("{path}: {}", shown(&error.to_string())))?;
            rows += 1;
            let start = fields.position().map_or(0, csv::Position::byte);
            take(&Row {
                line: line_at(&self.content, start),
                table: self,
                fields,
            })?;
        }
        if rows == 0 {
            return Err(bad_input!("{path}: there are no lines after the header"));
        }
        Ok(rows)
    }
}

fn reader(content: &[u8]) -> csv::Reader<&[u8]> {
    csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .comment(Some(COMMENT))
        .flexible(true)
        .from_reader(content)
}

/// The line of the record that a reader at byte `start` finds next: the reader
/// has yet to pass over line ends, empty lines and comments.
fn line_at(content: &[u8], start: u64) -> usize {
    let start = usize::try_from(start)
        .unwrap_or(content.len())
        .min(content.len());
    let (before, mut rest) = content.split_at(start);
    let mut line = 1 + before.iter().filter(|&&b| b == b'\n').count();
    loop {
        match rest {
            [b'\r', tail @ ..] => rest = tail,
            [b'\n', tail @ ..] => {
                line += 1;
                rest = tail;
            }
            [COMMENT, ..] => {
                let end = rest.iter().position(|&b| b == b'\n').unwrap_or(rest.len());
                rest = rest.get(end..).unwrap_or_default();
            }
            _ => return line,
        }
    }
}

/// Text from a file, fit for a terminal: short, and without control characters.
fn shown(text: &str) -> String {
    const MOST: usize = 200;
    let mut short: String = text
        .chars()
        .take(MOST)
        .flat_map(char::escape_debug)
        .collect();
    if text.chars().nth(MOST).is_some() {
        short.push('…');
    }
    short
}

impl Row<'_> {
    /// The text of a field.
    pub(crate) fn text(&self, column: Column<'_>) -> &str {
        self.fields.get(column.index).unwrap_or_default()
    }

    /// Checks that the line has as many fields as the header.
    pub(crate) fn check_length(&self) -> Result<()> {
        let (found, wanted) = (self.fields.len(), self.table.headers.len());
        if found == wanted {
            return Ok(());
        }
        Err(bad_input!(
            "{}: line {}: {found} fields instead of {wanted}",
            self.table.path,
            self.line
        ))
    }

    /// A finite number.
    pub(crate) fn number(&self, column: Column<'_>) -> Result<f64> {
        let text = self.text(column);
        match text.parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(value),
            Ok(_) => Err(self.complain(column, &format!("is {text}, not a finite number"))),
            Err(_) if text.is_empty() => Err(self.complain(column, "is empty")),
            Err(_) => Err(self.complain(column, &format!("is '{}', not a number", shown(text)))),
        }
    }

    /// An error about one field of this line.
    pub(crate) fn complain(&self, column: Column<'_>, what: &str) -> anyhow::Error {
        bad_input!(
            "{}: line {}: {} {what}",
            self.table.path,
            self.line,
            self.table.names.in_file(column.name)
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_counted_as_an_editor_counts_them() {
        for (content, lines) in [
            ("a,b\n1,2\n3,4\n", vec![2, 3]),
            ("a,b\r\n1,2\r\n3,4", vec![2, 3]),
            ("a,b\n\n1,2\n# note\n\n3,4\n", vec![3, 6]),
            ("a,b\r\n\r\n# note\r\n1,2\r\n", vec![4]),
            ("# first\na,b\n1,2\n", vec![3]),
        ] {
            let found: Vec<usize> = reader(content.as_bytes())
                .records()
                .map(|r| line_at(content.as_bytes(), r.unwrap().position().unwrap().byte()))
                .collect();
            assert_eq!(found, lines, "{content:?}");
        }
    }

    #[test]
    fn what_is_shown_of_a_file_is_short_and_harmless() {
        assert_eq!(shown("a\u{1b}[31m\0"), "a\\u{1b}[31m\\0");
        assert!(shown(&"x".repeat(100_000)).chars().count() <= 201);
    }
}
