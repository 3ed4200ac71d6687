//! The scene file: TOML → plain data, its JSON Schema, and errors with file, line and column.

mod types;

pub use types::*;
