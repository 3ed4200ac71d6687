//! A tree of written values against the shape of a scene: every wrong value becomes an error, what is right becomes JSON
//! that serde can read. Rules between keys are in `rules`.

use serde_json::{Map, Number, Value};

use super::document::{Data, Entry, Node};
use super::errors::{SceneError, SceneErrors};
use super::shape::{Shape, join, nearest_key, nearest_name};

/// Checks a whole file's root table. Returns what is right of it, and all that is wrong.
pub(super) fn check(root: &Node, shape: &'static Shape) -> (Value, Vec<SceneError>) {
    let mut checker = Checker { errors: Vec::new() };
    let value = checker.value(root, shape, "").unwrap_or_else(|| Value::Object(Map::new()));
    (value, checker.errors)
}

struct Checker {
    errors: Vec<SceneError>,
}

impl Checker {
    /// The value as JSON; `None` if it is wrong. A table is right without its wrong keys, unless they are required; an
    /// array with a wrong entry is wrong.
    fn value(&mut self, node: &Node, shape: &'static Shape, key: &str) -> Option<Value> {
        if self.errors.len() >= SceneErrors::MOST {
            return None;
        }
        match (shape, &node.data) {
            (Shape::Table(_), Data::Table(entries)) => self.table(node, entries, shape, key),
            (Shape::Array { item, least, most }, Data::Array(items)) => {
                if items.len() < *least || items.len() > *most {
                    let expected = format!("{}, not {}", shape.expected(), items.len());
                    return self.wrong_type(node, key, expected);
                }
                let values: Vec<Option<Value>> = items
                    .iter()
                    .enumerate()
                    .map(|(index, node)| self.value(node, item, &join(key, &index.to_string())))
                    .collect();
                values.into_iter().collect::<Option<Vec<Value>>>().map(Value::Array)
            }
            (Shape::Names(names), Data::Text(text)) => {
                if names.contains(text) {
                    return Some(Value::String(text.clone()));
                }
                self.errors.push(SceneError::UnknownName {
                    place: node.place.clone(),
                    key: key.to_owned(),
                    value: node.shown.clone(),
                    allowed: names,
                    nearest: nearest_name(names, text),
                });
                None
            }
            (Shape::Number { least, most }, Data::Float(_) | Data::Integer(_)) => {
                let number = match node.data {
                    Data::Float(number) => number,
                    Data::Integer(integer) => integer as f64,
                    _ => unreachable!("matched above"),
                };
                if number.is_finite() && (*least..=*most).contains(&number) {
                    // One zero, so that equal scenes have equal hashes.
                    return Number::from_f64(number + 0.0).map(Value::Number);
                }
                self.out_of_range(node, key, shape)
            }
            (Shape::Integer { least, most }, Data::Integer(integer)) => {
                if (*least..=*most).contains(integer) {
                    return Number::from_i128(*integer).map(Value::Number);
                }
                self.out_of_range(node, key, shape)
            }
            (Shape::Text, Data::Text(text)) => Some(Value::String(text.clone())),
            (Shape::Boolean, Data::Boolean(boolean)) => Some(Value::Bool(*boolean)),
            _ => self.wrong_type(node, key, shape.expected()),
        }
    }

    fn table(
        &mut self,
        node: &Node,
        entries: &std::collections::BTreeMap<String, Entry>,
        shape: &'static Shape,
        key: &str,
    ) -> Option<Value> {
        let Shape::Table(fields) = shape else { return None };
        let mut map = Map::new();
        let mut whole = true;
        for (name, entry) in entries {
            let path = join(key, name);
            match fields.iter().find(|field| field.name == *name) {
                Some(field) => match self.value(&entry.node, &field.shape, &path) {
                    Some(value) => drop(map.insert(name.clone(), value)),
                    None => whole &= !field.required,
                },
                None if self.errors.len() >= SceneErrors::MOST => return None,
                None => self.errors.push(SceneError::UnknownKey {
                    place: entry.key_place.clone(),
                    nearest: nearest_key(&path),
                    key: path,
                }),
            }
        }
        for field in fields.iter().filter(|field| field.required && !entries.contains_key(&field.name)) {
            whole = false;
            self.errors.push(SceneError::Missing {
                place: node.place.clone(),
                key: join(key, &field.name),
                expected: field.shape.expected(),
            });
        }
        whole.then_some(Value::Object(map))
    }

    fn wrong_type(&mut self, node: &Node, key: &str, expected: String) -> Option<Value> {
        let value = match &node.data {
            Data::Table(_) => "a table".to_owned(),
            Data::Array(items) if items.iter().any(|item| matches!(item.data, Data::Table(_))) => {
                "an array of tables".to_owned()
            }
            _ => node.shown.clone(),
        };
        self.errors.push(SceneError::WrongType { place: node.place.clone(), key: key.to_owned(), value, expected });
        None
    }

    fn out_of_range(&mut self, node: &Node, key: &str, shape: &'static Shape) -> Option<Value> {
        self.errors.push(SceneError::OutOfRange {
            place: node.place.clone(),
            key: key.to_owned(),
            value: node.shown.clone(),
            expected: shape.expected(),
        });
        None
    }
}
