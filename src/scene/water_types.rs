//! What the named waters absorb and scatter, and how that follows from the tables of diffuse attenuation.
//!
//! Jerlov's and Premoze and Ashikhmin's tables hold K_d, the rate at which daylight dims with depth: not absorption. Light
//! that is scattered forward still goes down, on longer ways, so K_d is a little over absorption and far under extinction.
//! Here K_d and scattering together give absorption, by Kirk's relation inverted.

use super::WaterPreset;

/// Wavelengths (nm) that stand for red, green and blue. The tables have entries just there: nothing is interpolated.
///
/// Near the seed table's 650, 545 and 450 nm. Premoze and Ashikhmin's red is Jerlov's entry for 675 nm.
pub const WAVELENGTHS: [f64; 3] = [650.0, 550.0, 450.0];
const PREMOZE_WAVELENGTHS: [f64; 3] = [675.0, 550.0, 450.0];

/// Pure water's absorption (1/m) at 650, 550 and 450 nm (Pope and Fry, Absorption spectrum of pure water, 1997).
const PURE_ABSORPTION: [f64; 3] = [0.340, 0.0565, 0.00922];

/// Kirk's coefficient for light from straight above, K_d averaged over the depth in which daylight falls to 1 %.
const KIRK: f64 = 0.256;

/// Scattering (1/m, 514 nm) of Petzold's three waters: clear ocean, coast, turbid harbour (T. Petzold, Volume scattering
/// functions for selected ocean waters, 1972); absorption there for the last.
const CLEAR_OCEAN: f64 = 0.037;
const COAST: f64 = 0.219;
const HARBOUR: f64 = 1.824;
const HARBOUR_ABSORPTION: f64 = 0.366;

/// What a metre of water takes from light (1/m): red, green, blue.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coefficients {
    /// Absorbed.
    pub absorption: [f64; 3],
    /// Scattered.
    pub scattering: [f64; 3],
}

/// Rate (1/m) at which daylight from straight above dims with depth, averaged from the surface to where 1 % is left.
///
/// Source: J. Kirk, Monte Carlo study of the nature of the underwater light field in, and the relationships between optical
/// properties of, turbid yellow waters, 1981; Dependence of relationship between inherent and apparent optical properties of
/// water on solar altitude, 1984: K_d = sqrt(a^2 + (0.473 m - 0.218) a b) / m, here with the refracted cosine m = 1.
pub fn diffuse_attenuation(absorption: f64, scattering: f64) -> f64 {
    (absorption * absorption + KIRK * absorption * scattering).sqrt()
}

/// The absorption (1/m) of water that dims daylight at a rate of `attenuation` (1/m): [`diffuse_attenuation`] inverted.
pub fn absorption_of(attenuation: f64, scattering: f64) -> f64 {
    let half = 0.5 * KIRK * scattering;
    // The positive root of a^2 + 2 half a - K^2, written without a difference.
    let root = half.hypot(attenuation) + half;
    if root > 0.0 { attenuation * attenuation / root } else { 0.0 }
}

