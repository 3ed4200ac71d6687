//! What one particle is worth: the cross section of its droplets, and the shares of it that the voxels' corners get.

/// Density of water (kg/m3), as the files mean it.
const DENSITY: f64 = 1000.0;

/// Extinction cross section (m2) of `mass` kg of water in droplets of `radius` m.
///
/// A droplet that is large against the wavelength takes twice its own disc out of a beam, half of it by diffraction
/// (H. van de Hulst, Light Scattering by Small Particles, 1957, section 8.22): 2 pi r^2 for each of 3 m / (4 pi rho r^3).
pub fn cross_section(mass: f64, radius: f64) -> f64 {
    // Divided first: 6 m would overflow for the largest numbers.
    mass / (4.0 * DENSITY * radius) * 6.0
}

/// Voxels to a standard deviation of the cloud.
pub(super) const PER_DEVIATION: f64 = 2.0;

/// Voxels from a particle to the end of its cloud along an axis: 3.5 deviations, beyond which lies 1/2000 of a Gaussian.
/// Under a brick's width, so that a particle reaches no further than the next brick.
pub(super) const REACH: i32 = 7;

/// Corners that a cloud has along an axis at most.
pub(super) const REACHED: usize = 2 * REACH as usize + 1;

/// Variance of the samples (voxels squared): linear interpolation is a convolution with a hat of variance 1/6, so that what
/// is interpolated has the variance that the cloud should have.
const VARIANCE: f64 = PER_DEVIATION * PER_DEVIATION - 1.0 / 6.0;

/// First and last corner along an axis of a particle at `place` (voxels).
pub(super) fn corners(place: f64) -> [i32; 2] {
    let reach = f64::from(REACH);
    [(place - reach).ceil() as i32, (place + reach).floor() as i32]
}

/// How a cloud's shares at the corners along one axis go on from corner to corner. A Gaussian's values at equal steps: their
/// ratios fall by one and the same factor, so that each brick has them for a few products.
#[derive(Clone, Copy, Debug)]
pub(super) struct Slope {
    /// First and last corner.
    pub(super) corners: [i32; 2],
    /// The first corner's share; all of them are 1 together, whatever the particle's place between corners is.
    share: f64,
    /// The second one's over the first one's.
    ratio: f64,
}

impl Slope {
    /// Of a particle at `place` (voxels).
    pub(super) fn new(place: f64) -> Self {
        let corners = corners(place);
        let start = f64::from(corners[0]) - place;
        let ratio = (-0.5 / VARIANCE * (2.0 * start + 1.0)).exp();
        let mut slope = Self { corners, share: (-0.5 / VARIANCE * start * start).exp(), ratio };
        slope.share /= slope.shares().iter().sum::<f64>();
        slope
    }

    /// Shares of the first corner and of those that follow, 0 past the last.
    #[inline(always)]
    pub(super) fn shares(&self) -> [f64; REACHED] {
        let (mut value, mut ratio) = (self.share, self.ratio);
        let (fall, mut shares) = (*FALL, [0.0; REACHED]);
        for share in &mut shares {
            *share = value;
            value *= ratio;
            ratio *= fall;
        }
        // Between two corners a cloud has one less than on one.
        if self.corners[1] - self.corners[0] + 1 < REACHED as i32 {
            shares[REACHED - 1] = 0.0;
        }
        shares
    }
}

/// What each ratio of shares is of the one before.
static FALL: std::sync::LazyLock<f64> = std::sync::LazyLock::new(|| (-1.0 / VARIANCE).exp());

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_litre_of_mist_stops_light_like_twice_its_discs() {
        let radius: f64 = 5e-5;
        let drops = 1.0 / (1000.0 * 4.0 / 3.0 * std::f64::consts::PI * radius.powi(3));
        let discs = drops * 2.0 * std::f64::consts::PI * radius * radius;
        assert!((cross_section(1.0, radius) / discs - 1.0).abs() < 1e-12 && (discs - 30.0).abs() < 1e-9);
        assert!(cross_section(f64::MAX, 100.0).is_finite() && cross_section(0.0, 1e-6) == 0.0);
    }

    #[test]
    fn shares_add_up_to_one_about_the_particle_with_the_variance_asked_for() {
        for step in 0..40 {
            let place = -3.0 + f64::from(step) * 0.173;
            let slope = Slope::new(place);
            let shares = slope.shares();
            let moment = |power: i32| {
                let at = |index: usize| f64::from(slope.corners[0] + index as i32) - place;
                (0..REACHED).map(|index| shares[index] * at(index).powi(power)).sum::<f64>()
            };
            assert!((moment(0) - 1.0).abs() < 1e-14, "{}", moment(0));
            assert!(moment(1).abs() < 4e-3, "{place}: {}", moment(1));
            // The tails that are cut off hold most of a percent of a Gaussian's variance.
            assert!((moment(2) / VARIANCE - 1.0).abs() < 0.01, "{place}: {}", moment(2));
        }
        assert_eq!(corners(0.0), [-7, 7]);
        assert_eq!(corners(0.5), [-6, 7]);
    }
}
