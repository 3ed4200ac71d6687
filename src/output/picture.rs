//! What a picture promises before it may become a file: windows, names, sizes, finite samples; and what half cannot hold.

use std::collections::HashSet;

use half::f16;
use rayon::prelude::*;

use super::{Channel, OutputError, Picture, SampleType, Window};

/// Half's largest finite value.
pub(super) const HALF_MAX: f32 = 65504.0;

/// OpenEXR keeps coordinates under 2^30, so that sums of two fit an `int`.
const COORDINATE_LIMIT: i64 = 1 << 30;

/// One sample as half stores it: rounded to nearest even, +-65504 beyond its range.
pub(super) fn to_half(sample: f32) -> f16 {
    f16::from_f32(sample.clamp(-HALF_MAX, HALF_MAX))
}

impl Window {
    /// Pixels in the window.
    pub fn area(&self) -> usize {
        self.width as usize * self.height as usize
    }
}

impl Picture {
    /// The channel of that name.
    pub fn channel(&self, name: &str) -> Option<&Channel> {
        self.channels.iter().find(|c| c.name == name)
    }

    /// Checks everything that a file format or a compositor relies on.
    pub(super) fn check(&self) -> Result<(), OutputError> {
        let display = Window { x: 0, y: 0, width: self.display.0, height: self.display.1 };
        for (what, window) in [("display window", display), ("data window", self.data)] {
            let inside = |start: i32, size: u32| {
                let (start, end) = (i64::from(start), i64::from(start) + i64::from(size));
                size > 0 && start > -COORDINATE_LIMIT && end < COORDINATE_LIMIT
            };
            if !inside(window.x, window.width) || !inside(window.y, window.height) {
                let Window { x, y, width, height } = window;
                return Err(OutputError::Window { what, x, y, width, height });
            }
        }
        if self.channels.is_empty() {
            return Err(OutputError::NoChannels);
        }
        let mut names = HashSet::new();
        for channel in &self.channels {
            if !valid_name(&channel.name) {
                return Err(OutputError::ChannelName { name: channel.name.clone() });
            }
            if !names.insert(channel.name.as_str()) {
                return Err(OutputError::DuplicateChannel { name: channel.name.clone() });
            }
            if channel.samples.len() != self.data.area() {
                return Err(OutputError::ChannelSize {
                    channel: channel.name.clone(),
                    samples: channel.samples.len(),
                    expected: self.data.area(),
                });
            }
        }
        for channel in &self.channels {
            if let Some(index) = channel.samples.par_iter().position_first(|s| !s.is_finite()) {
                let width = self.data.width as usize;
                return Err(OutputError::NonFinite {
                    channel: channel.name.clone(),
                    x: self.data.x + (index % width) as i32,
                    y: self.data.y + (index / width) as i32,
                    value: channel.samples[index],
                });
            }
        }
        Ok(())
    }

    /// Half samples beyond the range of half, and the pixels that have one.
    pub(super) fn count_saturated(&self) -> (u64, u64) {
        let halves: Vec<&Channel> = self.channels.iter().filter(|c| c.sample_type == SampleType::Half).collect();
        let width = self.data.width as usize;
        (0..self.data.height as usize)
            .into_par_iter()
            .map(|row| {
                let mut pixels = vec![false; width];
                let mut samples = 0;
                for channel in &halves {
                    for (pixel, sample) in pixels.iter_mut().zip(&channel.samples[row * width..]) {
                        if sample.abs() > HALF_MAX {
                            *pixel = true;
                            samples += 1;
                        }
                    }
                }
                (samples, pixels.iter().filter(|p| **p).count() as u64)
            })
            .reduce(|| (0, 0), |a, b| (a.0 + b.0, a.1 + b.1))
    }
}

/// Letters, digits and underscores in at most three parts: what Nuke keeps as it is (docs/formats.md, section 3).
fn valid_name(name: &str) -> bool {
    let part = |p: &str| {
        p.starts_with(|c: char| c.is_ascii_alphabetic()) && p.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
    };
    name.len() <= 255 && name.split('.').count() <= 3 && name.split('.').all(part)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(samples: Vec<f32>) -> Picture {
        let channel =
            |name: &str| Channel { name: name.into(), sample_type: SampleType::Half, samples: samples.clone() };
        Picture {
            display: (4, 3),
            data: Window { x: -1, y: 2, width: 2, height: 2 },
            channels: vec![channel("R"), channel("G")],
            ..Picture::default()
        }
    }

    #[test]
    fn saturated_samples_and_pixels_are_counted() {
        let mut p = picture(vec![65504.0, 65505.0, -70000.0, 1.0]);
        p.channels[1].samples = vec![0.0, 1e9, 0.0, 0.0];
        assert_eq!(p.count_saturated(), (3, 2));
        // Data in full floats may be as large as it likes.
        p.channels[1].sample_type = SampleType::Float;
        assert_eq!(p.count_saturated(), (2, 2));
        assert_eq!(to_half(1e9).to_f32(), 65504.0);
        assert_eq!(to_half(-65520.0).to_f32(), -65504.0);
    }

    #[test]
    fn non_finite_samples_are_named_with_their_place() {
        for bad in [f32::NAN, f32::INFINITY] {
            let mut p = picture(vec![1.0; 4]);
            p.channels[1].samples[3] = bad;
            let Err(OutputError::NonFinite { channel, x, y, .. }) = p.check() else { panic!("{bad} was accepted") };
            assert_eq!((channel.as_str(), x, y), ("G", 0, 3));
        }
    }

    #[test]
    fn malformed_pictures_are_refused() {
        assert!(picture(vec![0.0; 4]).check().is_ok());
        assert!(matches!(picture(vec![0.0; 3]).check(), Err(OutputError::ChannelSize { .. })));
        let mut p = picture(vec![0.0; 4]);
        p.channels[1].name = "R".into();
        assert!(matches!(p.check(), Err(OutputError::DuplicateChannel { .. })));
        for name in ["", "2x", "a b", "a.b.c.d", "a..b", "é", "a."] {
            p.channels[1].name = name.into();
            assert!(matches!(p.check(), Err(OutputError::ChannelName { .. })), "{name}");
        }
        p.channels.clear();
        assert!(matches!(p.check(), Err(OutputError::NoChannels)));
        let mut p = picture(vec![]);
        p.data.width = 0;
        assert!(matches!(p.check(), Err(OutputError::Window { what: "data window", .. })));
        let mut p = picture(vec![0.0; 4]);
        p.data.x = i32::MAX;
        assert!(matches!(p.check(), Err(OutputError::Window { .. })));
    }
}
