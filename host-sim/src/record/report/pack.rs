//! Packs records for a page: as columns of whole numbers, compressed.
//!
//! Nothing is lost: unpacked, every record equals the one that went in, except that a missing number and `null` are the same.
//!
//! The records of a kind are a table. Its shape is learned from them: which fields there are, which of them may be
//! missing, and with how many decimal places every number is exact; that is its resolution, in the unit that the
//! field's name ends in. A number becomes a whole number of that resolution, a text its place in a list of all
//! texts. Every leaf of the shape is a column, and so are the lengths of lists and the presence of fields that may be missing:
//!
//! | node of the shape | columns, in this order | in the header |
//! |---|---|---|
//! | number | its values | `{"number": places}` |
//! | boolean | 0 or 1 | `{"flag": 0}` |
//! | text | its place in the list | `{"text": [...]}` |
//! | a few numbers, always as many | those of each | `{"tuple": [...]}` |
//! | list | its lengths; those of its elements | `{"list": ...}` |
//! | object | of each field: 1 where it is present, if it may be missing; its own | `{"fields": [[name, may be missing, ...], ...]}` |
//!
//! In a column the difference to the value some places before replaces each value, once for every one of the column's `lags`;
//! differences are zigzag LEB128. The whole is a line of JSON and the bytes of all columns, as gzip, as Base64.

use std::collections::BTreeMap;
use std::io::{self, Write as _};

use base64::prelude::{BASE64_STANDARD, Engine as _};
use flate2::Compression;
use flate2::write::GzEncoder;
use serde_json::{Map, Value, json};

use super::record::Record;

/// Decimal places of the finest number.
const PLACES_MAX: i32 = 7;
/// Longest list of numbers whose elements have columns of their own.
const TUPLE_MAX: usize = 4;

/// The text that a page holds.
///
/// # Errors
/// None that is known: the bytes are written to memory.
pub(super) fn pack(records: &[Record]) -> io::Result<String> {
    let mut tables: BTreeMap<String, Table> = BTreeMap::new();
    let (mut first, mut last) = (Vec::new(), Vec::new());
    for record in records {
        let value = serde_json::to_value(record)?;
        match record {
            Record::Begin(_) => first.push(value),
            Record::Thinned(_) | Record::End(_) => last.push(value),
            _ => tables.entry(kind(&value)).or_default().shape.learn(&value),
        }
    }
    for table in tables.values_mut() {
        table.shape.settle();
        table.columns = vec![Column::default(); table.shape.columns()];
    }
    for record in records {
        let value = serde_json::to_value(record)?;
        if let Some(table) = tables.get_mut(&kind(&value)) {
            table.rows += 1;
            table.shape.shred(&value, &mut table.columns, 0);
        }
    }
    let mut bytes = Vec::new();
    let mut heads = Vec::new();
    for (kind, mut table) in tables {
        let mut columns = Vec::new();
        table.shape.group(&mut table.columns, 0, None);
        for column in &table.columns {
            let lags = column.lags();
            column.write(lags, &mut bytes);
            columns.push(json!({ "count": column.values.len(), "lags": lags.iter().filter(|lag| **lag > 0).collect::<Vec<_>>() }));
        }
        heads.push(json!({ "kind": kind, "rows": table.rows, "shape": table.shape.head(), "columns": columns }));
    }
    let head = json!({ "first": first, "tables": heads, "last": last });
    let mut gzip = GzEncoder::new(Vec::new(), Compression::best());
    gzip.write_all(head.to_string().as_bytes())?;
    gzip.write_all(b"\n")?;
    gzip.write_all(&bytes)?;
    Ok(BASE64_STANDARD.encode(&gzip.finish()?))
}

fn kind(value: &Value) -> String {
    value.get("kind").and_then(Value::as_str).unwrap_or_default().to_owned()
}

/// The records of a kind.
#[derive(Default)]
struct Table {
    rows: usize,
    shape: Shape,
    columns: Vec<Column>,
}

/// What values of a place look like.
#[derive(Default)]
enum Shape {
    /// None was seen.
    #[default]
    Nothing,
    /// Decimal places.
    Number(i32),
    Flag,
    /// All texts, in the order in which they came.
    Text(Vec<String>, BTreeMap<String, usize>),
    Tuple(Vec<Self>),
    List(Box<Self>),
    /// Name, how often, and shape of each field; how often the object.
    Fields(Vec<(String, usize, Self)>, usize),
}

impl Shape {
    /// Takes a value into account.
    fn learn(&mut self, value: &Value) {
        match value {
            Value::Null => {}
            Value::Bool(_) => *self = Self::Flag,
            Value::Number(number) => {
                let needed = places(number.as_f64().unwrap_or_default());
                *self = Self::Number(if let Self::Number(places) = self { needed.max(*places) } else { needed });
            }
            Value::String(text) => {
                if !matches!(self, Self::Text(..)) {
                    *self = Self::Text(Vec::new(), BTreeMap::new());
                }
                if let Self::Text(list, places) = self
                    && !places.contains_key(text)
                {
                    places.insert(text.clone(), list.len());
                    list.push(text.clone());
                }
            }
            Value::Array(elements) => self.learn_list(elements),
            Value::Object(fields) => self.learn_fields(fields),
        }
    }

