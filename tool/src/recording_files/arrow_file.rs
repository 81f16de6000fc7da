//! Writes a table to a file in the Arrow IPC format (Feather), for pandas, Polars, DuckDB and others.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufWriter};
use std::sync::Arc;

use arrow_array::builder::{Float64Builder, Int32Builder, TimestampNanosecondBuilder, UInt16Builder};
use arrow_array::{ArrayRef, RecordBatch};
use arrow_ipc::CompressionType;
use arrow_ipc::writer::{FileWriter, IpcWriteOptions};
use arrow_schema::{ArrowError, DataType, Field, Schema, SchemaRef, TimeUnit};

use super::table::{Column, Format, Head, Row, Type};

/// The number of rows in a batch; each batch is compressed separately. \[OURS] With the 200 columns of 40 axes a batch
/// takes a few megabytes.
const BATCH: usize = 4096;
/// The time zone for times of the real clock.
const UTC: &str = "UTC";

/// A table in an Arrow IPC file.
pub struct ArrowFile {
    /// The file until [`Format::begin`], which sets the columns; `None` after that.
    file: Option<File>,
    open: Option<Open>,
}

struct Open {
    writer: FileWriter<BufWriter<File>>,
    schema: SchemaRef,
    times: TimestampNanosecondBuilder,
    seconds: Float64Builder,
    columns: Vec<Numbers>,
    rows: usize,
}

/// The values of a column in the present batch.
enum Numbers {
    I32(Int32Builder),
    U16(UInt16Builder),
    Percent(Float64Builder),
}

impl ArrowFile {
    /// Creates a table without rows.
    pub fn new(file: File) -> Self {
        Self { file: Some(file), open: None }
    }
}

impl Format for ArrowFile {
    fn begin(&mut self, head: &Head) -> io::Result<()> {
        let Some(file) = self.file.take() else { return Ok(()) };
        let time_zone = (!head.is_virtual).then(|| UTC.into());
        let time = DataType::Timestamp(TimeUnit::Nanosecond, time_zone.clone());
        let mut fields = vec![
            field("time", time, false, "the time of the report"),
            field("time_s", DataType::Float64, false, "the time since the first frame of the recording, s"),
        ];
        let mut columns = Vec::new();
        for group in head.groups {
            for column in group.part.columns() {
                let name = match group.slave {
                    0 => column.name.to_owned(),
                    slave => format!("{slave}_{}", column.name),
                };
                let numbers = Numbers::new(column);
                fields.push(field(&name, numbers.data_type(), true, column.about));
                columns.push(numbers);
            }
        }
        let clock = if head.is_virtual { "virtual" } else { "real" };
        let link = head.link.clone().map(|link| ("link".to_owned(), link));
        let about: BTreeMap<String, String> =
            link.into_iter().chain([("clock".to_owned(), clock.to_owned())]).collect();
        let schema = Arc::new(Schema::new_with_metadata(fields, about));
        let options = IpcWriteOptions::default().try_with_compression(Some(CompressionType::ZSTD)).map_err(io_error)?;
        let writer = FileWriter::try_new_with_options(BufWriter::new(file), &schema, options).map_err(io_error)?;
        let times = TimestampNanosecondBuilder::new().with_timezone_opt(time_zone);
        let seconds = Float64Builder::new();
        self.open = Some(Open { writer, schema, times, seconds, columns, rows: 0 });
        Ok(())
    }

    fn row(&mut self, row: &Row) -> io::Result<()> {
        let Some(open) = &mut self.open else { return Ok(()) };
        open.times.append_value(i64::try_from(row.at_ns).unwrap_or(i64::MAX));
        open.seconds.append_value(row.time_ns as f64 / 1e9);
        for (numbers, value) in open.columns.iter_mut().zip(row.values) {
            numbers.add(*value);
        }
        open.rows += 1;
        if open.rows == BATCH { open.write() } else { Ok(()) }
    }

    fn finish(&mut self, lacks: Option<String>) -> io::Result<()> {
        let Some(mut open) = self.open.take() else { return Ok(()) };
        if open.rows > 0 {
            open.write()?;
        }
        if let Some(lacks) = lacks {
            open.writer.write_metadata("lacks", lacks);
        }
        open.writer.finish().map_err(io_error)
    }
}

impl Open {
    fn write(&mut self) -> io::Result<()> {
        let times: [ArrayRef; 2] = [Arc::new(self.times.finish()), Arc::new(self.seconds.finish())];
        let columns = self.columns.iter_mut().map(Numbers::finish);
        let arrays: Vec<ArrayRef> = times.into_iter().chain(columns).collect();
        let batch = RecordBatch::try_new(Arc::clone(&self.schema), arrays).map_err(io_error)?;
        self.rows = 0;
        self.writer.write(&batch).map_err(io_error)
    }
}

impl Numbers {
    fn new(column: &Column) -> Self {
        match column.ty {
            Type::I32 => Self::I32(Int32Builder::new()),
            Type::U16 => Self::U16(UInt16Builder::new()),
            Type::Percent => Self::Percent(Float64Builder::new()),
        }
    }

    const fn data_type(&self) -> DataType {
        match self {
            Self::I32(_) => DataType::Int32,
            Self::U16(_) => DataType::UInt16,
            Self::Percent(_) => DataType::Float64,
        }
    }

    fn add(&mut self, value: Option<i64>) {
        match self {
            Self::I32(numbers) => numbers.append_option(value.and_then(|value| value.try_into().ok())),
            Self::U16(numbers) => numbers.append_option(value.and_then(|value| value.try_into().ok())),
            Self::Percent(numbers) => numbers.append_option(value.map(|value| value as f64 / 10.0)),
        }
    }

    fn finish(&mut self) -> ArrayRef {
        match self {
            Self::I32(numbers) => Arc::new(numbers.finish()),
            Self::U16(numbers) => Arc::new(numbers.finish()),
            Self::Percent(numbers) => Arc::new(numbers.finish()),
        }
    }
}

fn field(name: &str, data_type: DataType, is_nullable: bool, about: &str) -> Field {
    Field::new(name, data_type, is_nullable).with_metadata([("about", about)])
}

fn io_error(error: ArrowError) -> io::Error {
    match error {
        ArrowError::IoError(_, error) => error,
        error => io::Error::other(error),
    }
}
