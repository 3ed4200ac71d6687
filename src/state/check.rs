//! What a frame's numbers must satisfy besides being numbers: the same rules for text, for NPZ and before writing.

use super::error::{Place, Problem, Problems, Stop};
use super::{Columns, Frame, Particles};

/// Most rows of columns, and of particles, in one frame: a map of 16384 x 16384, 2 GB an array in double precision.
/// It bounds what an archive of nothing but zeros, which deflate packs a thousandfold, can ask for.
pub const MAX_ROWS: u64 = 1 << 28;

/// Least columns along each side: the stencil of a biquadratic patch.
pub(super) const LEAST_SIDE: u64 = 3;

/// The text that a message says of a sound grid.
pub(super) fn grid_expected() -> String {
    format!("nx nz, whole numbers of at least {LEAST_SIDE}, at most {MAX_ROWS} columns together")
}

/// nx, nz as counts, if they are within the limits.
pub(super) fn grid(nx: u64, nz: u64) -> Option<(usize, usize)> {
    let count = nx.checked_mul(nz)?;
    let sound = nx >= LEAST_SIDE && nz >= LEAST_SIDE && count <= MAX_ROWS;
    sound.then_some((nx as usize, nz as usize))
}

/// What is wrong with a column's width, found and expected.
pub(super) fn width(width: [f64; 2]) -> Option<(String, &'static str)> {
    let sound = width.iter().all(|w| *w > 0.0);
    (!sound).then(|| (format!("width {} {}", width[0], width[1]), "a width above 0 along x and z"))
}

/// What is wrong with a column's heights, found and expected. `dry_threshold` in metres.
pub(super) fn heights(base: f64, top: f64, dry_threshold: f64) -> Option<(String, String)> {
    (base - top > dry_threshold).then(|| {
        (
            format!("top {top} is {} m below base {base}", base - top),
            format!("top at most {dry_threshold} m (the dry threshold) below base"),
        )
    })
}

/// What is wrong with a mass or an age, found and expected.
pub(super) fn at_least_zero(name: &str, value: f64) -> Option<(String, &'static str)> {
    (value < 0.0).then(|| (format!("{name} = {value}"), "at least 0"))
}

/// Refuses to write what no reader would take back, whatever its dry threshold.
///
/// # Panics
/// If arrays of one frame differ in length: then whoever made the frame is broken, not its data.
pub(super) fn writable(frame: &Frame) -> Result<(), Problem> {
    let Columns { origin, width: widths, nx, nz, base, top, pressure, flow } = &frame.columns;
    let Particles { position, velocity, mass, age, id } = &frame.particles;
    let columns = nx.checked_mul(*nz).expect("nx * nz overflows");
    assert!(
        [base.len(), top.len(), pressure.len(), flow.len()] == [columns; 4],
        "the arrays of {nx} x {nz} columns differ in length"
    );
    let particles = position.len();
    assert!(
        [velocity.len(), mass.len(), age.len()] == [particles; 3] && id.as_ref().is_none_or(|id| id.len() == particles),
        "the arrays of {particles} particles differ in length"
    );
    if grid(*nx as u64, *nz as u64).is_none() {
        return Err(Problem::new(Place::File, format!("columns {nx} {nz}"), grid_expected()));
    }
    finite("time", &[frame.time])?;
    finite("origin", origin)?;
    finite("width", widths)?;
    if let Some((found, expected)) = width(*widths) {
        return Err(Problem::new(Place::Array("width".into()), found, expected));
    }
    for (name, values) in [("base", base), ("top", top), ("pressure", pressure), ("mass", mass), ("age", age)] {
        finite(name, values)?;
    }
    finite("flow", flow.as_flattened())?;
    finite("position", position.as_flattened())?;
    finite("velocity", velocity.as_flattened())?;
    for (name, values) in [("mass", mass), ("age", age)] {
        for (i, &value) in values.iter().enumerate() {
            if let Some((found, expected)) = at_least_zero(name, value) {
                return Err(Problem::new(Place::Element(name.into(), vec![i as u64]), found, expected));
            }
        }
    }
    Ok(())
}

fn finite(name: &str, values: &[f64]) -> Result<(), Problem> {
    match values.iter().position(|value| !value.is_finite()) {
        None => Ok(()),
        Some(i) => {
            let place = Place::Element(name.into(), vec![i as u64]);
            Err(Problem::new(place, values[i].to_string(), "a finite number"))
        }
    }
}

/// Stops here if something is already wrong.
pub(super) fn stop_if_damaged(problems: &Problems) -> Result<(), Stop> {
    if problems.is_empty() { Ok(()) } else { Err(Stop::Noted) }
}
