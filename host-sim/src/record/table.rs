//! The flights of a suite as a table, one row each: CSV, and Parquet for pandas, polars and others
//! (`docs/simulator.md`).
//!
//! Parquet is written by Apache's own crate without its Arrow half and without compression: a flight takes about a
//! hundred bytes. A missing number is an empty field, and a null.

use std::sync::Arc;

use parquet::basic::{LogicalType, Repetition, Type as Physical};
use parquet::data_type::{ByteArray, ByteArrayType, DoubleType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::{SerializedColumnWriter, SerializedFileWriter};
use parquet::schema::types::Type;

use crate::drive::flight::Ending;
use crate::drive::suite::Flown;

/// A column.
#[derive(Clone, Copy, Debug)]
pub struct Column {
    /// Its name.
    pub name: &'static str,
    /// Its description.
    pub what: &'static str,
    of: Of,
}

/// How a value is read from a flight.
#[derive(Clone, Copy, Debug)]
enum Of {
    Whole(fn(&Flown) -> u64),
    Number(fn(&Flown) -> Option<f64>),
    Text(fn(&Flown) -> &str),
}

/// The values of a column.
#[derive(Clone, Debug, PartialEq)]
pub enum Values<'a> {
    /// Whole numbers.
    Whole(Vec<u64>),
    /// Numbers, or none.
    Number(Vec<Option<f64>>),
    /// Texts.
    Text(Vec<&'a str>),
}

impl Column {
    /// Its values, one for each flight.
    #[must_use]
    pub fn values<'a>(&self, flown: &'a [Flown]) -> Values<'a> {
        match self.of {
            Of::Whole(of) => Values::Whole(flown.iter().map(of).collect()),
            Of::Number(of) => Values::Number(flown.iter().map(of).collect()),
            Of::Text(of) => Values::Text(flown.iter().map(of).collect()),
        }
    }
}

const fn column(name: &'static str, what: &'static str, of: Of) -> Column {
    Column { name, what, of }
}

/// The columns, in their order.
pub const COLUMNS: [Column; 14] = [
    column("row", "the map's row", Of::Whole(|flown| flown.place.row.into())),
    column("instance", "the map's number in its row", Of::Whole(|flown| flown.place.instance.into())),
    column("pair", "the pair's number on its map, from 0", Of::Whole(|flown| flown.place.pair.into())),
    column("seed", "the flight's own seed", Of::Whole(|flown| flown.seed)),
    column("result", "`reached`, `hold`, `collision` or `timeout`", Of::Text(result)),
    column("reason", "the outcome that explains it", Of::Text(|flown| &flown.reason)),
    column("time_s", "duration of the flight", Of::Number(|flown| Some(flown.time_s))),
    column("path_length_m", "length of the path flown", Of::Number(|flown| Some(flown.path_length_m))),
    column("reference_length_m", "length of the reference path", Of::Number(|flown| Some(flown.reference_length_m))),
    column(
        "length_ratio",
        "path flown over reference path; empty without a reference",
        Of::Number(|flown| flown.length_ratio),
    ),
    column(
        "min_clearance_m",
        "least distance between hull and pillars; empty without pillars",
        Of::Number(|flown| flown.min_clearance_m),
    ),
    column("replans", "plans made", Of::Whole(|flown| flown.replans.into())),
    column(
        "bearing_rms_deg",
        "error of the valid bearings, rms; empty without any",
        Of::Number(|flown| flown.bearing_rms_deg),
    ),
    column("trace_hash", "hash over every bearing, plan and setpoint", Of::Text(|flown| &flown.trace_hash)),
];

const fn result(flown: &Flown) -> &str {
    match flown.result {
        Ending::Reached => "reached",
        Ending::Hold => "hold",
        Ending::Collision => "collision",
        Ending::Timeout => "timeout",
        Ending::Interrupted => "interrupted",
    }
}

/// The table as CSV, with a line of names.
#[must_use]
pub fn csv(flown: &[Flown]) -> String {
    let mut text = COLUMNS.map(|column| column.name).join(",") + "\n";
    for flight in flown {
        // Names and hashes need no quotes.
        let fields = COLUMNS.map(|column| match column.of {
            Of::Whole(of) => of(flight).to_string(),
            Of::Number(of) => of(flight).map_or_else(String::new, |number| number.to_string()),
            Of::Text(of) => of(flight).to_owned(),
        });
        text += &fields.join(",");
        text.push('\n');
    }
    text
}

/// The table as a Parquet file.
///
/// # Errors
/// A value that a table with these columns cannot have.
pub fn parquet(flown: &[Flown]) -> Result<Vec<u8>, ParquetError> {
    let fields: Result<Vec<_>, ParquetError> = COLUMNS.iter().map(|column| field(column).map(Arc::new)).collect();
    let schema = Type::group_type_builder("flights").with_fields(fields?).build()?;
    let properties =
        WriterProperties::builder().set_created_by(concat!("foxhound ", env!("CARGO_PKG_VERSION")).to_owned()).build();
    let mut bytes = Vec::new();
    let mut file = SerializedFileWriter::new(&mut bytes, Arc::new(schema), Arc::new(properties))?;
    let mut rows = file.next_row_group()?;
    for column in COLUMNS {
        if let Some(mut writer) = rows.next_column()? {
            fill(&mut writer, column, flown)?;
            writer.close()?;
        }
    }
    rows.close()?;
    file.close()?;
    Ok(bytes)
}

fn field(column: &Column) -> Result<Type, ParquetError> {
    let (physical, repetition) = match column.of {
        Of::Whole(_) => (Physical::INT64, Repetition::REQUIRED),
        Of::Number(_) => (Physical::DOUBLE, Repetition::OPTIONAL),
        Of::Text(_) => (Physical::BYTE_ARRAY, Repetition::REQUIRED),
    };
    let logical = matches!(column.of, Of::Text(_)).then_some(LogicalType::String);
    Type::primitive_type_builder(column.name, physical).with_repetition(repetition).with_logical_type(logical).build()
}

fn fill(writer: &mut SerializedColumnWriter<'_>, column: Column, flown: &[Flown]) -> Result<(), ParquetError> {
    match column.values(flown) {
        Values::Whole(values) => {
            let values: Vec<i64> = values.into_iter().map(u64::cast_signed).collect();
            writer.typed::<Int64Type>().write_batch(&values, None, None)?;
        }
        Values::Number(all) => {
            let values: Vec<f64> = all.iter().flatten().copied().collect();
            let is_there: Vec<i16> = all.iter().map(|value| value.is_some().into()).collect();
            writer.typed::<DoubleType>().write_batch(&values, Some(&is_there), None)?;
        }
        Values::Text(values) => {
            let values: Vec<ByteArray> = values.into_iter().map(ByteArray::from).collect();
            writer.typed::<ByteArrayType>().write_batch(&values, None, None)?;
        }
    }
    Ok(())
}
