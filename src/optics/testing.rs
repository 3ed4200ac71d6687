//! What the tests of this room share: random numbers, statistics, directions. Nothing of it is in the program.

use glam::Vec3;

use crate::math::scramble;

/// Uniform numbers in 0 (inclusive) to 1 (exclusive), the same ones for the same seed.
#[derive(Clone, Debug)]
pub(super) struct Uniform {
    state: u64,
}

impl Uniform {
    pub(super) fn new(seed: u64) -> Self {
        Self { state: scramble(seed) }
    }

    pub(super) fn one(&mut self) -> f32 {
        self.state = scramble(self.state);
        // The upper 24 bits: every value of it is a float, and none rounds up to 1.
        (self.state >> 40) as f32 / (1u32 << 24) as f32
    }

    pub(super) fn two(&mut self) -> [f32; 2] {
        [self.one(), self.one()]
    }
}

/// Mean of random values, and how sure it is.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Mean {
    count: f64,
    sum: f64,
    squares: f64,
}

impl Mean {
    pub(super) fn add(&mut self, value: f64) {
        self.count += 1.0;
        self.sum += value;
        self.squares += value * value;
    }

    pub(super) fn value(&self) -> f64 {
        self.sum / self.count
    }

    /// One standard error of the mean.
    pub(super) fn error(&self) -> f64 {
        let mean = self.value();
        ((self.squares / self.count - mean * mean).max(0.0) / (self.count - 1.0)).sqrt()
    }

    /// Whether `truth` lies within `errors` standard errors, of which rounding in single precision is one at the least.
    pub(super) fn agrees(&self, truth: f64, errors: f64) -> bool {
        (self.value() - truth).abs() <= errors * self.error().max(1e-6 * truth.abs())
    }
}

/// Unit vector at a cosine with +y and an azimuth.
pub(super) fn unit(cosine: f32, azimuth: f32) -> Vec3 {
    let sine = ((1.0 - cosine) * (1.0 + cosine)).max(0.0).sqrt();
    Vec3::new(sine * azimuth.cos(), cosine, sine * azimuth.sin())
}

/// `count` unit vectors spread evenly over the sphere (Fibonacci), each for 4 pi / count of it.
pub(super) fn directions(count: usize) -> impl Iterator<Item = Vec3> {
    (0..count).map(move |index| {
        let y = 1.0 - (2 * index + 1) as f64 / count as f64;
        let azimuth = (index as f64 * 2.399_963_229_728_653).rem_euclid(std::f64::consts::TAU);
        let side = (1.0 - y * y).sqrt();
        Vec3::new((side * azimuth.cos()) as f32, y as f32, (side * azimuth.sin()) as f32)
    })
}
