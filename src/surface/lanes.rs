//! Up to sixteen rays at once, as a surface is asked: plain arrays, so that any accelerator can fill them.

use glam::Vec3;

use super::SolveCounts;

/// Rays per packet, whatever the processor's own width.
pub const LANES: usize = 16;

/// Sixteen rays in the scene's local frame; lanes outside `active` are ignored.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub struct LaneRays {
    /// Origins: x, y, z.
    pub origin: [[f32; LANES]; 3],
    /// Directions: x, y, z; any length.
    pub direction: [[f32; LANES]; 3],
    /// Least t that counts.
    pub tnear: [f32; LANES],
    /// Greatest t that counts, inclusive.
    pub tfar: [f32; LANES],
    /// Tolerance of a hit, in t.
    pub tolerance: [f32; LANES],
    /// Growth of the tolerance per unit of t.
    pub tolerance_growth: f32,
    /// Bit per lane that holds a ray.
    pub active: u16,
}

impl LaneRays {
    /// No rays.
    pub const EMPTY: Self = Self {
        origin: [[0.0; LANES]; 3],
        direction: [[0.0; LANES]; 3],
        tnear: [0.0; LANES],
        tfar: [0.0; LANES],
        tolerance: [0.0; LANES],
        tolerance_growth: 0.0,
        active: 0,
    };

    /// Up to sixteen rays (origin, direction) from t = 0 on without end, with one tolerance (in t); more are left out.
    pub fn unbounded(rays: &[(Vec3, Vec3)], tolerance: f32) -> Self {
        let mut lanes = Self::EMPTY;
        for (lane, (origin, direction)) in rays.iter().enumerate().take(LANES) {
            for axis in 0..3 {
                lanes.origin[axis][lane] = origin[axis];
                lanes.direction[axis][lane] = direction[axis];
            }
            lanes.tfar[lane] = f32::INFINITY;
            lanes.tolerance[lane] = tolerance;
            lanes.active |= 1 << lane;
        }
        lanes
    }
}

impl LaneRays {
    /// Bit per lane that holds a ray at all: finite, with a direction, an interval that is not empty and a tolerance of
    /// at least 0.
    pub fn sound(&self) -> u16 {
        let mut sound = 0;
        for lane in 0..LANES {
            let (mut finite, mut somewhere) = (true, false);
            for axis in 0..3 {
                finite &= self.origin[axis][lane].abs() < f32::INFINITY;
                finite &= self.direction[axis][lane].abs() < f32::INFINITY;
                somewhere |= self.direction[axis][lane] != 0.0;
            }
            let interval = (self.tnear[lane] >= 0.0) & (self.tnear[lane] < self.tfar[lane]);
            let tolerance = (self.tolerance[lane] >= 0.0) & (self.tolerance[lane] < f32::INFINITY);
            sound |= u16::from(finite & somewhere & interval & tolerance) << lane;
        }
        sound
    }
}

/// Answers of a packet: only lanes whose bit is set in `hit` are written.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub struct LaneHits {
    /// Distance in lengths of the direction.
    pub t: [f32; LANES],
    /// Primitive: patch index, or side.
    pub primitive: [u32; LANES],
    /// Place within the patch along x, 0..1.
    pub u: [f32; LANES],
    /// Place within the patch along z, 0..1.
    pub v: [f32; LANES],
    /// Normal, upward (outward for sides), any length: x, y, z.
    pub normal: [[f32; LANES]; 3],
    /// Bit per lane that hit within `tnear..=tfar`.
    pub hit: u16,
    /// Bit per lane for which the solver could not decide.
    pub gave_up: u16,
}

impl LaneHits {
    /// All lanes missing.
    pub const EMPTY: Self = Self {
        t: [f32::INFINITY; LANES],
        primitive: [0; LANES],
        u: [0.0; LANES],
        v: [0.0; LANES],
        normal: [[0.0; LANES]; 3],
        hit: 0,
        gave_up: 0,
    };
}

