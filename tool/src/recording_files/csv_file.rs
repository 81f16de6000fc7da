//! Writes a table as CSV: a line with the names of the columns, and a line for each row.

use std::fs::File;
use std::io::{self, BufWriter, Write};

use super::table::{Format, Head, Row, Type};

/// A table in a CSV file.
pub struct CsvFile {
    out: BufWriter<File>,
    types: Vec<Type>,
}

impl CsvFile {
    /// Creates a table without rows.
    pub fn new(file: File) -> Self {
        Self { out: BufWriter::new(file), types: Vec::new() }
    }
}

impl Format for CsvFile {
    fn begin(&mut self, head: &Head) -> io::Result<()> {
        write!(self.out, "time_s")?;
        for group in head.groups {
            for column in group.part.columns() {
                match group.slave {
                    0 => write!(self.out, ",{}", column.name)?,
                    slave => write!(self.out, ",{slave}_{}", column.name)?,
                }
                self.types.push(column.ty);
            }
        }
        writeln!(self.out)
    }

    fn row(&mut self, row: &Row) -> io::Result<()> {
        write!(self.out, "{:.9}", row.time_ns as f64 / 1e9)?;
        for (value, ty) in row.values.iter().zip(&self.types) {
            match (value, ty) {
                (None, _) => write!(self.out, ",")?,
                (Some(value), Type::Percent) => write!(self.out, ",{}", *value as f64 / 10.0)?,
                (Some(value), Type::I32 | Type::U16) => write!(self.out, ",{value}")?,
            }
        }
        writeln!(self.out)
    }

    fn finish(&mut self, _: Option<String>) -> io::Result<()> {
        self.out.flush()
    }
}
