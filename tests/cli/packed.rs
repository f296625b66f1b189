//! Unpacks the records of a report, after the format in `host-sim/src/record/report/pack.rs`.
#![expect(clippy::panic, clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::collections::VecDeque;
use std::io::Read as _;
use std::iter::repeat_with;

use base64::prelude::{BASE64_STANDARD, Engine as _};
use flate2::read::GzDecoder;
use serde_json::{Map, Value};

/// The values of a column that are still to be read.
type Column = VecDeque<i64>;

/// All records of a page: the header, kind by kind, the end.
pub(crate) fn records(page: &str) -> Vec<Value> {
    let (_, behind) = page.split_once("id=\"records\">").unwrap();
    let (packed, _) = behind.split_once("</script>").unwrap();
    let mut bytes = Vec::new();
    GzDecoder::new(BASE64_STANDARD.decode(packed).unwrap().as_slice()).read_to_end(&mut bytes).unwrap();
    let end = bytes.iter().position(|byte| *byte == b'\n').unwrap();
    let head: Value = serde_json::from_slice(&bytes[..end]).unwrap();
    let mut data = bytes[end + 1..].iter();
    let mut records = list(&head["first"]).to_vec();
    for table in list(&head["tables"]) {
        let mut columns: Vec<Column> = list(&table["columns"])
            .iter()
            .map(|column| {
                let mut values: Vec<i64> = repeat_with(|| number(&mut data)).take(size(&column["count"])).collect();
                for lag in list(&column["lags"]).iter().rev().map(size) {
                    (lag..values.len()).for_each(|at| values[at] += values[at - lag]);
                }
                values.into()
            })
            .collect();
        for _ in 0..size(&table["rows"]) {
            let mut record = read(&table["shape"], &mut columns, 0);
            record["kind"] = table["kind"].clone();
            records.push(record);
        }
        assert!(columns.iter().all(Column::is_empty), "{}", table["kind"]);
    }
    assert_eq!(data.len(), 0);
    records.extend_from_slice(list(&head["last"]));
    records
}

fn list(value: &Value) -> &[Value] {
    value.as_array().unwrap()
}

fn size(value: &Value) -> usize {
    value.as_u64().unwrap() as usize
}

/// A zigzag LEB128 number.
fn number<'a>(data: &mut impl Iterator<Item = &'a u8>) -> i64 {
    let (mut value, mut shift) = (0_u64, 0);
    loop {
        let byte = *data.next().unwrap();
        value |= u64::from(byte & 0x7f) << shift;
        shift += 7;
        if byte < 0x80 {
            return (value >> 1) as i64 ^ -((value & 1) as i64);
        }
    }
}

/// Number of columns of a shape.
fn width(shape: &Value) -> usize {
    let (name, what) = shape.as_object().unwrap().iter().next().unwrap();
    match name.as_str() {
        "nothing" => 0,
        "list" => 1 + width(what),
        "tuple" => list(what).iter().map(width).sum(),
        "fields" => list(what).iter().map(|field| size(&field[1]) + width(&field[2])).sum(),
        _ => 1,
    }
}

/// The next value of a shape, whose columns begin with the one at `at`.
fn read(shape: &Value, columns: &mut [Column], at: usize) -> Value {
    let (name, what) = shape.as_object().unwrap().iter().next().unwrap();
    let mut next = |at: usize| columns[at].pop_front().unwrap();
    match name.as_str() {
        "nothing" => Value::Null,
        "number" if *what == 0 => next(at).into(),
        "number" => (next(at) as f64 / 10_f64.powi(size(what) as i32)).into(),
        "flag" => (next(at) == 1).into(),
        "text" => what[next(at) as usize].clone(),
        "tuple" => list(what).iter().enumerate().map(|(part, shape)| read(shape, columns, at + part)).collect(),
        "list" => (0..next(at)).map(|_| read(what, columns, at + 1)).collect(),
        "fields" => {
            let mut at = at;
            let mut fields = Map::new();
            for field in list(what) {
                let may_miss = size(&field[1]);
                if may_miss == 0 || columns[at].pop_front().unwrap() == 1 {
                    fields.insert(field[0].as_str().unwrap().to_owned(), read(&field[2], columns, at + may_miss));
                }
                at += may_miss + width(&field[2]);
            }
            fields.into()
        }
        _ => panic!("{shape}"),
    }
}

/// Records of which nothing but the order of the kinds, and how a number is held, may differ: kind by kind.
pub(crate) fn by_kind(records: &[Value]) -> Vec<Value> {
    let mut sorted: Vec<Value> = records.iter().map(as_floats).collect();
    sorted.sort_by_key(|record| record["kind"].to_string());
    sorted
}

fn as_floats(value: &Value) -> Value {
    match value {
        Value::Number(number) => number.as_f64().into(),
        Value::Array(all) => all.iter().map(as_floats).collect(),
        Value::Object(fields) => fields.iter().map(|(name, value)| (name.clone(), as_floats(value))).collect(),
        other => other.clone(),
    }
}
