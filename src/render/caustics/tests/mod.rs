//! Closed forms and a referee for the caustics: flat and parabolic water, dense searches over waves, extremes.

mod beams;
mod flat;
mod folds;
mod parabola;
mod referee;

use super::{Connection, Event, Manifold, ManifoldCounts, Target};
use crate::scene::SolverKind;
use crate::surface::{Lattice, SimdLevel, SplineSurface};
use glam::Vec3;

const WATER: f32 = 1.333;

/// A surface of `size` columns around the origin with the given control heights.
fn surface(order: u32, size: [usize; 2], width: [f64; 2], height: impl Fn(f64, f64) -> f64) -> SplineSurface {
    let first = [0, 1].map(|axis| -0.5 * (size[axis] as f64 - 1.0) * width[axis]);
    let heights: Vec<f64> = (0..size[0] * size[1])
        .map(|k| height(first[0] + (k % size[0]) as f64 * width[0], first[1] + (k / size[0]) as f64 * width[1]))
        .collect();
    let lattice = Lattice::new(order, size, first, width, &heights, |_| true).unwrap();
    SplineSurface::new(lattice, SolverKind::Univariate, SimdLevel::detect())
}

/// All connections, and what finding them took.
fn connect(
    manifold: &Manifold,
    from: Vec3,
    event: Event,
    target: Target,
    tilt: [f32; 2],
) -> (Vec<Connection>, ManifoldCounts) {
    let (mut found, mut counts) = (Vec::new(), ManifoldCounts::default());
    manifold.connect(from, event, target, WATER, tilt, 1e-5, &mut found, &mut counts);
    (found, counts)
}
