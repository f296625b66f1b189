//! JSON schemas of input files, made from the types that the files are read into, with their comments, defaults and ranges.
//!
//! An editor completes keys, explains them and marks errors by the schema of scenario files: `foxhound schema` prints
//! `scenarios/scenario.schema.json`, and `tests/flight/scenarios.rs` checks that. The files are read by the same schemas: the keys and
//! the ranges are nowhere else. Relations between two numbers are not in them, for example that a pulse is no longer than its period.

use schemars::JsonSchema;
use schemars::generate::SchemaSettings;
use serde::de::DeserializeOwned;
use serde_json::Value;

use super::input::{InputError, check, parse_strictly};

/// The schema of a kind of file.
pub(crate) struct Schema {
    /// What the whole file is called in an error.
    name: &'static str,
    /// As JSON.
    pub(crate) root: Value,
    /// All keys with their paths, in which `[]` stands for any element of a list.
    pub(crate) keys: Vec<String>,
}

impl Schema {
    /// That of the files that are read into a type.
    pub(crate) fn of<T: JsonSchema>(name: &'static str) -> Self {
        let root = SchemaSettings::draft2020_12().into_generator().into_root_schema_for::<T>().to_value();
        let mut keys = Vec::new();
        let schema = Self { name, root, keys: Vec::new() };
        schema.gather(&schema.root, "", &mut keys);
        Self { keys, ..schema }
    }

    /// Reads a file.
    ///
    /// # Errors
    /// The path of the first key that is unknown, of the wrong type or out of range.
    pub(crate) fn read<T: DeserializeOwned>(&self, text: &str) -> Result<T, InputError> {
        // Invalid JSON is refused below, where the path is known.
        if let Ok(value) = serde_json::from_str(text) {
            self.check(&value)?;
        }
        let mut document = serde_json::Deserializer::from_str(text);
        let known: Vec<&str> = self.keys.iter().map(String::as_str).collect();
        let read = parse_strictly(&mut document, &known)?;
        document.end().map_err(|error| InputError::new(error.to_string()))?;
        Ok(read)
    }

    /// Refuses a list where an object should be, which a derived reader would take field by field, and numbers out of range.
    ///
    /// # Errors
    /// The path of the first one.
    pub(crate) fn check(&self, value: &Value) -> Result<(), InputError> {
        self.check_part(&self.root, "", value)
    }

    fn check_part(&self, part: &Value, path: &str, value: &Value) -> Result<(), InputError> {
        if value.is_null() && part.get("anyOf").is_some() {
            return Ok(());
        }
        let part = self.resolved(part);
        if part["type"] == "object" && !value.is_object() {
            let path = if path.is_empty() { self.name } else { path };
            return Err(InputError::new(format!("{path}: expected an object {{...}}")));
        }
        match value {
            Value::Object(fields) => fields.iter().try_for_each(|(key, value)| {
                let known = part["properties"].get(key);
                known.map_or(Ok(()), |part| self.check_part(part, &inside(path, key), value))
            }),
            Value::Array(items) => items
                .iter()
                .enumerate()
                .try_for_each(|(index, item)| self.check_part(&part["items"], &format!("{path}[{index}]"), item)),
            Value::Number(number) => match [&number.as_f64(), &part["minimum"].as_f64(), &part["maximum"].as_f64()] {
                [Some(number), Some(min), Some(max)] => check(path, *number, *min, *max),
                _ => Ok(()),
            },
            Value::Null | Value::Bool(_) | Value::String(_) => Ok(()),
        }
    }

    /// The definition that a part refers to; of what may be null, what it is otherwise.
    pub(crate) fn resolved<'a>(&'a self, part: &'a Value) -> &'a Value {
        let part = part.get("anyOf").and_then(|choices| choices.get(0)).unwrap_or(part);
        let reference = part.get("$ref").and_then(Value::as_str);
        reference.and_then(|name| self.root.pointer(name.trim_start_matches('#'))).unwrap_or(part)
    }

    fn gather(&self, part: &Value, path: &str, keys: &mut Vec<String>) {
        let part = self.resolved(part);
        for (key, inner) in part["properties"].as_object().into_iter().flatten() {
            let path = inside(path, key);
            keys.push(path.clone());
            self.gather(inner, &path, keys);
        }
        if let Some(items) = part.get("items") {
            self.gather(items, &format!("{path}[]"), keys);
        }
    }
}

fn inside(path: &str, key: &str) -> String {
    if path.is_empty() { key.to_owned() } else { format!("{path}.{key}") }
}
