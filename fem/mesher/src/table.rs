//! Tables of the thigh as text: a header, then rows whose cells go by the names of their columns.

use std::collections::HashMap;
use std::io::Cursor;
use std::path::Path;

use nalgebra::Vector3;

use fem::mesh::{MeshError, Place};

/// What is wrong on a line of a file, and how to mend it.
pub(super) fn bad(file: &Path, line: usize, reason: String) -> MeshError {
    MeshError::Format { file: file.into(), place: Place::Line(line), reason }
}

/// A table whose header has been read.
pub(super) struct Table<'a> {
    file: &'a Path,
    header: csv::StringRecord,
    columns: HashMap<String, usize>,
    reader: csv::Reader<Cursor<String>>,
}

/// One row.
pub(super) struct Row<'a> {
    file: &'a Path,
    columns: &'a HashMap<String, usize>,
    /// Its line in the file.
    pub line: usize,
    /// Its cells.
    pub cells: csv::StringRecord,
}

impl<'a> Table<'a> {
    /// `file` is the name for messages. Cells are trimmed.
    pub fn read(text: &str, file: &'a Path) -> Result<Table<'a>, MeshError> {
        // After a return the reader counts the next row as of the line before.
        let text = Cursor::new(text.replace("\r\n", "\n"));
        let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(text);
        let header = reader.headers().map_err(|e| bad(file, 1, e.to_string()))?.clone();
        let columns = header.iter().enumerate().map(|(i, name)| (name.to_string(), i)).collect();
        Ok(Table { file, header, columns, reader })
    }

    /// Names of the columns.
    pub fn header(&self) -> &csv::StringRecord {
        &self.header
    }

    /// Refuses a table that lacks one of these columns.
    pub fn require(&self, columns: &[&str]) -> Result<(), MeshError> {
        match columns.iter().find(|c| !self.columns.contains_key(**c)) {
            Some(missing) => Err(missing_column(self.file, missing)),
            None => Ok(()),
        }
    }

    /// The rows in their order; an error where one is not a row of the table.
    pub fn rows(&mut self) -> impl Iterator<Item = Result<Row<'_>, MeshError>> {
        let (file, columns) = (self.file, &self.columns);
        self.reader.records().map(move |record| match record {
            Ok(cells) => {
                let line = cells.position().map_or(0, |p| p.line() as usize);
                Ok(Row { file, columns, line, cells })
            }
            Err(e) => {
                let line = e.position().map_or(1, |p| p.line() as usize);
                Err(bad(file, line, format!("not a row of the table: {e}")))
            }
        })
    }
}

impl Row<'_> {
    /// Text of a column that the table must have.
    pub fn cell(&self, name: &str) -> Result<&str, MeshError> {
        let column = self.columns.get(name).ok_or_else(|| missing_column(self.file, name))?;
        Ok(self.cells.get(*column).unwrap_or_default())
    }

    /// Text of a column that the table may lack.
    pub fn optional(&self, name: &str) -> Option<&str> {
        self.columns.get(name).and_then(|column| self.cells.get(*column))
    }

    /// A finite number.
    pub fn number(&self, name: &str) -> Result<f64, MeshError> {
        let text = self.cell(name)?;
        let value = text.parse().ok().filter(|v: &f64| v.is_finite());
        value.ok_or_else(|| self.bad(format!("{name} is `{text}`; give a finite number")))
    }

    /// Three finite numbers.
    pub fn vector(&self, names: [&str; 3]) -> Result<Vector3<f64>, MeshError> {
        let [x, y, z] = names;
        Ok(Vector3::new(self.number(x)?, self.number(y)?, self.number(z)?))
    }

    /// What is wrong with this row.
    pub fn bad(&self, reason: String) -> MeshError {
        bad(self.file, self.line, reason)
    }
}

fn missing_column(file: &Path, name: &str) -> MeshError {
    bad(file, 1, format!("column `{name}` is missing"))
}
