//! What fits in one word of a command line: frame lists, crops, accuracies, grid sizes. Text → plain values.

use std::collections::HashSet;
use std::str::FromStr;

use crate::output::Window;
use crate::scene::{self, BYTE_UNITS, Override};

/// A word that does not say what it should.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected {expected}")]
pub struct Malformed {
    /// What should stand there.
    pub expected: String,
}

fn malformed(expected: impl Into<String>) -> Malformed {
    Malformed { expected: expected.into() }
}

/// Frame numbers as typed: `7`, `1-48`, `1-48x2` (every second), and lists of these: `1-10,20,30-90x5`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FrameSelection {
    numbers: Vec<i64>,
}

impl FrameSelection {
    /// The most frames that one selection holds: eleven hours of film.
    pub const MOST: usize = 1_000_000;

    /// One frame.
    pub fn one(number: i64) -> Self {
        Self { numbers: vec![number] }
    }

    /// The numbers in the order in which they were typed, each once; at least one.
    pub fn numbers(&self) -> &[i64] {
        &self.numbers
    }
}

impl FromStr for FrameSelection {
    type Err = Malformed;

    fn from_str(text: &str) -> Result<Self, Malformed> {
        let mut numbers = Vec::new();
        let mut seen = HashSet::new();
        for part in text.split(',') {
            let part = part.trim();
            let (range, step) = match part.split_once('x') {
                Some((range, step)) => (range, Some(frame_number(step, part)?)),
                None => (part, None),
            };
            let (first, last) = match range.split_once('-') {
                Some((first, last)) => (frame_number(first, part)?, frame_number(last, part)?),
                None if step.is_some() => return Err(not_frames(part)),
                None => {
                    let number = frame_number(range, part)?;
                    (number, number)
                }
            };
            if first > last {
                return Err(malformed(format!("the lesser frame first: {last}-{first} instead of {first}-{last}")));
            }
            let step = step.unwrap_or(1);
            if step == 0 {
                return Err(malformed(format!("a step of at least 1 after the x in {part}")));
            }
            let mut number = Some(first);
            while let Some(frame) = number.filter(|number| *number <= last) {
                if seen.insert(frame) {
                    numbers.push(frame);
                }
                if numbers.len() > Self::MOST {
                    return Err(malformed(format!("at most {} frames", Self::MOST)));
                }
                number = frame.checked_add(step);
            }
        }
        Ok(Self { numbers })
    }
}

fn frame_number(digits: &str, part: &str) -> Result<i64, Malformed> {
    if digits.is_empty() || !digits.bytes().all(|byte| byte.is_ascii_digit()) {
        return Err(not_frames(part));
    }
    digits.parse().map_err(|_| malformed(format!("frame numbers of at most {}, not {digits}", i64::MAX)))
}

fn not_frames(part: &str) -> Malformed {
    malformed(format!("frames as 7, 1-48, 1-48x2 or a list of these with commas, not `{part}`"))
}

/// A rectangle of pixels as typed: `X0,Y0,X1,Y1` from the upper left, X1 and Y1 exclusive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Crop {
    corners: [u32; 4],
}

impl Crop {
    /// The crop as a window of a frame.
    ///
    /// # Errors
    /// It reaches beyond the frame.
    pub fn window(self, width: u32, height: u32) -> Result<Window, Malformed> {
        let [x0, y0, x1, y1] = self.corners;
        if x1 > width || y1 > height {
            return Err(malformed(format!(
                "a crop within 0,0,{width},{height}, which is the whole frame, not {x0},{y0},{x1},{y1}"
            )));
        }
        // The frame is at most 65536 pixels wide and high (the scene's schema), so both fit.
        Ok(Window { x: x0 as i32, y: y0 as i32, width: x1 - x0, height: y1 - y0 })
    }
}

impl FromStr for Crop {
    type Err = Malformed;

    fn from_str(text: &str) -> Result<Self, Malformed> {
        let numbers: Option<Vec<u32>> = text.split(',').map(|number| number.trim().parse().ok()).collect();
        match numbers.as_deref() {
            Some(&[x0, y0, x1, y1]) if x0 < x1 && y0 < y1 => Ok(Self { corners: [x0, y0, x1, y1] }),
            Some(&[x0, y0, x1, y1]) => Err(malformed(format!(
                "at least one pixel: {x0} < {x1} and {y0} < {y1} do not both hold (X1 and Y1 are exclusive)"
            ))),
            _ => Err(malformed("four whole numbers X0,Y0,X1,Y1 in pixels from the upper left, as 0,0,640,360")),
        }
    }
}

/// A share of a picture's tiles as typed: `I/N`, I from 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Share {
    /// Which.
    pub index: u32,
    /// Of how many.
    pub count: u32,
}

impl FromStr for Share {
    type Err = Malformed;

    fn from_str(text: &str) -> Result<Self, Malformed> {
        let numbers = text.split_once('/').and_then(|(index, count)| Some((index.parse().ok()?, count.parse().ok()?)));
        match numbers {
            Some((index, count)) if (1..=count).contains(&index) => Ok(Self { index, count }),
            _ => Err(malformed("I/N, the I-th of N shares from 1/N to N/N, as 2/4")),
        }
    }
}