impl WaterPreset {
    /// Absorption and scattering of a named water; `None` for the report's, which is a look.
    ///
    /// *Jerlov* (Marine Optics, 1976, table XXVII, K_d at 650, 550, 450 nm). Scattering at 514 nm, which the table has not:
    /// oceanic types by their pigment C of 0.01, 0.05, 0.1, 0.5 and 1.75 mg/m^3 (Morel 1988), 0.3 C^0.62 and the water's own;
    /// coastal ones by a power of K_d(514) through type III and Petzold's harbour. *Premoze and Ashikhmin* (Rendering natural
    /// waters, 2001), with Petzold's three scatterings: oceans the first, 1 to 5 the second, 7 and 9 the third.
    /// *Harbour*: Petzold's, its absorption over pure water's spread by that of yellow matter, exp(-0.014 (wavelength - 514))
    /// (Bricaud 1981). *River*: 20 g/m^3 of silt, 0.51 m^2/g scattered alike at all wavelengths, 0.041 m^2/g absorbed at 443 nm,
    /// falling by 0.0123 per nm (Babin et al. 2003), and 0.6 1/m of dissolved matter at 443 nm, falling by 0.0176.
    /// *Pure*: Pope and Fry 1997; sea water's molecules, 16.06 * 4.72e-4 (400 / wavelength)^4.32 (Morel 1974).
    ///
    /// No water absorbs less than pure water: where a table says so, pure water's absorption stands.
    pub fn coefficients(self) -> Option<Coefficients> {
        let jerlov = |attenuation, scattering| Some(from_attenuation(attenuation, scattering, WAVELENGTHS));
        let premoze = |attenuation, scattering| Some(from_attenuation(attenuation, scattering, PREMOZE_WAVELENGTHS));
        match self {
            Self::Report => None,
            Self::Pure => Some(Coefficients { absorption: PURE_ABSORPTION, scattering: WAVELENGTHS.map(molecules) }),
            Self::JerlovI => jerlov([0.36, 0.063, 0.019], 0.020),
            Self::JerlovIa => jerlov([0.37, 0.067, 0.026], 0.049),
            Self::JerlovIb => jerlov([0.375, 0.072, 0.036], 0.075),
            Self::JerlovIi => jerlov([0.4, 0.089, 0.068], 0.198),
            Self::JerlovIii => jerlov([0.445, 0.12, 0.135], 0.427),
            Self::Jerlov1c => jerlov([0.45, 0.12, 0.25], 0.491),
            Self::Jerlov3c => jerlov([0.46, 0.19, 0.39], 0.739),
            Self::Jerlov5c => jerlov([0.54, 0.3, 0.56], 1.137),
            Self::Jerlov7c => jerlov([0.63, 0.46, 0.89], 1.755),
            Self::Jerlov9c => jerlov([0.76, 0.63, 1.6], 2.790),
            Self::PremozeI => premoze([0.42, 0.063, 0.019], CLEAR_OCEAN),
            Self::PremozeIi => premoze([0.465, 0.089, 0.068], CLEAR_OCEAN),
            Self::PremozeIii => premoze([0.52, 0.12, 0.135], CLEAR_OCEAN),
            Self::Premoze1 => premoze([0.51, 0.12, 0.25], COAST),
            Self::Premoze3 => premoze([0.56, 0.19, 0.39], COAST),
            Self::Premoze5 => premoze([0.65, 0.3, 0.56], COAST),
            Self::Premoze7 => premoze([0.78, 0.46, 0.89], HARBOUR),
            Self::Premoze9 => premoze([0.92, 0.63, 1.6], HARBOUR),
            Self::Harbour => {
                // Pure water absorbs 0.038 1/m at 514 nm.
                let yellow = |wavelength: f64| (HARBOUR_ABSORPTION - 0.038) * (-0.014 * (wavelength - 514.0)).exp();
                let absorption = std::array::from_fn(|index| PURE_ABSORPTION[index] + yellow(WAVELENGTHS[index]));
                Some(Coefficients { absorption, scattering: WAVELENGTHS.map(|w| particles(HARBOUR, w)) })
            }
            Self::River => {
                let silt = 20.0;
                let absorption = std::array::from_fn(|index| {
                    let above = WAVELENGTHS[index] - 443.0;
                    PURE_ABSORPTION[index] + silt * 0.041 * (-0.0123 * above).exp() + 0.6 * (-0.0176 * above).exp()
                });
                Some(Coefficients { absorption, scattering: WAVELENGTHS.map(|w| silt * 0.51 + molecules(w)) })
            }
        }
    }
}

/// Water whose K_d (1/m) is known at three wavelengths, and its scattering at 514 nm.
fn from_attenuation(attenuation: [f64; 3], scattering: f64, wavelengths: [f64; 3]) -> Coefficients {
    let scattering = wavelengths.map(|wavelength| particles(scattering, wavelength));
    let absorption =
        std::array::from_fn(|index| absorption_of(attenuation[index], scattering[index]).max(PURE_ABSORPTION[index]));
    Coefficients { absorption, scattering }
}

/// Scattering (1/m) at a wavelength (nm) of water that scatters `at_514` at 514 nm (R. Gould et al., Spectral dependence of the
/// scattering coefficient in case 1 and case 2 waters, 1999: a straight line).
fn particles(at_514: f64, wavelength: f64) -> f64 {
    at_514 * (1.62517 - 0.00113 * wavelength) / (1.62517 - 0.00113 * 514.0)
}

/// Scattering (1/m) of sea water without particles at a wavelength (nm).
fn molecules(wavelength: f64) -> f64 {
    16.06 * 4.72e-4 * (400.0 / wavelength).powf(4.32)
}

#[cfg(test)]
mod tests {
    use super::*;

    use WaterPreset::*;

    const OCEANIC: [WaterPreset; 5] = [JerlovI, JerlovIa, JerlovIb, JerlovIi, JerlovIii];
    const COASTAL: [WaterPreset; 5] = [Jerlov1c, Jerlov3c, Jerlov5c, Jerlov7c, Jerlov9c];
    const PREMOZE: [WaterPreset; 8] =
        [PremozeI, PremozeIi, PremozeIii, Premoze1, Premoze3, Premoze5, Premoze7, Premoze9];