/// One ray in the scene's local frame.
#[derive(Clone, Copy, Debug)]
pub struct SingleRay {
    /// Origin: x, y, z.
    pub origin: [f32; 3],
    /// Direction, any length.
    pub direction: [f32; 3],
    /// Least and greatest t that count, the latter inclusive.
    pub range: [f32; 2],
    /// Tolerance of a hit, in t.
    pub tolerance: f32,
    /// Growth of the tolerance per unit of t.
    pub tolerance_growth: f32,
}

/// A hit of one ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SingleHit {
    /// Distance in lengths of the direction.
    pub t: f32,
    /// Primitive: patch index, or side.
    pub primitive: u32,
    /// Place within the patch along x and z, 0..1.
    pub uv: [f32; 2],
    /// Normal, upward (outward for sides), any length.
    pub normal: [f32; 3],
}

/// What a surface says of one ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SingleAnswer {
    /// The first hit; of no account but that there is one where any hit was asked for.
    Hit(SingleHit),
    /// None.
    Miss,
    /// The solver could not decide.
    GaveUp,
}

/// A surface that answers sixteen rays at a time.
pub trait LaneSurface: Send + Sync {
    /// Least and greatest corner of a box that holds the whole surface (rounded outward).
    fn bounds(&self) -> [Vec3; 2];
    /// First hit of each active lane; `hit` and `gave_up` are set anew, other fields where there is a hit.
    fn closest(&self, rays: &LaneRays, hits: &mut LaneHits, counts: &mut SolveCounts);
    /// Bit per active lane that hits anything.
    fn occluded(&self, rays: &LaneRays, counts: &mut SolveCounts) -> u16;
    /// First hit of each active lane of many packets that have one growth of the tolerance; as many `hits` as packets.
    /// Rays of all packets may share their lanes; a ray's answer does not depend on its neighbours.
    fn closest_stream(&self, rays: &[LaneRays], hits: &mut [LaneHits], counts: &mut SolveCounts) {
        for (rays, hits) in rays.iter().zip(hits) {
            self.closest(rays, hits, counts);
        }
    }
    /// The lanes of many packets that hit anything, as bits of `hit`.
    fn occluded_stream(&self, rays: &[LaneRays], hits: &mut [LaneHits], counts: &mut SolveCounts) {
        for (rays, hits) in rays.iter().zip(hits) {
            hits.hit = self.occluded(rays, counts);
        }
    }
    /// The first hit (`any`: whether there is one) of one ray that comes alone. Bits may differ from a packet's: pictures
    /// are made of packets.
    fn single(&self, ray: &SingleRay, any: bool, counts: &mut SolveCounts) -> SingleAnswer {
        let mut rays = LaneRays { tolerance_growth: ray.tolerance_growth, active: 1, ..LaneRays::EMPTY };
        for axis in 0..3 {
            rays.origin[axis][0] = ray.origin[axis];
            rays.direction[axis][0] = ray.direction[axis];
        }
        (rays.tnear[0], rays.tfar[0], rays.tolerance[0]) = (ray.range[0], ray.range[1], ray.tolerance);
        let mut hits = LaneHits::EMPTY;
        if any {
            hits.hit = self.occluded(&rays, counts);
        } else {
            self.closest(&rays, &mut hits, counts);
        }
        if hits.hit & 1 == 1 {
            let normal = hits.normal.map(|axis| axis[0]);
            SingleAnswer::Hit(SingleHit {
                t: hits.t[0],
                primitive: hits.primitive[0],
                uv: [hits.u[0], hits.v[0]],
                normal,
            })
        } else if hits.gave_up & 1 == 1 {
            SingleAnswer::GaveUp
        } else {
            SingleAnswer::Miss
        }
    }
    /// Bytes held above the heights themselves.
    fn bytes(&self) -> u64;
}

/// A point of a surface, evaluated from the surface itself rather than along a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// Position in the local frame.
    pub position: Vec3,
    /// Unit normal, upward.
    pub normal: Vec3,
}
