//! Which channels go into which part of an EXR file, and how each part is compressed.
//!
//! DWA decides by the text after a channel's last dot, case-sensitively: `R G B Y BY RY` are cut to half and lose
//! detail, `A` is kept by run lengths, all else by zip. So only half channels called `.R .G .B .A` may share its part.

use super::{Picture, SampleType};
use crate::scene::Compression;

/// How lossy DWA is: the level that OpenEXR takes for visually lossless.
pub(super) const DWA_LEVEL: f32 = 45.0;

/// One part of a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Part {
    /// Its name; none in a file of one part.
    pub(super) name: Option<&'static str>,
    /// `Dwaa` or a lossless one.
    pub(super) compression: Compression,
    /// Indices into the picture's channels, in order of their names, as OpenEXR stores them.
    pub(super) channels: Vec<usize>,
}

/// One part for lossless compression; `rgba`, `data` and `crypto` (those that have channels) for DWAA.
pub(super) fn parts(picture: &Picture, compression: Compression) -> Vec<Part> {
    let mut order: Vec<usize> = (0..picture.channels.len()).collect();
    order.sort_by(|a, b| picture.channels[*a].name.cmp(&picture.channels[*b].name));
    if compression != Compression::Dwaa {
        return vec![Part { name: None, compression, channels: order }];
    }
    let part_of = |index: usize| {
        let channel = &picture.channels[index];
        let last = channel.name.rsplit('.').next().unwrap_or_default();
        // `CryptoObject00.r`, or `ViewLayer.CryptoObject00.r` by Blender's profile.
        if channel.name.split('.').any(|part| part.starts_with("Crypto")) {
            "crypto"
        } else if channel.sample_type == SampleType::Half && matches!(last, "R" | "G" | "B" | "A") {
            "rgba"
        } else {
            "data"
        }
    };
    let mut parts: Vec<Part> = [("rgba", Compression::Dwaa), ("data", Compression::Zip), ("crypto", Compression::Zip)]
        .into_iter()
        .map(|(name, compression)| {
            let channels = order.iter().copied().filter(|i| part_of(*i) == name).collect();
            Part { name: Some(name), compression, channels }
        })
        .filter(|part| !part.channels.is_empty())
        .collect();
    if let [only] = parts.as_mut_slice() {
        only.name = None;
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::Channel;

    fn picture(names: &[(&str, SampleType)]) -> Picture {
        let channel = |(name, sample_type): &(&str, SampleType)| Channel {
            name: name.to_string(),
            sample_type: *sample_type,
            samples: vec![],
        };
        Picture { channels: names.iter().map(channel).collect(), ..Picture::default() }
    }

    #[test]
    fn dwaa_touches_nothing_but_half_colour() {
        use SampleType::{Float, Half};
        let picture = picture(&[
            ("R", Half),
            ("A", Half),
            ("Z", Float),
            ("sky.B", Half),
            ("dnormal.y", Half),
            ("strange.R", Float),
            ("CryptoBed00.r", Float),
            ("mask.foam", Half),
        ]);
        let names = |part: &Part| part.channels.iter().map(|i| picture.channels[*i].name.clone()).collect::<Vec<_>>();
        let split = parts(&picture, Compression::Dwaa);
        assert_eq!(split.iter().map(|p| p.name.unwrap()).collect::<Vec<_>>(), ["rgba", "data", "crypto"]);
        assert_eq!(names(&split[0]), ["A", "R", "sky.B"]);
        assert_eq!(names(&split[1]), ["Z", "dnormal.y", "mask.foam", "strange.R"]);
        assert_eq!(split[1].compression, Compression::Zip);
        assert_eq!(names(&split[2]), ["CryptoBed00.r"]);
        let one = parts(&picture, Compression::Piz);
        assert!(one.len() == 1 && one[0].name.is_none() && one[0].channels.len() == 8);
    }

    #[test]
    fn a_file_of_one_kind_is_a_single_part() {
        let split = parts(&picture(&[("Z", SampleType::Float)]), Compression::Dwaa);
        assert_eq!(split, [Part { name: None, compression: Compression::Zip, channels: vec![0] }]);
    }
}