/// Where a viewer listens, as typed: `HOST` or `HOST:PORT`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Viewer {
    /// Name or address.
    pub host: String,
    /// By default the one that tev listens at.
    pub port: u16,
}

impl Viewer {
    const PORT: u16 = 14158;
}

impl FromStr for Viewer {
    type Err = Malformed;

    fn from_str(text: &str) -> Result<Self, Malformed> {
        // An address of IPv6 has colons of its own: with a port it stands in brackets.
        let (host, port) = match text.strip_prefix('[').and_then(|rest| rest.split_once(']')) {
            Some((host, "")) => (host, None),
            Some((host, rest)) => (host, Some(rest.strip_prefix(':').unwrap_or(""))),
            None => match text.split_once(':') {
                Some((_, rest)) if rest.contains(':') && text.parse::<std::net::Ipv6Addr>().is_ok() => (text, None),
                Some((host, port)) => (host, Some(port)),
                None => (text, None),
            },
        };
        let port = port.map_or(Some(Self::PORT), |port| port.parse().ok().filter(|&port| port != 0));
        match port {
            Some(port) if !host.is_empty() => Ok(Self { host: host.to_owned(), port }),
            _ => Err(malformed("HOST or HOST:PORT, as 127.0.0.1 or studio:14158")),
        }
    }
}

/// Samples of each pixel as typed: `A-B`, from 0, B exclusive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SampleRange {
    /// The first, and the one after the last.
    pub ends: [u32; 2],
}

impl FromStr for SampleRange {
    type Err = Malformed;

    fn from_str(text: &str) -> Result<Self, Malformed> {
        let numbers = text.split_once('-').and_then(|(first, end)| Some([first.parse().ok()?, end.parse().ok()?]));
        match numbers {
            Some(ends) if ends[0] < ends[1] => Ok(Self { ends }),
            _ => Err(malformed("A-B, the samples from A on and before B, as 0-64")),
        }
    }
}

/// How near a hit must be to the true one: `0.05px` or `1e-4m`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Accuracy {
    /// Of a pixel's footprint.
    Pixels(String),
    /// Metres along the ray.
    Metres(String),
}

impl Accuracy {
    /// The scene's keys that say the same.
    pub(super) fn overrides(&self) -> Vec<Override> {
        const OPTION: &str = "--accuracy";
        match self {
            // A tolerance in metres would win over the pixels that were asked for.
            Self::Pixels(number) => vec![
                Override::unset(OPTION, "surface.tolerance"),
                Override::by_option(OPTION, "surface.accuracy", number),
            ],
            Self::Metres(number) => vec![Override::by_option(OPTION, "surface.tolerance", number)],
        }
    }
}

impl FromStr for Accuracy {
    type Err = Malformed;

    fn from_str(text: &str) -> Result<Self, Malformed> {
        let number = |digits: &str| {
            let number: Option<f64> = digits.trim().parse().ok().filter(|number: &f64| number.is_finite());
            // `{:?}` writes every float as TOML reads it.
            number.map(|number| format!("{number:?}"))
        };
        let accuracy = match (text.strip_suffix("px"), text.strip_suffix('m')) {
            (Some(digits), _) => number(digits).map(Self::Pixels),
            (None, Some(digits)) => number(digits).map(Self::Metres),
            (None, None) => None,
        };
        accuracy.ok_or_else(|| malformed("a number with its unit, px or m, as 0.05px or 1e-4m"))
    }
}

/// Memory: `512M`, `8G`, in powers of 1000.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bytes(pub u64);

impl FromStr for Bytes {
    type Err = Malformed;

    fn from_str(text: &str) -> Result<Self, Malformed> {
        scene::bytes(text).map(Self).ok_or_else(|| malformed(scene::EXPECTED_BYTES))
    }
}

impl std::fmt::Display for Bytes {
    fn fmt(&self, out: &mut std::fmt::Formatter) -> std::fmt::Result {
        let unit = (0..BYTE_UNITS.len() - 1).rev().find(|&unit| self.0 >= 1000u64.pow(unit as u32)).unwrap_or(0);
        let number = self.0 as f64 / 1000f64.powi(unit as i32);
        // Three digits, without zeros that say nothing.
        let text = format!("{:.*}", if number < 10.0 { 2 } else { 1 }, number);
        write!(out, "{} {}B", text.trim_end_matches('0').trim_end_matches('.'), BYTE_UNITS[unit])
    }
}

/// A grid's size: `400x400`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GridSize {
    /// Columns along x.
    pub nx: u32,
    /// Columns along z.
    pub nz: u32,
}

impl FromStr for GridSize {
    type Err = Malformed;

