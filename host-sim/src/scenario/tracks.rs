//! Files of real people's tracks.
//!
//! CSV with a line of column names. The columns `time_s`, `person`, `x`, `y` are read, in any order; others are
//! ignored. A person is any text; the times of a person must increase, with lines of others in between allowed. A
//! person with one line is there for no time at all and never appears; a file in which nobody appears is refused.

use std::collections::HashMap;
use std::path::Path;

use csv::{ReaderBuilder, StringRecord, Trim};

use super::input::InputError;
use super::people::Person;

const COLUMNS: [&str; 4] = ["time_s", "person", "x", "y"];

/// The people in the file, in order of appearance, with their names.
///
/// # Errors
/// The file, and the line and the column that are wrong.
pub(crate) fn read(path: &Path) -> Result<Vec<(String, Person)>, InputError> {
    let text = super::input::read_text(path)?;
    parse(&text).map_err(|error| error.in_file(path))
}

fn parse(text: &str) -> Result<Vec<(String, Person)>, InputError> {
    let text = text.trim_start_matches('\u{feff}');
    let mut reader = ReaderBuilder::new().trim(Trim::All).flexible(true).from_reader(text.as_bytes());
    let names = reader.headers().map_err(|error| InputError::new(error.to_string()))?.clone();
    let mut columns = [0; COLUMNS.len()];
    for (at, name) in columns.iter_mut().zip(COLUMNS) {
        let found = names.iter().position(|column| column == name);
        *at = found
            .ok_or_else(|| InputError::new(format!("line 1: no column {name}; required: {}", COLUMNS.join(", "))))?;
    }
    let mut people: Vec<(String, Person)> = Vec::new();
    let mut known: HashMap<String, usize> = HashMap::new();
    for row in reader.records() {
        let row = row.map_err(|error| InputError::new(error.to_string()))?;
        let begins = row.position().map_or(0, |position| position.byte() as usize);
        let row = Row { text, begins, row };
        if row.row.len() > names.len() {
            let (fields, columns) = (row.row.len(), names.len());
            return Err(InputError::new(format!("line {}: {fields} fields, line 1 names {columns}", row.line())));
        }
        let point = [0, 2, 3].map(|column| row.number(columns[column], COLUMNS[column]));
        let [time_s, x, y] = point;
        let (time_s, x, y) = (time_s?, x?, y?);
        let name = row.field(columns[1], COLUMNS[1])?;
        let index = *known.entry(name.to_owned()).or_insert_with(|| {
            people.push((name.to_owned(), Person::default()));
            people.len() - 1
        });
        let track = &mut people[index].1.track;
        if let Some([before_s, ..]) = track.last().filter(|last| last[0] >= time_s) {
            return Err(row.wrong(COLUMNS[0], &format!("{time_s} of {name} is not after {before_s}")));
        }
        track.push([time_s, x, y]);
    }
    people.retain(|(_, person)| person.track.len() > 1);
    if people.is_empty() {
        return Err(InputError::new(
            "nobody appears: a person needs at least two lines, each with a time_s of its own",
        ));
    }
    Ok(people)
}

struct Row<'a> {
    text: &'a str,
    /// Byte of the text at which it begins, or the empty lines before it.
    begins: usize,
    row: StringRecord,
}

impl Row<'_> {
    fn line(&self) -> usize {
        let (before, after) = self.text.split_at_checked(self.begins).unwrap_or_default();
        let empty = after.len() - after.trim_start_matches(['\r', '\n']).len();
        1 + before.matches('\n').count() + after[..empty].matches('\n').count()
    }

    fn wrong(&self, column: &str, what: &str) -> InputError {
        InputError::new(format!("line {}, column {column}: {what}", self.line()))
    }

    fn field(&self, at: usize, column: &str) -> Result<&str, InputError> {
        self.row.get(at).filter(|text| !text.is_empty()).ok_or_else(|| self.wrong(column, "empty"))
    }

    fn number(&self, at: usize, column: &str) -> Result<f64, InputError> {
        let text = self.field(at, column)?;
        let value = text.parse().map_err(|_| self.wrong(column, &format!("expected a number, not `{text}`")))?;
        if !(-10_000.0..=10_000.0).contains(&value) {
            return Err(self.wrong(column, &format!("{value} is outside -10000..=10000")));
        }
        Ok(value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_of_several_people_in_any_order_of_columns_become_a_track_each() {
        let people =
            parse("frame,y,x,time_s,person\n0, 2,1,0,a\n0,5,5,0,b\n1,3,1,0.4,a\n2,4,1,0.8,a\n2,5,6,0.8,b\n3,9,9,1,c\n");
        let tracks: Vec<_> = people.unwrap().into_iter().map(|(name, person)| (name, person.track)).collect();
        let a = vec![[0.0, 1.0, 2.0], [0.4, 1.0, 3.0], [0.8, 1.0, 4.0]];
        let b = vec![[0.0, 5.0, 5.0], [0.8, 6.0, 5.0]];
        assert_eq!(tracks, [("a".to_owned(), a), ("b".to_owned(), b)], "c is there for no time at all");
    }

    #[test]
    fn what_is_wrong_is_named_by_its_line_and_column() {
        for (text, named) in [
            ("time_s,person,x\n0,a,1\n", "line 1: no column y; required: time_s, person, x, y"),
            ("time_s,person,x,y\n0,a,1,2\n1,a,one,2\n", "line 3, column x: expected a number, not `one`"),
            ("time_s,person,x,y\n0,a,1,2\n\n1,a,1\n", "line 4, column y: empty"),
            ("time_s,person,x,y\n0,,1,2\n", "line 2, column person: empty"),
            ("time_s,person,x,y\n0,a,NaN,2\n", "line 2, column x: NaN is outside"),
            ("time_s,person,x,y\n0,a,1,1e9\n", "line 2, column y: 1000000000 is outside"),
            ("time_s,person,x,y\n1,a,1,2\n2,b,1,1\n1,a,1,3\n", "line 4, column time_s: 1 of a is not after 1"),
        ] {
            let error = parse(text).unwrap_err().to_string();
            assert!(error.starts_with(named), "{error}");
        }
        for nobody in ["time_s,person,x,y\n", "time_s,person,x,y\n0,a,1,2\n0,b,3,2\n"] {
            assert!(parse(nobody).unwrap_err().to_string().starts_with("nobody appears: a person needs"), "{nobody}");
        }
    }
}