    fn of(preset: WaterPreset) -> Coefficients {
        preset.coefficients().unwrap()
    }

    #[test]
    fn absorption_and_attenuation_are_each_others_inverse() {
        for a in [0.0, 1e-6, 0.01, 0.3, 5.0] {
            for b in [0.0, 1e-6, 0.02, 0.5, 30.0] {
                let k = diffuse_attenuation(a, b);
                assert!(k >= a && (absorption_of(k, b) - a).abs() <= 1e-12 * (1.0 + b), "{a} {b}");
            }
        }
        // Kirk's own limits: without scattering the two are the same.
        assert_eq!(diffuse_attenuation(0.3, 0.0), 0.3);
    }

    #[test]
    fn the_tables_come_back_out() {
        let tables = [
            (JerlovI, [0.36, 0.063, 0.019]),
            (JerlovIii, [0.445, 0.12, 0.135]),
            (Jerlov1c, [0.45, 0.12, 0.25]),
            (Jerlov9c, [0.76, 0.63, 1.6]),
            (Premoze3, [0.56, 0.19, 0.39]),
            (Premoze9, [0.92, 0.63, 1.6]),
        ];
        for (preset, attenuation) in tables {
            let Coefficients { absorption, scattering } = of(preset);
            for channel in 0..3 {
                let k = diffuse_attenuation(absorption[channel], scattering[channel]);
                assert!((k / attenuation[channel] - 1.0).abs() < 1e-9, "{preset:?} {channel}: {k}");
            }
        }
    }

    #[test]
    fn no_water_absorbs_less_than_pure_water() {
        for preset in OCEANIC.into_iter().chain(COASTAL).chain(PREMOZE).chain([River, Harbour, Pure]) {
            let Coefficients { absorption, scattering } = of(preset);
            for channel in 0..3 {
                assert!(absorption[channel] >= PURE_ABSORPTION[channel], "{preset:?} {absorption:?}");
                assert!(scattering[channel] >= molecules(WAVELENGTHS[channel]), "{preset:?} {scattering:?}");
            }
        }
        // The clearest ocean is pure water to a few hundredths where particles absorb little.
        let clearest = of(JerlovI).absorption;
        assert!(clearest[0] < 1.06 * PURE_ABSORPTION[0] && clearest[1] < 1.1 * PURE_ABSORPTION[1], "{clearest:?}");
    }

    #[test]
    fn waters_get_murkier_in_their_order() {
        for family in [&OCEANIC[..], &COASTAL, &PREMOZE[..3], &PREMOZE[3..]] {
            for pair in family.windows(2) {
                let (clear, murky) = (of(pair[0]), of(pair[1]));
                for channel in 0..3 {
                    let rate = |water: &Coefficients| {
                        diffuse_attenuation(water.absorption[channel], water.scattering[channel])
                    };
                    assert!(rate(&clear) < rate(&murky), "{pair:?} {channel}");
                }
            }
        }
        // Oceans let blue through, coasts green; a river's brown lets red and green.
        let color = |preset| of(preset).absorption;
        assert!(color(JerlovI)[2] < color(JerlovI)[1] && color(Jerlov3c)[1] < color(Jerlov3c)[2]);
        assert!(color(River)[2] > 2.0 * color(River)[0] && color(Harbour)[2] > color(Harbour)[1]);
    }

    #[test]
    fn scattering_follows_the_stated_rules() {
        let at_514 = |preset| of(preset).scattering[1] / particles(1.0, 550.0);
        for (preset, pigment) in OCEANIC.into_iter().zip([0.01f64, 0.05, 0.1, 0.5, 1.75]) {
            let rule = 0.3 * pigment.powf(0.62) + molecules(514.0);
            assert!((at_514(preset) - rule).abs() < 1e-3, "{preset:?} {rule}");
        }
        // K_d at 514 nm: between the table's 500 and 525.
        let harbour = diffuse_attenuation(HARBOUR_ABSORPTION, HARBOUR);
        let third: f64 = 0.115 + 0.56 * (0.116 - 0.115);
        let power = (HARBOUR / 0.427).ln() / (harbour / third).ln();
        let table = [(0.14, 0.13), (0.22, 0.2), (0.36, 0.31), (0.58, 0.49), (0.99, 0.78)];
        for (preset, (at_500, at_525)) in COASTAL.into_iter().zip(table) {
            let rule = 0.427 * ((at_500 + 0.56 * (at_525 - at_500)) / third).powf(power);
            assert!((at_514(preset) / rule - 1.0).abs() < 5e-3, "{preset:?} {rule}");
        }
    }
}