    fn from_str(text: &str) -> Result<Self, Malformed> {
        // Fewer than 3x3 columns is no frame (docs/formats.md, section 1); 16384 squared is a gigabyte of heights.
        let count = |digits: &str| digits.parse::<u32>().ok().filter(|count| (3..=16384).contains(count));
        let size = text.split_once('x').and_then(|(nx, nz)| Some(Self { nx: count(nx)?, nz: count(nz)? }));
        size.ok_or_else(|| malformed("columns as NXxNZ, each from 3 to 16384, as 400x400"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frames(text: &str) -> Result<Vec<i64>, String> {
        text.parse().map(|frames: FrameSelection| frames.numbers).map_err(|error: Malformed| error.to_string())
    }

    #[test]
    fn frames_are_numbers_ranges_and_steps() {
        assert_eq!(frames("7"), Ok(vec![7]));
        assert_eq!(frames("1-4"), Ok(vec![1, 2, 3, 4]));
        assert_eq!(frames("1-8x3"), Ok(vec![1, 4, 7]));
        assert_eq!(frames("0010, 1-3,2-5x3"), Ok(vec![10, 1, 2, 3, 5]));
        assert_eq!(frames("9223372036854775806-9223372036854775807x9"), Ok(vec![i64::MAX - 1]));
        for (text, part) in [
            ("", "not ``"),
            ("a", "not `a`"),
            ("1-", "not `1-`"),
            ("-5", "not `-5`"),
            ("5x2", "not `5x2`"),
            ("1,,2", "not ``"),
            ("5-1", "1-5 instead of 5-1"),
            ("1-5x0", "a step of at least 1"),
            ("0-99999999999", "at most 1000000 frames"),
            ("99999999999999999999", "at most 9223372036854775807"),
        ] {
            assert!(frames(text).is_err_and(|message| message.contains(part)), "{text}: {:?}", frames(text));
        }
    }

    #[test]
    fn a_crop_is_a_window_within_the_frame() {
        let crop: Crop = "10,20,30,60".parse().expect("a crop");
        assert_eq!(crop.window(30, 60), Ok(Window { x: 10, y: 20, width: 20, height: 40 }));
        assert!(crop.window(29, 60).is_err_and(|error| error.expected.contains("0,0,29,60")));
        for text in ["", "1,2,3", "5,5,5,9", "0,9,5,5", "-1,0,5,5", "0,0,1.5,2", "0,0,1,99999999999"] {
            assert!(text.parse::<Crop>().is_err(), "{text}");
        }
    }

    #[test]
    fn parts_of_a_picture_are_counted_from_1_and_samples_from_0() {
        assert_eq!("2/4".parse(), Ok(Share { index: 2, count: 4 }));
        for text in ["0/4", "5/4", "2", "2/", "a/b", "-1/4"] {
            assert!(text.parse::<Share>().is_err(), "{text}");
        }
        assert_eq!("16-32".parse(), Ok(SampleRange { ends: [16, 32] }));
        for text in ["16", "32-16", "16-16", "-1-5", "a-b"] {
            assert!(text.parse::<SampleRange>().is_err(), "{text}");
        }
    }

    #[test]
    fn an_accuracy_carries_its_unit() {
        assert_eq!("0.05px".parse(), Ok(Accuracy::Pixels("0.05".into())));
        assert_eq!("1e-4m".parse(), Ok(Accuracy::Metres("0.0001".into())));
        for text in ["", "1", "px", "m", "nanpx", "infm", "1 cm"] {
            assert!(text.parse::<Accuracy>().is_err(), "{text}");
        }
    }

    #[test]
    fn memory_has_a_unit_and_is_some() {
        for (text, bytes) in [
            ("8G", 8_000_000_000),
            ("512M", 512_000_000),
            ("1.5gb", 1_500_000_000),
            ("2T", 2_000_000_000_000),
            ("64", 64),
        ] {
            assert_eq!(text.parse(), Ok(Bytes(bytes)));
        }
        for text in
            ["", "G", "0", "0G", "-1G", "nanG", "infG", "1e30", "8X", "8 apples", "1e3G", "99999999999999T", "8Gi"]
        {
            assert!(text.parse::<Bytes>().is_err_and(|error| error.expected.contains("512M")), "{text}");
        }
        let shown = [999, 1500, 8_000_000_000, 123_456_789].map(|bytes| Bytes(bytes).to_string());
        assert_eq!(shown, ["999 B", "1.5 KB", "8 GB", "123.5 MB"]);
    }

    #[test]
    fn a_viewer_has_a_host_and_the_port_of_tev() {
        for (text, host, port) in [
            ("127.0.0.1", "127.0.0.1", 14158),
            ("studio:9", "studio", 9),
            ("::1", "::1", 14158),
            ("[::1]", "::1", 14158),
            ("[::1]:14159", "::1", 14159),
        ] {
            assert_eq!(text.parse(), Ok(Viewer { host: host.into(), port }), "{text}");
        }
        for text in ["", ":14158", "a:b:c", "a:", "a:0", "a:70000", "[::1]9", "[]:9"] {
            assert!(text.parse::<Viewer>().is_err_and(|error| error.expected.contains("HOST")), "{text}");
        }
    }

    #[test]
    fn a_grid_has_two_sides() {
        assert_eq!("400x20".parse(), Ok(GridSize { nx: 400, nz: 20 }));
        for text in ["400", "2x9", "9x99999", "axb", "3x3x3"] {
            assert!(text.parse::<GridSize>().is_err(), "{text}");
        }
    }
}
