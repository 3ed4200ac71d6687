//! What can be wrong with frames that foam shall be made from.

/// Why there can be no foam.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FoamError {
    /// Frames that follow each other are not of one map.
    #[error(
        "foam: frame {number} has {}, frame {other} has {}; expected one map throughout foam.window",
        map(*.columns, *.origin, *.width), map(*.other_columns, *.other_origin, *.other_width)
    )]
    OtherMap {
        /// The earlier frame's number.
        number: i64,
        /// Its nx, nz.
        columns: [usize; 2],
        /// Its origin (m).
        origin: [f64; 2],
        /// Its columns' width (m).
        width: [f64; 2],
        /// The later frame's number.
        other: i64,
        /// Its nx, nz.
        other_columns: [usize; 2],
        /// Its origin (m).
        other_origin: [f64; 2],
        /// Its columns' width (m).
        other_width: [f64; 2],
    },
    /// Time does not go on from frame to frame.
    #[error(
        "foam: frame {number} is at {time} s and frame {other} at {other_time} s; expected a later time, \
         to carry foam over foam.window"
    )]
    Time {
        /// The earlier frame's number.
        number: i64,
        /// Its time (s).
        time: f64,
        /// The later frame's number.
        other: i64,
        /// Its time (s).
        other_time: f64,
    },
}

fn map(columns: [usize; 2], origin: [f64; 2], width: [f64; 2]) -> String {
    let ([nx, nz], [x, z], [dx, dz]) = (columns, origin, width);
    format!("{nx} x {nz} columns of {dx} x {dz} m from {x}, {z}")
}
