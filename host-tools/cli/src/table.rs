//! CSV files, read with messages that name file, line and column.

use crate::error::bad_input;
use anyhow::Result;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// Other names for columns: `wanted=in the file`, separated by commas.
#[derive(Clone, Debug, Default)]
pub(crate) struct ColumnNames(BTreeMap<String, String>);

impl FromStr for ColumnNames {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        text.split(',')
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

/// A CSV file with a header line.
pub(crate) struct Table {
    path: PathBuf,
    names: ColumnNames,
    headers: csv::StringRecord,
    reader: csv::Reader<std::fs::File>,
}

/// One line of a [`Table`].
pub(crate) struct Row<'a> {
    pub(crate) line: u64,
    table: &'a Location<'a>,
    fields: csv::StringRecord,
}

struct Location<'a> {
    path: &'a Path,
    names: &'a ColumnNames,
}

/// A column that a [`Table`] has.
#[derive(Clone, Copy)]
pub(crate) struct Column<'a> {
    name: &'a str,
    index: usize,
}

impl Table {
    /// Opens a file and reads its header.
    pub(crate) fn open(path: &Path, names: &ColumnNames) -> Result<Self> {
        let mut reader = csv::ReaderBuilder::new()
            .trim(csv::Trim::All)
            .comment(Some(b'#'))
            .from_path(path)
            .map_err(|error| bad_input!("{}: cannot be read: {error}", path.display()))?;
        let headers = reader
            .headers()
            .map_err(|error| bad_input!("{}: cannot be read: {error}", path.display()))?
            .clone();
        if headers.is_empty() {
            return Err(bad_input!(
                "{}: the file is empty; the first line must name the columns",
                path.display()
            ));
        }
        Ok(Self {
            path: path.to_owned(),
            names: names.clone(),
            headers,
            reader,
        })
    }

    /// The column called `wanted`, or what that is called here, if there is one.
    pub(crate) fn find<'a>(&self, wanted: &'a str) -> Option<Column<'a>> {
        let name = self.names.in_file(wanted);
        let index = self.headers.iter().position(|header| header == name)?;
        Some(Column {
            name: wanted,
            index,
        })
    }

    /// The column called `wanted`.
    pub(crate) fn require<'a>(&self, wanted: &'a str) -> Result<Column<'a>> {
        self.find(wanted).ok_or_else(|| {
            let name = self.names.in_file(wanted);
            let present = self.headers.iter().collect::<Vec<_>>().join(", ");
            bad_input!(
                "{}: line 1: there is no column '{name}' (found: {present}); \
                 --columns {wanted}=NAME tells what it is called here",
                self.path.display()
            )
        })
    }

    /// Hands each line to `take`; stops at the first error.
    pub(crate) fn for_each(mut self, mut take: impl FnMut(&Row<'_>) -> Result<()>) -> Result<u64> {
        let location = Location {
            path: &self.path,
            names: &self.names,
        };
        let mut rows = 0;
        for fields in self.reader.records() {
            let fields = fields.map_err(|error| match error.position() {
                Some(at) => bad_input!(
                    "{}: line {}: {}",
                    self.path.display(),
                    at.line(),
                    reason(&error)
                ),
                None => bad_input!("{}: {error}", self.path.display()),
            })?;
            rows += 1;
            take(&Row {
                line: fields.position().map_or(0, csv::Position::line),
                table: &location,
                fields,
            })?;
        }
        if rows == 0 {
            return Err(bad_input!(
                "{}: there are no lines after the header",
                self.path.display()
            ));
        }
        Ok(rows)
    }
}

fn reason(error: &csv::Error) -> String {
    match error.kind() {
        csv::ErrorKind::UnequalLengths {
            expected_len, len, ..
        } => format!("{len} fields instead of {expected_len}"),
        csv::ErrorKind::Utf8 { .. } => "not text (invalid UTF-8)".to_owned(),
        _ => error.to_string(),
    }
}

impl Row<'_> {
    /// The text of a field.
    pub(crate) fn text(&self, column: Column<'_>) -> &str {
        self.fields.get(column.index).unwrap_or_default()
    }

    /// A finite number.
    pub(crate) fn number(&self, column: Column<'_>) -> Result<f64> {
        let text = self.text(column);
        match text.parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(value),
            Ok(_) => Err(self.complain(column, &format!("is {text}, not a finite number"))),
            Err(_) if text.is_empty() => Err(self.complain(column, "is empty")),
            Err(_) => Err(self.complain(column, &format!("is '{text}', not a number"))),
        }
    }

    /// An error about one field of this line.
    pub(crate) fn complain(&self, column: Column<'_>, what: &str) -> anyhow::Error {
        bad_input!(
            "{}: line {}: {} {what}",
            self.table.path.display(),
            self.line,
            self.table.names.in_file(column.name)
        )
    }
}
