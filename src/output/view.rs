//! From scene-linear light to what a display shows: exposure, the view's curve, the sRGB encoding, eight bits.
//! Nothing of files here. EXR never passes through this.

use crate::scene::View;

/// Linear 0..1 → sRGB-encoded 0..1.
///
/// *Source*: IEC 61966-2-1:1999, the encoding with its linear toe.
pub fn srgb_encode(linear: f64) -> f64 {
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// A filmic shoulder and toe: scene-linear, 0 and up → display-linear 0..1.
///
/// A white card (1.0) lands at 0.67 (sRGB 0.84), mid grey (0.18) at 0.14 (sRGB 0.41), and white is reached 3.6 stops
/// above the card, so sunlit water keeps its shape. Channels are treated one by one: very bright colours fade to white.
///
/// *Source*: K. Narkowicz, "ACES Filmic Tone Mapping Curve", 2015: the rational fit, with the factor 0.6 that he gives
/// to undo the exposure which the fit contains.
pub fn filmic(scene_linear: f64) -> f64 {
    let x = 0.6 * scene_linear;
    ((x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14)).min(1.0)
}

/// A fit of the Academy's reference rendering and output transforms for an sRGB display: scene-linear Rec.709, 0 and up →
/// display-linear Rec.709, 0..1.
///
/// Channels are mixed before and after the curve, so bright colours fade to white without turning in hue. Mid grey (0.18)
/// lands at 0.106, a white card (1.0) at 0.62; white is reached 4.7 stops above it.
///
/// *Source*: S. Hill's fit of RRT and ODT, with its matrices (Rec.709 → AP1 with the RRT's desaturation; ODT's desaturation
/// → Rec.709), in M. Pettineo and S. Hill, "BakingLab", ACES.hlsl, 2016.
pub fn aces(scene_linear: [f64; 3]) -> [f64; 3] {
    const TO_RENDERING: [[f64; 3]; 3] =
        [[0.59719, 0.35458, 0.04823], [0.07600, 0.90834, 0.01566], [0.02840, 0.13383, 0.83777]];
    const TO_DISPLAY: [[f64; 3]; 3] =
        [[1.60475, -0.53108, -0.07367], [-0.10208, 1.10813, -0.00605], [-0.00327, -0.07276, 1.07602]];
    let mixed = |matrix: [[f64; 3]; 3], color: [f64; 3]| {
        matrix.map(|row| row.into_iter().zip(color).map(|(factor, value)| factor * value).sum::<f64>())
    };
    let curve = |x: f64| (x * (x + 0.024_578_6) - 0.000_090_537) / (x * (0.983_729 * x + 0.432_951) + 0.238_081);
    mixed(TO_DISPLAY, mixed(TO_RENDERING, scene_linear).map(curve)).map(|value| value.clamp(0.0, 1.0))
}

/// One scene-linear colour → 8-bit display values.
///
/// `gain` is 2^stops. Negative light counts as none. Rounded to nearest; no dither, so equal light is equal bytes.
pub fn display_values(color: [f32; 3], gain: f64, view: View) -> [u8; 3] {
    // Squared it has to stay finite; every view is white long before.
    let linear = color.map(|sample| (f64::from(sample) * gain).clamp(0.0, 1e30));
    let shown = match view {
        View::Srgb => linear.map(|value| value.min(1.0)),
        View::Filmic => linear.map(filmic),
        View::Aces => aces(linear),
    };
    shown.map(|value| (srgb_encode(value) * 255.0).round() as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn display_value(sample: f32, gain: f64, view: View) -> u8 {
        display_values([sample; 3], gain, view)[0]
    }

    #[test]
    fn srgb_is_the_standards_curve() {
        // Both pieces meet at the breakpoint, and the ends are exact.
        assert!((12.92 * 0.003_130_8 - srgb_encode(0.003_130_801)).abs() < 1e-6);
        assert_eq!(display_value(0.0, 1.0, View::Srgb), 0);
        assert_eq!(display_value(1.0, 1.0, View::Srgb), 255);
        // The inverse, written independently: every 8-bit value survives decode and encode.
        for v in 0..=255u8 {
            let c = f64::from(v) / 255.0;
            let linear = if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) };
            assert_eq!(display_value(linear as f32, 1.0, View::Srgb), v);
        }
    }

    #[test]
    fn exposure_is_in_stops() {
        assert_eq!(display_value(0.25, 4.0, View::Srgb), 255);
        assert_eq!(display_value(0.36, 0.5, View::Filmic), display_value(0.18, 1.0, View::Filmic));
    }

    #[test]
    fn filmic_keeps_daylight_natural_and_rolls_off() {
        let grey = srgb_encode(filmic(0.18));
        let card = srgb_encode(filmic(1.0));
        assert!((0.40..0.50).contains(&grey), "mid grey {grey}");
        assert!((0.80..0.90).contains(&card), "white card {card}");
        assert_eq!(filmic(0.0), 0.0);
        let mut last = -1.0;
        for i in 0..1000 {
            let y = filmic(i as f64 * 0.0125);
            assert!(y >= last && y <= 1.0);
            last = y;
        }
        assert!(filmic(10.0) < 1.0 && filmic(12.1) == 1.0);
    }

    #[test]
    fn aces_keeps_greys_grey_and_follows_its_curve() {
        assert_eq!(aces([0.0; 3]), [0.0; 3]);
        // The matrices' rows add up to 1 within 1e-5, so that greys see the curve alone: at 0.18 its closed form is
        // (0.18 * 0.2045786 - 0.000090537) / (0.18 * 0.61002222 + 0.238081).
        let grey = 0.036_733_611 / 0.347_885;
        for value in aces([0.18; 3]) {
            assert!((value - grey).abs() < 1e-5, "{value} {grey}");
        }
        let mut last = [-1.0; 3];
        for stop in 0..400 {
            let shown = aces([0.001 * (0.05 * f64::from(stop)).exp2(); 3]);
            for (value, last) in shown.into_iter().zip(last) {
                assert!(value >= last && value <= 1.0);
                assert!((value - shown[0]).abs() < 1e-4, "{shown:?}");
            }
            last = shown;
        }
        assert_eq!(last, [1.0; 3]);
        assert!(aces([20.0; 3])[1] < 1.0 && aces([27.0; 3]) == [1.0; 3]);
    }

    #[test]
    fn aces_turns_bright_colours_white_and_stays_in_range() {
        for color in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.02, 0.6]] {
            let shown = |gain: f64| aces(color.map(|value| value * gain));
            let spread =
                |shown: [f64; 3]| shown.into_iter().fold(0.0, f64::max) - shown.into_iter().fold(1.0, f64::min);
            assert!(spread(shown(0.5)) > 0.1, "{:?}", shown(0.5));
            let mut gain = 1e-4;
            while gain < 1e12 {
                assert!(shown(gain).iter().all(|value| (0.0..=1.0).contains(value)), "{gain}: {:?}", shown(gain));
                gain *= 1.3;
            }
            assert!(spread(shown(1e6)) < 1e-3, "{:?}", shown(1e6));
        }
    }

    #[test]
    fn extremes_stay_in_range() {
        for view in [View::Srgb, View::Filmic, View::Aces] {
            assert_eq!(display_value(f32::MAX, 1e30, view), 255);
            assert_eq!(display_value(-5.0, 1.0, view), 0);
            assert_eq!(display_value(f32::MIN_POSITIVE, 1.0, view), 0);
        }
    }
}