    fn learn_list(&mut self, elements: &[Value]) {
        let is_tuple = (2..=TUPLE_MAX).contains(&elements.len()) && elements.iter().all(Value::is_number);
        match self {
            Self::Nothing if is_tuple => *self = Self::Tuple(elements.iter().map(|_| Self::Nothing).collect()),
            Self::Tuple(parts) if is_tuple && parts.len() == elements.len() => {}
            Self::List(_) => {}
            Self::Tuple(parts) => {
                // What was learned of the parts holds for the elements.
                let places = parts.iter().map(|part| if let Self::Number(places) = part { *places } else { 0 });
                *self = Self::List(Box::new(Self::Number(places.max().unwrap_or(0))));
            }
            _ => *self = Self::List(Box::default()),
        }
        match self {
            Self::Tuple(parts) => parts.iter_mut().zip(elements).for_each(|(part, element)| part.learn(element)),
            Self::List(each) => elements.iter().for_each(|element| each.learn(element)),
            _ => {}
        }
    }

    fn learn_fields(&mut self, fields: &Map<String, Value>) {
        if !matches!(self, Self::Fields(..)) {
            *self = Self::Fields(Vec::new(), 0);
        }
        let Self::Fields(known, times) = self else { return };
        *times += 1;
        for (name, value) in fields.iter().filter(|(name, value)| *name != "kind" && !value.is_null()) {
            let at = known.iter().position(|field| field.0 == *name).unwrap_or_else(|| {
                known.push((name.clone(), 0, Self::Nothing));
                known.len() - 1
            });
            if let Some((_, present, shape)) = known.get_mut(at) {
                *present += 1;
                shape.learn(value);
            }
        }
    }

    /// After all values: of each field only whether it may be missing is of interest.
    fn settle(&mut self) {
        match self {
            Self::Fields(fields, times) => {
                for (_, present, shape) in fields {
                    *present = usize::from(*present < *times);
                    shape.settle();
                }
            }
            Self::List(each) => each.settle(),
            _ => {}
        }
    }

    /// Number of columns.
    fn columns(&self) -> usize {
        match self {
            Self::Nothing => 0,
            Self::Number(_) | Self::Flag | Self::Text(..) => 1,
            Self::Tuple(parts) => parts.iter().map(Self::columns).sum(),
            Self::List(each) => 1 + each.columns(),
            Self::Fields(fields, _) => fields.iter().map(|(_, missing, shape)| missing + shape.columns()).sum(),
        }
    }

    /// Puts a value into the columns from `at` on.
    fn shred(&self, value: &Value, columns: &mut [Column], at: usize) {
        let mut put = |number: i64| {
            if let Some(column) = columns.get_mut(at) {
                column.values.push(number);
            }
        };
        match self {
            Self::Nothing => {}
            Self::Number(places) => put(whole(value.as_f64().unwrap_or_default(), *places)),
            Self::Flag => put(i64::from(value.as_bool().unwrap_or_default())),
            Self::Text(_, places) => {
                put(value.as_str().and_then(|text| places.get(text)).map_or(0, |place| *place as i64));
            }
            Self::Tuple(parts) => {
                for (part, (shape, element)) in parts.iter().zip(value.as_array().into_iter().flatten()).enumerate() {
                    shape.shred(element, columns, at + part);
                }
            }
            Self::List(each) => {
                let elements = value.as_array().map(Vec::as_slice).unwrap_or_default();
                put(elements.len() as i64);
                elements.iter().for_each(|element| each.shred(element, columns, at + 1));
            }
            Self::Fields(fields, _) => {
                let mut at = at;
                for (name, missing, shape) in fields {
                    let value = value.get(name).filter(|value| !value.is_null());
                    if *missing > 0 {
                        if let Some(column) = columns.get_mut(at) {
                            column.values.push(i64::from(value.is_some()));
                        }
                        at += 1;
                    }
                    if let Some(value) = value {
                        shape.shred(value, columns, at);
                    }
                    at += shape.columns();
                }
            }
        }
    }

    /// Tells the columns how long the lists are of whose elements they are, where all are as long.
    fn group(&self, columns: &mut [Column], at: usize, length: Option<usize>) {
        match self {
            Self::Nothing => {}
            Self::Number(_) | Self::Flag | Self::Text(..) => {
                if let Some(column) = columns.get_mut(at) {
                    column.group = length;
                }
            }
            Self::Tuple(parts) => {
                for (part, shape) in parts.iter().enumerate() {
                    shape.group(columns, at + part, length);
                }
            }
            Self::List(each) => {
                let lengths = columns.get(at).map(|column| column.values.as_slice()).unwrap_or_default();
                let same = lengths.first().filter(|first| lengths.iter().all(|length| length == *first));
                let same = same.and_then(|length| usize::try_from(*length).ok());
                each.group(columns, at + 1, same);
            }
            Self::Fields(fields, _) => {
                let mut at = at;
                for (_, missing, shape) in fields {
                    at += missing;
                    shape.group(columns, at, length);
                    at += shape.columns();
                }
            }
        }
    }

