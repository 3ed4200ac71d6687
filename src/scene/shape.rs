//! The JSON Schema of the scene's types → what each key may hold, in the form that the checker walks.
//!
//! The types in `types.rs` stay the only list of keys: nothing here names one.

use std::sync::LazyLock;

use serde_json::Value;

/// What a key may hold.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Shape {
    Table(Vec<Field>),
    Array { item: Box<Shape>, least: usize, most: usize },
    Names(Vec<String>),
    Number { least: f64, most: f64 },
    Integer { least: i128, most: i128 },
    Text,
    Boolean,
}

/// A key of a table.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Field {
    pub(super) name: String,
    pub(super) shape: Shape,
    pub(super) required: bool,
}

/// The JSON Schema of a scene file, draft 2020-12.
pub fn schema() -> Value {
    schemars::schema_for!(super::Scene).to_value()
}

/// The shape of a whole scene.
pub(super) static SCENE: LazyLock<Shape> = LazyLock::new(|| {
    let schema = schema();
    Shape::from_schema(&schema, &schema, "scene")
});

/// Full paths of all keys.
static KEYS: LazyLock<Vec<String>> = LazyLock::new(|| SCENE.keys());

/// The names that the key at a dotted path takes, in the order of its type; empty if it does not take names.
pub fn names_of(key: &str) -> &'static [String] {
    match SCENE.find(key) {
        Some(Shape::Names(names)) => names,
        _ => &[],
    }
}

impl Shape {
    /// # Panics
    /// On a keyword that the checker would otherwise silently ignore: a broken promise between `types.rs` and this file.
    fn from_schema(root: &Value, schema: &Value, path: &str) -> Self {
        let map = schema.as_object().unwrap_or_else(|| panic!("{path}: the schema is no object"));
        for keyword in map.keys() {
            const KNOWN: [&str; 19] = [
                "$schema",
                "$defs",
                "$ref",
                "title",
                "description",
                "default",
                "format",
                "type",
                "const",
                "oneOf",
                "anyOf",
                "properties",
                "required",
                "additionalProperties",
                "items",
                "minItems",
                "maxItems",
                "minimum",
                "maximum",
            ];
            assert!(KNOWN.contains(&keyword.as_str()), "{path}: the checker does not know the keyword {keyword}");
        }
        if let Some(reference) = map.get("$ref").and_then(Value::as_str) {
            let pointer = reference.strip_prefix('#').unwrap_or_else(|| panic!("{path}: {reference} is not local"));
            let target = root.pointer(pointer).unwrap_or_else(|| panic!("{path}: {reference} leads nowhere"));
            return Self::from_schema(root, target, path);
        }
        if let Some(Value::Array(choices)) = map.get("anyOf") {
            // An `Option`: TOML has no null, an absent key is one.
            let mut choices = choices.iter().filter(|choice| choice["type"] != "null");
            return match (choices.next(), choices.next()) {
                (Some(choice), None) => Self::from_schema(root, choice, path),
                _ => panic!("{path}: a choice between types"),
            };
        }
        if let Some(Value::Array(names)) = map.get("oneOf") {
            let name = |choice: &Value| choice["const"].as_str().map(str::to_owned);
            return Self::Names(names.iter().map(|choice| name(choice).expect("a described variant")).collect());
        }
        let kind = match &map["type"] {
            Value::String(kind) => kind.as_str(),
            Value::Array(kinds) => kinds.iter().filter_map(Value::as_str).find(|kind| *kind != "null").expect("a type"),
            other => panic!("{path}: type {other}"),
        };
        match kind {
            "object" => {
                let required = map.get("required").and_then(Value::as_array).cloned().unwrap_or_default();
                let fields = map["properties"].as_object().expect("properties").iter().map(|(name, schema)| Field {
                    name: name.clone(),
                    shape: Self::from_schema(root, schema, &format!("{path}.{name}")),
                    required: required.iter().any(|key| key == name),
                });
                Self::Table(fields.collect())
            }
            "array" => Self::Array {
                item: Box::new(Self::from_schema(root, &map["items"], &format!("{path}.0"))),
                least: map.get("minItems").and_then(Value::as_u64).map_or(0, |count| count as usize),
                most: map.get("maxItems").and_then(Value::as_u64).map_or(usize::MAX, |count| count as usize),
            },
            "number" => Self::Number {
                least: map.get("minimum").and_then(Value::as_f64).unwrap_or(f64::NEG_INFINITY),
                most: map.get("maximum").and_then(Value::as_f64).unwrap_or(f64::INFINITY),
            },
            "integer" => {
                let (low, high) = match map.get("format").and_then(Value::as_str) {
                    Some("uint32") => (0, i128::from(u32::MAX)),
                    Some("uint64") => (0, i128::from(u64::MAX)),
                    Some("int32") => (i128::from(i32::MIN), i128::from(i32::MAX)),
                    Some("int64") => (i128::from(i64::MIN), i128::from(i64::MAX)),
                    other => panic!("{path}: an integer of format {other:?}"),
                };
                let bound = |keyword| map.get(keyword).and_then(Value::as_f64).map(|bound| bound as i128);
                Self::Integer {
                    least: bound("minimum").map_or(low, |bound| bound.max(low)),
                    most: bound("maximum").map_or(high, |bound| bound.min(high)),
                }
            }
            "string" => Self::Text,
            "boolean" => Self::Boolean,
            other => panic!("{path}: type {other}"),
        }
    }

