//! `--set KEY=VALUE`: keys of the scene given on a command line, laid over what the file says.

use std::collections::BTreeMap;
use std::str::FromStr;
use std::sync::Arc;

use super::document::{Data, Entry, Node, parse_value, shorten};
use super::errors::{Place, SceneError};
use super::shape::{SCENE, Shape, nearest_key};

/// One key of the scene, given outside its file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Override {
    option: Arc<str>,
    key: String,
    /// `None` takes the file's value away, so that the default holds.
    value: Option<String>,
}

impl Override {
    /// `--set KEY=VALUE`. The value is TOML, or else a bare string; where the key takes text, TOML of another type (a
    /// number, a date) is text as well. A table is merged key by key, an array replaces the file's.
    pub fn new(key: impl Into<String>, value: impl Into<String>) -> Self {
        let key = key.into();
        Self { option: format!("--set {key}").into(), key, value: Some(value.into()) }
    }

    /// Another option that sets a key, as `--solver`; errors name it.
    pub fn by_option(option: &str, key: impl Into<String>, value: impl Into<String>) -> Self {
        Self { option: option.into(), key: key.into(), value: Some(value.into()) }
    }

    /// An option that takes the file's value of a key away.
    pub fn unset(option: &str, key: impl Into<String>) -> Self {
        Self { option: option.into(), key: key.into(), value: None }
    }

    /// What was typed to set it, without the value: errors name this.
    pub fn option(&self) -> &str {
        &self.option
    }

    /// The key's full path.
    pub fn key(&self) -> &str {
        &self.key
    }

    /// The value as typed; `None` if this takes the file's value away.
    pub fn value(&self) -> Option<&str> {
        self.value.as_deref()
    }
}

impl FromStr for Override {
    type Err = SceneError;

    fn from_str(text: &str) -> Result<Self, SceneError> {
        match text.split_once('=') {
            Some((key, value)) if !key.trim().is_empty() => Ok(Self::new(key.trim(), value.trim())),
            _ => Err(SceneError::MalformedOverride { text: text.to_owned() }),
        }
    }
}

/// Lays one override over a file's root table. The value itself is checked later, with all others.
///
/// # Errors
/// A key that no scene has, or an array entry beyond the next one.
pub(super) fn apply(root: &mut Node, change: &Override) -> Result<(), SceneError> {
    let place = Place::Argument(change.option.clone());
    let unknown =
        || SceneError::UnknownKey { place: place.clone(), key: change.key.clone(), nearest: nearest_key(&change.key) };
    let shape = SCENE.find(&change.key).ok_or_else(unknown)?;
    let mut node = root;
    let segments: Vec<&str> = change.key.split('.').collect();
    let Some(value) = &change.value else {
        let (leaf, tables) = segments.split_last().ok_or_else(unknown)?;
        for segment in tables {
            let Data::Table(entries) = &mut node.data else { return Ok(()) };
            let Some(entry) = entries.get_mut(*segment) else { return Ok(()) };
            node = &mut entry.node;
        }
        if let Data::Table(entries) = &mut node.data {
            entries.remove(*leaf);
        }
        return Ok(());
    };
    let empty = |data| Node { place: place.clone(), shown: String::new(), data };
    let mut path = &*SCENE;
    for segment in &segments {
        node = match path {
            Shape::Table(_) => {
                // A file that has something else in a table's place has been reported; the override still counts.
                if !matches!(node.data, Data::Table(_)) {
                    *node = empty(Data::Table(BTreeMap::new()));
                }
                let Data::Table(entries) = &mut node.data else { return Err(unknown()) };
                let entry = entries.entry((*segment).to_owned());
                &mut entry
                    .or_insert_with(|| Entry { key_place: place.clone(), node: empty(Data::Table(BTreeMap::new())) })
                    .node
            }
            _ => {
                if !matches!(node.data, Data::Array(_)) {
                    *node = empty(Data::Array(Vec::new()));
                }
                let Data::Array(items) = &mut node.data else { return Err(unknown()) };
                let index: usize = segment.parse().map_err(|_| unknown())?;
                if index > items.len() {
                    return Err(SceneError::OutOfRange {
                        place: place.clone(),
                        key: change.key.clone(),
                        value: shorten(value),
                        expected: format!("an index of at most {}: there are {0} entries before it", items.len()),
                    });
                }
                if index == items.len() {
                    items.push(empty(Data::Table(BTreeMap::new())));
                }
                &mut items[index]
            }
        };
        path = path.find(segment).ok_or_else(unknown)?;
    }
    let text = || Node { place: place.clone(), shown: shorten(value), data: Data::Text(value.clone()) };
    let mut written = parse_value(&place, value).unwrap_or_else(text);
    if matches!(shape, Shape::Text | Shape::Names(_)) && !matches!(written.data, Data::Text(_)) {
        written = text();
    }
    merge(node, written);
    Ok(())
}

fn merge(old: &mut Node, new: Node) {
    match (&mut old.data, new.data) {
        (Data::Table(old), Data::Table(new)) => {
            for (name, entry) in new {
                match old.get_mut(&name) {
                    Some(known) => merge(&mut known.node, entry.node),
                    None => drop(old.insert(name, entry)),
                }
            }
        }
        (_, data) => *old = Node { data, ..new },
    }
}
