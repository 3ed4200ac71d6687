//! What a frame or a model holds, in figures: counts, ranges, the amount of water.
//!
//! `inspect` prints it.

use std::path::Path;

use serde::Serialize;

use super::maps::{self, MapSummary};
use super::{ExtraArray, Frame, Model, Particles, StateError, read_frame};

/// Least and greatest.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Range {
    /// The least value.
    pub min: f64,
    /// The greatest value.
    pub max: f64,
}

impl Range {
    /// Of no values: none.
    pub(super) fn of(values: impl IntoIterator<Item = f64>) -> Option<Range> {
        values.into_iter().fold(None, |range, v| match range {
            None => Some(Range { min: v, max: v }),
            Some(Range { min, max }) => Some(Range { min: min.min(v), max: max.max(v) }),
        })
    }
}

/// A box (m).
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Extent {
    /// East.
    pub x: Range,
    /// Up.
    pub y: Range,
    /// South.
    pub z: Range,
}

impl Extent {
    fn of<'a>(points: impl IntoIterator<Item = &'a [f64; 3]> + Clone) -> Option<Extent> {
        let axis = |i: usize| Range::of(points.clone().into_iter().map(move |p| p[i]));
        Some(Extent { x: axis(0)?, y: axis(1)?, z: axis(2)? })
    }
}

/// One frame in figures.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FrameSummary {
    /// s.
    pub time: f64,
    /// nx, nz.
    pub columns: [usize; 2],
    /// x, z of the centre of column (0, 0) (m).
    pub origin: [f64; 2],
    /// dx, dz (m).
    pub width: [f64; 2],
    /// Of the columns' footprints, from the lowest base to the highest top (m). Without the spray.
    pub extent: Extent,
    /// Of the terrain (m).
    pub base: Range,
    /// Of the water's upper side, dry columns included (m).
    pub top: Range,
    /// Above air (Pa).
    pub pressure: Range,
    /// Depth-averaged speed over wet columns (m/s).
    pub flow_speed: Option<Range>,
    /// The depth under which a column holds no water (m).
    pub dry_threshold: f64,
    /// Columns that hold water.
    pub wet_columns: usize,
    /// Their share of all, 0 to 1.
    pub wet_share: f64,
    /// top - base over wet columns (m).
    pub depth: Option<Range>,
    /// Mean depth over wet columns (m).
    pub mean_depth: Option<f64>,
    /// Water in the wet columns (m3).
    pub volume: f64,
    /// The spray.
    pub particles: ParticleSummary,
    /// Documented maps; only [`FrameSummary::of_file`] reads them.
    pub maps: Vec<MapSummary>,
    /// Arrays that are not ours.
    pub extra: Vec<ExtraArray>,
}

/// The spray in figures.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ParticleSummary {
    /// How many.
    pub count: usize,
    /// Whether they have identities.
    pub identified: bool,
    /// All of it (kg).
    pub total_mass: f64,
    /// Each (kg).
    pub mass: Option<Range>,
    /// m/s.
    pub speed: Option<Range>,
    /// s.
    pub age: Option<Range>,
    /// Of the centres (m).
    pub extent: Option<Extent>,
}

impl FrameSummary {
    /// Summarises a frame whose columns hold water from `dry_threshold` metres of depth on.
    ///
    /// # Panics
    /// If the frame has no columns, which no reader gives.
    pub fn new(frame: &Frame, dry_threshold: f64) -> FrameSummary {
        let columns = &frame.columns;
        let whole = |values: &[f64]| Range::of(values.iter().copied()).expect("a frame has columns");
        let (base, top) = (whole(&columns.base), whole(&columns.top));
        let wet: Vec<usize> =
            (0..columns.base.len()).filter(|&i| columns.top[i] - columns.base[i] >= dry_threshold).collect();
        let depth_of = |&i: &usize| columns.top[i] - columns.base[i];
        let total_depth: f64 = wet.iter().map(depth_of).sum();
        let [dx, dz] = columns.width;
        let side = |origin: f64, width: f64, count: usize| Range {
            min: origin - 0.5 * width,
            max: origin + (count as f64 - 0.5) * width,
        };
        FrameSummary {
            time: frame.time,
            columns: [columns.nx, columns.nz],
            origin: columns.origin,
            width: columns.width,
            extent: Extent {
                x: side(columns.origin[0], dx, columns.nx),
                y: Range { min: base.min.min(top.min), max: base.max.max(top.max) },
                z: side(columns.origin[1], dz, columns.nz),
            },
            base,
            top,
            pressure: whole(&columns.pressure),
            flow_speed: Range::of(wet.iter().map(|&i| columns.flow[i][0].hypot(columns.flow[i][1]))),
            dry_threshold,
            wet_columns: wet.len(),
            wet_share: wet.len() as f64 / columns.base.len() as f64,
            depth: Range::of(wet.iter().map(depth_of)),
            mean_depth: (!wet.is_empty()).then(|| total_depth / wet.len() as f64),
            volume: total_depth * dx * dz,
            particles: ParticleSummary::new(&frame.particles),
            maps: Vec::new(),
            extra: frame.extra.clone(),
        }
    }

    /// Reads a frame's file and summarises all of it, documented maps included.
    ///
    /// # Errors
    /// As [`read_frame`]; a documented map that is damaged or holds a number that is not finite.
    pub fn of_file(path: &Path, dry_threshold: f64) -> Result<FrameSummary, StateError> {
        let mut frame = read_frame(path, dry_threshold)?;
        let maps = maps::summarise(&mut frame, path)?;
        Ok(FrameSummary { maps, ..FrameSummary::new(&frame, dry_threshold) })
    }
}