    /// The shape at a dotted path, with array entries by index.
    pub(super) fn find(&self, path: &str) -> Option<&Shape> {
        path.split('.').try_fold(self, |shape, segment| match shape {
            Self::Table(fields) => fields.iter().find(|field| field.name == segment).map(|field| &field.shape),
            Self::Array { item, .. } => segment.parse::<usize>().ok().map(|_| &**item),
            _ => None,
        })
    }

    /// Says what belongs here.
    pub(super) fn expected(&self) -> String {
        match self {
            Self::Table(fields) => {
                let names: Vec<&str> = fields.iter().map(|field| field.name.as_str()).collect();
                format!("a table with the keys {}", names.join(", "))
            }
            Self::Array { item, least, most } if least == most => {
                format!("an array of {least}: each {}", item.expected())
            }
            Self::Array { item, .. } => format!("an array: each {}", item.expected()),
            Self::Names(names) => {
                format!("one of {}", names.iter().map(|name| format!("\"{name}\"")).collect::<Vec<_>>().join(", "))
            }
            Self::Number { least, most } => {
                format!("a finite number{}", range(bound(*least), bound(*most)))
            }
            Self::Integer { least, most } => format!("an integer{}", range(Some(*least), Some(*most))),
            Self::Text => "a string in quotes".to_owned(),
            Self::Boolean => "true or false".to_owned(),
        }
    }

    /// Full paths of all keys, with `0` for an entry of an array of tables.
    pub(super) fn keys(&self) -> Vec<String> {
        fn walk(shape: &Shape, path: &str, keys: &mut Vec<String>) {
            match shape {
                Shape::Table(fields) => {
                    for field in fields {
                        let path = join(path, &field.name);
                        keys.push(path.clone());
                        walk(&field.shape, &path, keys);
                    }
                }
                Shape::Array { item, .. } if matches!(**item, Shape::Table(_)) => walk(item, &join(path, "0"), keys),
                _ => {}
            }
        }
        let mut keys = Vec::new();
        walk(self, "", &mut keys);
        keys
    }
}

fn bound(bound: f64) -> Option<String> {
    // 1e12 rather than a row of zeros.
    let plain = bound == 0.0 || (1e-3..1e6).contains(&bound.abs());
    bound.is_finite().then(|| if plain { bound.to_string() } else { format!("{bound:e}") })
}

fn range<T: std::fmt::Display>(least: Option<T>, most: Option<T>) -> String {
    match (least, most) {
        (Some(least), Some(most)) => format!(" from {least} to {most}"),
        (Some(least), None) => format!(", at least {least}"),
        (None, Some(most)) => format!(", at most {most}"),
        (None, None) => String::new(),
    }
}

/// A dotted path.
pub(super) fn join(path: &str, name: &str) -> String {
    if path.is_empty() { name.to_owned() } else { format!("{path}.{name}") }
}

