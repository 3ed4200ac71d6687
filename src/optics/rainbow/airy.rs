//! Two integrals of diffraction, each in a table: that of Airy's function squared, and the light within a cone behind a disc.

use std::f64::consts::{FRAC_PI_4, PI};

/// Steps of Airy's table to one.
const AIRY_STEPS: f64 = 50.0;

/// Where Airy's table begins: below, the integral is its mean to 1e-4.
const LIT: f64 = -60.0;

/// Steps of the cone's table to one.
const CONE_STEPS: f64 = 100.0;

/// Where the cone's table ends: beyond, the share outside is its mean, 2 / (pi u), to 1e-4.
const CONE: f64 = 60.0;

/// Both tables.
pub(super) struct Airy {
    square: Vec<f64>,
    cone: Vec<f64>,
}

impl Airy {
    /// Beyond this Airy's function squared is under 1e-14.
    pub(super) const DARK: f64 = 8.0;

    pub(super) fn new() -> Self {
        // Downwards from where it is e^-15: upwards its other solution would grow instead.
        let zeta = 2.0 / 3.0 * Self::DARK.powf(1.5);
        let (mut y, mut slope) = (1.0 - 5.0 / (72.0 * zeta), -Self::DARK.sqrt() * (1.0 + 7.0 / (72.0 * zeta)));
        let count = ((Self::DARK - LIT) * AIRY_STEPS) as usize;
        let fine = 4;
        let step = -1.0 / (AIRY_STEPS * f64::from(fine));
        let mut values = Vec::with_capacity(count + 1);
        let mut scale = 1.0;
        for index in 0..=count {
            let s = Self::DARK - index as f64 / AIRY_STEPS;
            values.push([s, y, slope]);
            if s.abs() < 0.5 / AIRY_STEPS {
                // Ai(0) = 3^(-2/3) / Gamma(2/3).
                scale = 0.355_028_053_887_817_2 / y;
            }
            for sub in 0..fine {
                let s = s + step * f64::from(sub);
                [y, slope] = runge_kutta(s, [y, slope], step);
            }
        }
        values.reverse();
        let square = values.into_iter().map(|[s, y, slope]| scale * scale * (s * y * y - slope * slope)).collect();
        let cone = (0..=(CONE * CONE_STEPS) as usize)
            .map(|index| {
                let u = index as f64 / CONE_STEPS;
                1.0 - libm::j0(u).powi(2) - libm::j1(u).powi(2)
            })
            .collect();
        Self { square, cone }
    }

    /// Integral of Ai^2 up to `s`, but for a constant: s Ai^2 - Ai'^2.
    pub(super) fn square_below(&self, s: f64) -> f64 {
        if s < LIT {
            return -(-s).sqrt() / PI;
        }
        interpolated(&self.square, (s - LIT) * AIRY_STEPS)
    }

    /// Share of the light diffracted by a disc that is within a cone, u = circumference in wavelengths times its sine.
    pub(super) fn encircled(&self, u: f64) -> f64 {
        if u >= CONE { 1.0 - 0.5 / (FRAC_PI_4 * u) } else { interpolated(&self.cone, u * CONE_STEPS) }
    }
}

fn interpolated(table: &[f64], place: f64) -> f64 {
    let index = (place as usize).min(table.len() - 2);
    let share = (place - index as f64).min(1.0);
    table[index] + share * (table[index + 1] - table[index])
}

/// One step of y'' = s y.
fn runge_kutta(s: f64, [y, slope]: [f64; 2], step: f64) -> [f64; 2] {
    let of = |s: f64, [y, slope]: [f64; 2]| [slope, s * y];
    let ahead = |by: f64, k: [f64; 2]| [y + by * k[0], slope + by * k[1]];
    let a = of(s, [y, slope]);
    let b = of(s + 0.5 * step, ahead(0.5 * step, a));
    let c = of(s + 0.5 * step, ahead(0.5 * step, b));
    let d = of(s + step, ahead(step, c));
    let mean = |axis: usize| (a[axis] + 2.0 * b[axis] + 2.0 * c[axis] + d[axis]) / 6.0;
    [y + step * mean(0), slope + step * mean(1)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_tables_have_known_values() {
        let airy = Airy::new();
        // Ai'(0) = -0.2588194; Ai(1) = 0.1352924, Ai'(1) = -0.1591474; Ai(-5) = 0.3507610, Ai'(-5) = 0.3271928 (NIST DLMF 9).
        for (s, y, slope) in
            [(0.0, 0.355_028_05, -0.258_819_40), (1.0, 0.135_292_42, -0.159_147_44), (-5.0, 0.350_761_01, 0.327_192_82)]
        {
            assert!((airy.square_below(s) - (s * y * y - slope * slope)).abs() < 1e-6, "{s}");
        }
        assert!((airy.square_below(LIT) - airy.square_below(LIT - 1e-9)).abs() < 1e-3);
        // Within the first dark ring are 83.8 % of the light.
        assert!((airy.encircled(3.8317) - 0.8378).abs() < 1e-4);
        assert!((airy.encircled(CONE) - airy.encircled(CONE - 1e-9)).abs() < 1e-3);
    }
}
