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

/// One scene-linear sample → one 8-bit display value.
///
/// `gain` is 2^stops. Negative light counts as none. Rounded to nearest; no dither, so equal light is equal bytes.
pub fn display_value(sample: f32, gain: f64, view: View) -> u8 {
    let linear = (f64::from(sample) * gain).max(0.0);
    let shown = match view {
        View::Srgb => linear.min(1.0),
        View::Filmic => filmic(linear.min(1e30)), // Squared it has to stay finite; white is reached at 12.1.
    };
    (srgb_encode(shown) * 255.0).round() as u8
}

#[cfg(test)]
mod tests {
    use super::*;

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
    fn extremes_stay_in_range() {
        for view in [View::Srgb, View::Filmic] {
            assert_eq!(display_value(f32::MAX, 1e30, view), 255);
            assert_eq!(display_value(-5.0, 1.0, view), 0);
            assert_eq!(display_value(f32::MIN_POSITIVE, 1.0, view), 0);
        }
    }
}
