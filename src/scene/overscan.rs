//! How far a picture reaches beyond its frame, as a share of it or in pixels.

/// Pixels around the frame, for a compositor that blurs, shakes or bends the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Overscan {
    /// Percent of the frame's width to the left and to the right, of its height above and below.
    Percent(f64),
    /// As many pixels on every side.
    Pixels(u32),
}

impl Overscan {
    /// What may be written.
    pub const EXPECTED: &str = "a share of the frame up to 100%, as \"5%\", or pixels up to 16384, as \"64px\"";

    /// The overscan of a text, `None` unless it is [`Overscan::EXPECTED`].
    pub fn parse(text: &str) -> Option<Self> {
        // Digits and a point alone: `1e1%` and `inf%` are no sizes that anybody means.
        let plain = |digits: &str| digits.bytes().all(|byte| byte.is_ascii_digit() || byte == b'.');
        let text = text.trim();
        if let Some(digits) = text.strip_suffix('%').map(str::trim_end) {
            let percent: f64 = digits.parse().ok().filter(|_| plain(digits))?;
            return (percent <= 100.0).then_some(Self::Percent(percent));
        }
        let pixels: u32 = text.strip_suffix("px").map(str::trim_end)?.parse().ok()?;
        (pixels <= 16384).then_some(Self::Pixels(pixels))
    }

    /// Pixels at either side, and above and below, of a frame of a size. Shares are rounded up to whole pixels.
    pub fn margins(self, width: u32, height: u32) -> [u32; 2] {
        match self {
            Self::Pixels(pixels) => [pixels; 2],
            Self::Percent(percent) => [width, height].map(|size| (percent * f64::from(size) / 100.0).ceil() as u32),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_and_pixels_are_margins() {
        for (text, margins) in [
            ("5%", [64, 36]),
            ("0.05 %", [1, 1]),
            ("7%", [90, 51]),
            ("100%", [1280, 720]),
            ("0%", [0, 0]),
            ("64px", [64, 64]),
            (" 1 px", [1, 1]),
        ] {
            assert_eq!(Overscan::parse(text).map(|overscan| overscan.margins(1280, 720)), Some(margins), "{text}");
        }
        for text in ["", "5", "%", "px", "-5%", "nan%", "inf%", "1e1%", "101%", "1.5px", "99999px", "-1px", "5%px"] {
            assert_eq!(Overscan::parse(text), None, "{text}");
        }
    }
}
