//! What a frame takes of memory, before its spray is built: bytes by what is in it, and how many particles fit in a budget.
//!
//! The figures are measured (peak of resident memory, x86-64 Linux, one to three million particles, a million columns, two
//! million pixels) and rounded up. Parts that do not depend on chance or on the count of threads are summed alone, so that the same
//! budget gives the same picture anywhere.

use super::LowerError;
use crate::scene::{ParticleRepresentation, Representation, Scene};
use crate::state::Frame;

/// The program, Embree, sky and tables.
const PROGRAM: u64 = 160_000_000;

/// A column as it is read (seven doubles), as splines of water and bed with their boxes, and its looks.
const COLUMN: u64 = 200;

/// A cell of a tessellated column: two triangles and their tree.
const CELL: u64 = 270;

/// A pixel: the picture's channels and mattes, what of them is written, and the state that a checkpoint keeps.
const PIXEL: u64 = 750;

/// A pixel of a deep picture, with some four samples.
const DEEP: u64 = 100;

/// A particle as it is read: eight doubles and an `id`.
const READ: u64 = 80;

/// A particle while its class is found: its neighbours' cells and its shares, above what it takes when it is drawn.
const JUDGED: u64 = 64;

/// A drop that is drawn: place, velocity, size, look and seed, its ball, and the tracer's copy and tree.
const DROP: u64 = 90;

/// As a disc with a normal of its own.
const DISC: u64 = 170;

/// As a streak of two ends and radii, which the tree holds in several boxes.
const STREAK: u64 = 300;

/// A particle in a sheet: densities, the grid's cells around it, and its share of the triangles; of drops apart, each with a surface of
/// its own, which is the most.
const JOINED: u64 = 10_000;

/// A particle in the mist besides the grid: place, velocity, mass, and its cloud while they are sorted.
const CLOUD: u64 = 150;

/// What is drawn of a frame's particles, in counts.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Counts {
    /// Drops, streaks and bubbles that would be drawn.
    pub(super) drawn: usize,
    /// There are streaks among them.
    pub(super) streaks: bool,
    /// Particles in sheets.
    pub(super) joined: usize,
    /// Particles in the mist.
    pub(super) misty: usize,
    /// Bytes of the mist's grid.
    pub(super) mist: u64,
}

/// What one picture takes but for its spray.
#[derive(Clone, Copy, Debug)]
pub(super) struct Account<'a> {
    scene: &'a Scene,
    /// Bytes of everything but what is drawn of particles, in all moments.
    fixed: u64,
    /// Moments that are held at once.
    moments: u64,
}

impl<'a> Account<'a> {
    /// The account of a frame, of which motion blur holds several moments and the next frame, beside `images` bytes of images
    /// on meshes, which all moments share.
    pub(super) fn new(scene: &'a Scene, frame: &Frame, images: u64) -> Self {
        let blurred = scene.camera.motion_steps > 1 && scene.camera.shutter > 0.0;
        let moments = if blurred { u64::from(scene.camera.motion_steps) } else { 1 };
        let states = if blurred { moments + 2 } else { 1 };
        let columns = (frame.columns.nx * frame.columns.nz) as u64;
        let pixels = u64::from(scene.render.width) * u64::from(scene.render.height);
        let pixel = if scene.output.deep.enabled { PIXEL + DEEP } else { PIXEL };
        let count = frame.particles.position.len() as u64;
        let judged = if scene.particles.representation == ParticleRepresentation::Auto { count * JUDGED } else { 0 };
        // Tessellations that follow the screen are taken for even ones.
        let cells = if scene.surface.representation == Representation::Tessellated {
            u64::from(scene.surface.samples).pow(2)
        } else {
            0
        };
        let fixed = PROGRAM
            + images
            + columns * (COLUMN + CELL * cells) * moments
            + pixels * pixel
            + count * READ * states
            + judged;
        Self { scene, fixed, moments }
    }

    /// Bytes of a particle that is drawn.
    fn each(&self, streaks: bool) -> u64 {
        match self.scene.particles.representation {
            ParticleRepresentation::Billboards => DISC,
            _ if streaks => STREAK,
            _ => DROP,
        }
    }

    /// Bytes of what cannot be thinned.
    fn besides(&self, counts: &Counts) -> u64 {
        let spray = counts.joined as u64 * JOINED + counts.misty as u64 * CLOUD + counts.mist;
        self.fixed + self.moments * spray
    }

    /// Bytes of what can be thinned.
    pub(super) fn spray(&self, counts: &Counts) -> u64 {
        self.moments * counts.drawn as u64 * self.each(counts.streaks)
    }

    /// Bytes that a moment's mist may take of a budget.
    ///
    /// # Errors
    /// [`LowerError::Memory`] if the rest does not fit.
    pub(super) fn left_for_mist(&self, budget: u64, misty: usize) -> Result<u64, LowerError> {
        let besides = self.besides(&Counts { misty, ..Counts::default() });
        match budget.checked_sub(besides) {
            Some(left) => Ok(left / self.moments),
            None => Err(LowerError::Memory { budget, needed: besides }),
        }
    }

    /// How many particles can be drawn.
    ///
    /// # Errors
    /// [`LowerError::Memory`] if what cannot be thinned does not fit.
    pub(super) fn most(&self, budget: u64, counts: &Counts) -> Result<usize, LowerError> {
        let besides = self.besides(counts);
        match budget.checked_sub(besides) {
            Some(left) => Ok((left / self.moments / self.each(counts.streaks)) as usize),
            None => Err(LowerError::Memory { budget, needed: besides }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_fits_is_what_is_counted_and_moments_share_it() {
        let mut scene = Scene::default();
        let mut frame = Frame::default();
        (frame.columns.nx, frame.columns.nz) = (100, 100);
        frame.particles.position = vec![[0.0; 3]; 1000];
        let counts = Counts { drawn: 1_000_000, ..Counts::default() };
        let account = Account::new(&scene, &frame, 0);
        let (besides, spray) = (account.besides(&counts), account.spray(&counts));
        assert_eq!(account.most(besides + spray, &counts).unwrap(), 1_000_000);
        assert_eq!(account.most(besides + spray / 2, &counts).unwrap(), 500_000);
        assert!(account.most(besides + spray, &Counts { streaks: true, ..counts }).unwrap() < 400_000);
        assert_eq!(account.most(besides, &counts).unwrap(), 0);
        assert_eq!(Account::new(&scene, &frame, 1 << 30).besides(&counts), besides + (1 << 30));
        scene.camera.motion_steps = 4;
        let blurred = Account::new(&scene, &frame, 0);
        assert_eq!(blurred.spray(&counts), 4 * spray);
        let error = blurred.most(besides, &counts).unwrap_err().to_string();
        assert!(error.contains("--memory") && error.contains("MB"), "{error}");
        assert!(blurred.left_for_mist(1000, 0).is_err());
    }
}