    fn head(&self) -> Value {
        match self {
            Self::Nothing => json!({ "nothing": 0 }),
            Self::Number(places) => json!({ "number": places }),
            Self::Flag => json!({ "flag": 0 }),
            Self::Text(list, _) => json!({ "text": list }),
            Self::Tuple(parts) => json!({ "tuple": parts.iter().map(Self::head).collect::<Vec<_>>() }),
            Self::List(each) => json!({ "list": each.head() }),
            Self::Fields(fields, _) => {
                let head = |(name, missing, shape): &(String, usize, Self)| json!([name, missing, shape.head()]);
                json!({ "fields": fields.iter().map(head).collect::<Vec<_>>() })
            }
        }
    }
}

/// Decimal places with which a number is exact.
fn places(number: f64) -> i32 {
    let is_exact = |places: &i32| {
        let scale = libm::pow(10.0, f64::from(*places));
        whole(number, *places) as f64 / scale == number
    };
    (0..PLACES_MAX).find(is_exact).unwrap_or(PLACES_MAX)
}

fn whole(number: f64, places: i32) -> i64 {
    libm::rint(number * libm::pow(10.0, f64::from(places))) as i64
}

/// Whole numbers.
#[derive(Clone, Default)]
struct Column {
    values: Vec<i64>,
    /// Length of the lists of whose elements it is.
    group: Option<usize>,
}

/// Distances to the earlier value of each difference; 0: no difference.
type Lags = [usize; 2];

impl Column {
    /// The lags with the smallest differences.
    fn lags(&self) -> Lags {
        let mut trials = vec![[0, 0], [1, 0], [1, 1]];
        if let Some(length) = self.group.filter(|length| *length > 1) {
            trials.extend([[length, 0], [length, 1]]);
            // A raster: the difference to the row before.
            let side = length.isqrt();
            if side > 1 && side * side == length {
                trials.push([side, 1]);
            }
        }
        let bits = |lags: &Lags| self.differences(*lags).iter().map(|value| u64::from(2 * value.ilog2())).sum::<u64>();
        trials.into_iter().min_by_key(bits).unwrap_or_default()
    }

    /// Differences, as positive numbers: zigzag, and one more.
    fn differences(&self, lags: Lags) -> Vec<u64> {
        let mut values = self.values.clone();
        for lag in lags.into_iter().filter(|lag| *lag > 0) {
            for at in (lag..values.len()).rev() {
                values[at] = values[at].wrapping_sub(values[at - lag]);
            }
        }
        values.into_iter().map(|value| ((value << 1) ^ (value >> 63)) as u64 + 1).collect()
    }

    fn write(&self, lags: Lags, bytes: &mut Vec<u8>) {
        for value in self.differences(lags) {
            let mut rest = value - 1;
            while rest >= 0x80 {
                bytes.push(rest as u8 | 0x80);
                rest >>= 7;
            }
            bytes.push(rest as u8);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_has_as_many_places_as_it_needs() {
        assert_eq!([0.0, 12.0, -0.5, 1.234, 0.00001].map(places), [0, 0, 1, 3, 5]);
        assert_eq!((whole(-1.234, 3), whole(1e6, 0)), (-1234, 1_000_000));
    }

    #[test]
    fn smooth_columns_become_small_differences() {
        let column = |values: Vec<i64>| Column { values, group: None };
        assert_eq!(column(vec![5; 100]).lags(), [1, 0]);
        assert_eq!(column((0..100).map(|x| x * x).collect()).lags(), [1, 1]);
        // A bowl on a raster: its rows differ by a constant.
        let bowl = (0..9_i64).flat_map(|row| (0..9_i64).map(move |column| row * row * 100 + column * column * 70));
        let raster = Column { values: bowl.collect(), group: Some(81) };
        assert_eq!(raster.lags(), [9, 1]);
        let mut bytes = Vec::new();
        column(vec![0, -1, 1, 300]).write([0, 0], &mut bytes);
        assert_eq!(bytes, [0, 1, 2, 0xd8, 0x04]);
    }

    #[test]
    fn lists_of_another_length_and_missing_fields_keep_their_places() {
        let mut shape = Shape::default();
        let rows =
            [json!({ "a": [1, 2], "b": 1.5 }), json!({ "a": [], "c": "x" }), json!({ "a": [1, 2, 3], "b": null })];
        rows.iter().for_each(|row| shape.learn(row));
        shape.settle();
        let head = json!({ "fields": [["a", 0, { "list": { "number": 0 } }], ["b", 1, { "number": 1 }], ["c", 1, { "text": ["x"] }]] });
        assert_eq!(shape.head(), head);
        let mut columns = vec![Column::default(); shape.columns()];
        rows.iter().for_each(|row| shape.shred(row, &mut columns, 0));
        let values: Vec<&[i64]> = columns.iter().map(|column| column.values.as_slice()).collect();
        assert_eq!(values, [&[2, 0, 3][..], &[1, 2, 1, 2, 3], &[1, 0, 0], &[15], &[0, 1, 0], &[0]]);
    }
}