impl ParticleSummary {
    fn new(particles: &Particles) -> ParticleSummary {
        let speed = |v: &[f64; 3]| v[0].hypot(v[1]).hypot(v[2]);
        ParticleSummary {
            count: particles.position.len(),
            identified: particles.id.is_some(),
            // The empty sum of floats is -0.
            total_mass: particles.mass.iter().fold(0.0, |sum, mass| sum + mass),
            mass: Range::of(particles.mass.iter().copied()),
            speed: Range::of(particles.velocity.iter().map(speed)),
            age: Range::of(particles.age.iter().copied()),
            extent: Extent::of(&particles.position),
        }
    }
}

/// A model in figures.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ModelSummary {
    /// Quadrilaterals.
    pub panels: usize,
    /// Spheres.
    pub spheres: usize,
    /// Meshes by path; their extents are not known before they are opened.
    pub meshes: Vec<String>,
    /// Of the panels and spheres (m).
    pub extent: Option<Extent>,
}

impl ModelSummary {
    /// Summarises a model.
    pub fn new(model: &Model) -> ModelSummary {
        let mut corners: Vec<[f64; 3]> = model.panels.iter().flat_map(|panel| panel.corners).collect();
        for sphere in &model.spheres {
            corners.push(sphere.center.map(|c| c - sphere.radius));
            corners.push(sphere.center.map(|c| c + sphere.radius));
        }
        ModelSummary {
            panels: model.panels.len(),
            spheres: model.spheres.len(),
            meshes: model.meshes.clone(),
            extent: Extent::of(&corners),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::state::{Columns, Panel, Sphere};

    /// 3 x 3 columns of 2 x 0.5 m; three are wet, one of them by exactly the threshold.
    fn frame() -> Frame {
        let mut frame = Frame {
            time: 1.5,
            columns: Columns {
                origin: [10.0, -4.0],
                width: [2.0, 0.5],
                nx: 3,
                nz: 3,
                base: vec![0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 3.0, 3.0, 3.0],
                top: vec![2.0, 1.0, 0.25, 1.0, 1.0, 1.0, 3.0, 3.0, 2.875],
                pressure: vec![7.0; 9],
                flow: vec![[0.0; 2]; 9],
            },
            ..Frame::default()
        };
        frame.columns.flow[0] = [3.0, -4.0];
        frame.columns.flow[8] = [100.0, 0.0];
        frame
    }

    #[test]
    fn figures_of_a_frame_match_those_by_hand() {
        let summary = FrameSummary::new(&frame(), 0.25);
        assert_eq!((summary.wet_columns, summary.wet_share), (3, 3.0 / 9.0));
        assert_eq!(summary.depth, Some(Range { min: 0.25, max: 2.0 }));
        assert_eq!(summary.mean_depth, Some(3.25 / 3.0));
        assert_eq!(summary.volume, 3.25);
        assert_eq!(summary.flow_speed, Some(Range { min: 0.0, max: 5.0 }));
        assert_eq!(summary.extent.x, Range { min: 9.0, max: 15.0 });
        assert_eq!(summary.extent.z, Range { min: -4.25, max: -2.75 });
        assert_eq!(summary.extent.y, Range { min: 0.0, max: 3.0 });
        assert_eq!((summary.base, summary.top.min), (Range { min: 0.0, max: 3.0 }, 0.25));
    }

    #[test]
    fn a_frame_without_water_or_spray_has_no_ranges_of_them() {
        let mut dry = frame();
        dry.columns.top = dry.columns.base.clone();
        let summary = FrameSummary::new(&dry, 0.001);
        assert_eq!((summary.wet_columns, summary.depth, summary.mean_depth, summary.flow_speed), (0, None, None, None));
        assert!(summary.volume == 0.0 && summary.particles.extent.is_none() && summary.particles.mass.is_none());
    }

    #[test]
    fn figures_of_the_spray_match_those_by_hand() {
        let particles = Particles {
            position: vec![[1.0, 5.0, -1.0], [2.0, -5.0, 0.0]],
            velocity: vec![[2.0, 3.0, 6.0], [0.0, 0.5, 0.0]],
            mass: vec![0.5, 0.25],
            age: vec![0.0, 2.0],
            id: Some(vec![8, 9]),
        };
        let summary = ParticleSummary::new(&particles);
        assert_eq!((summary.count, summary.identified, summary.total_mass), (2, true, 0.75));
        assert_eq!(summary.speed, Some(Range { min: 0.5, max: 7.0 }));
        assert_eq!(summary.age, Some(Range { min: 0.0, max: 2.0 }));
        assert_eq!(summary.extent.unwrap().y, Range { min: -5.0, max: 5.0 });
    }

    #[test]
    fn the_extent_of_a_model_holds_panels_and_whole_spheres() {
        let model = Model {
            panels: vec![Panel { corners: [[0.0; 3], [1.0; 3], [2.0; 3], [0.5; 3]], albedo: [0.5; 3] }],
            spheres: vec![Sphere { center: [0.0, 5.0, 0.0], radius: 3.0, albedo: [0.5; 3] }],
            meshes: vec![],
        };
        let extent = ModelSummary::new(&model).extent.unwrap();
        assert_eq!((extent.x, extent.y), (Range { min: -3.0, max: 3.0 }, Range { min: 0.0, max: 8.0 }));
        assert_eq!(ModelSummary::new(&Model::default()).extent, None);
    }
}