/// The known key that is nearest to an unknown one: a sibling with a like name, else a key of the same name in another
/// table, else the nearest full path.
pub(super) fn nearest_key(key: &str) -> String {
    let keys = &*KEYS;
    // Entries of arrays are all alike: compare as if it were the first.
    let plain: Vec<&str> =
        key.split('.').map(|segment| if segment.parse::<usize>().is_ok() { "0" } else { segment }).collect();
    let (table, leaf) = (plain[..plain.len() - 1].join("."), plain[plain.len() - 1]);
    let split = |key: &str| key.rsplit_once('.').map_or((String::new(), key.to_owned()), |(a, b)| (a.into(), b.into()));
    let distance = |a: &str, b: &str| strsim::damerau_levenshtein(&a.to_lowercase(), &b.to_lowercase());
    let sibling = keys
        .iter()
        .filter(|known| split(known).0 == table)
        .min_by_key(|known| distance(&split(known).1, leaf))
        // Within a third of its letters it is a slip of the hand; further off, another table's key is likelier meant.
        .filter(|known| distance(&split(known).1, leaf) <= (leaf.chars().count() / 3).max(1));
    let elsewhere = || keys.iter().find(|known| known.contains('.') && split(known).1.eq_ignore_ascii_case(leaf));
    let whole = plain.join(".");
    let anywhere = || keys.iter().min_by_key(|known| distance(known, &whole));
    sibling.or_else(elsewhere).or_else(anywhere).expect("a scene has keys").clone()
}

/// The name nearest to one that is not in the list.
pub(super) fn nearest_name(names: &[String], name: &str) -> String {
    names.iter().min_by_key(|known| strsim::damerau_levenshtein(known, &name.to_lowercase())).expect("names").clone()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_key_of_the_schema_is_described_and_has_a_default_unless_required() {
        fn walk(root: &Value, schema: &Value, path: &str, seen: &mut usize) {
            // An `Option` of a table is a choice between it and nothing.
            let schema = if schema["anyOf"].is_array() { &schema["anyOf"][0] } else { schema };
            let target = schema["$ref"].as_str().map_or(schema, |reference| root.pointer(&reference[1..]).unwrap());
            let target = if target["type"] == "array" { &target["items"] } else { target };
            let target = target["$ref"].as_str().map_or(target, |reference| root.pointer(&reference[1..]).unwrap());
            let Some(properties) = target["properties"].as_object() else { return };
            assert_eq!(target["additionalProperties"], false, "{path} would let unknown keys through");
            for (name, property) in properties {
                let path = join(path, name);
                *seen += 1;
                assert!(
                    property["description"].as_str().is_some_and(|text| text.len() > 2),
                    "{path} has no description"
                );
                let required =
                    target["required"].as_array().is_some_and(|required| required.contains(&name.as_str().into()));
                assert!(required || property.get("default").is_some(), "{path} has no default");
                walk(root, property, &path, seen);
            }
        }
        let schema = schema();
        assert_eq!(schema["$schema"], "https://json-schema.org/draft/2020-12/schema");
        let mut seen = 0;
        walk(&schema, &schema, "", &mut seen);
        assert_eq!(seen, SCENE.keys().len());
        assert!(seen > 80, "{seen} keys");
    }

    #[test]
    fn nearest_key_prefers_a_slip_of_the_hand_then_the_same_name_elsewhere() {
        assert_eq!(nearest_key("render.widht"), "render.width");
        assert_eq!(nearest_key("width"), "render.width");
        assert_eq!(nearest_key("camera.irradiance"), "sun.irradiance");
        assert_eq!(nearest_key("watr"), "water");
        assert_eq!(nearest_key("camera.key.7.lookat"), "camera.key.0.look_at");
        assert_eq!(nearest_key("surface.Order"), "surface.order");
        assert!(SCENE.find(&nearest_key("")).is_some());
    }

    #[test]
    fn names_come_from_the_types() {
        assert_eq!(names_of("surface.solver"), ["univariate", "newton", "report", "bezier-clip", "reference"]);
        assert!(names_of("render.width").is_empty());
    }
}
