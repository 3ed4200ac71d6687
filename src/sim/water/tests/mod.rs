//! What the water must do.

use super::*;

mod conservation;
