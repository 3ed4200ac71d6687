//! Scene-linear colour spaces of files: which primaries the colours of a picture are in, and the way from one to another.
//!
//! Everything is rendered in Rec.709. Matrices are made from the primaries (RP 177, SMPTE, 1993), whites adapted by Bradford
//! (K. Lam, Metamerism and colour constancy, 1985), so that no table of rounded numbers stands between them.

use std::borrow::Cow;

use exr::math::Vec2;
use exr::meta::attribute::Chromaticities;
use glam::{DMat3, DVec3};
use rayon::prelude::*;

use super::Picture;
use crate::scene::Colorspace;

/// Red, green, blue and white of Rec.709 (ITU-R BT.709).
const REC_709: Chromaticities = Chromaticities {
    red: Vec2(0.64, 0.33),
    green: Vec2(0.30, 0.60),
    blue: Vec2(0.15, 0.06),
    white: Vec2(0.3127, 0.329),
};

/// Those of AP1 (S-2014-004, ACEScg, Academy of Motion Picture Arts and Sciences).
const AP1: Chromaticities = Chromaticities {
    red: Vec2(0.713, 0.293),
    green: Vec2(0.165, 0.830),
    blue: Vec2(0.128, 0.044),
    white: Vec2(0.32168, 0.33767),
};

/// The primaries of a space.
pub(super) fn chromaticities(space: Colorspace) -> Chromaticities {
    match space {
        Colorspace::Rec709 => REC_709,
        Colorspace::Acescg => AP1,
    }
}

/// What OpenEXR's `colorInteropID` calls it (Color Interop Forum, 2024).
pub(super) fn interop_id(space: Colorspace) -> &'static str {
    match space {
        Colorspace::Rec709 => "lin_rec709_scene",
        Colorspace::Acescg => "lin_ap1_scene",
    }
}

/// The space of that name; Rec.709 for every other, as files without a name are.
pub(super) fn by_interop_id(id: &str) -> Colorspace {
    if id == interop_id(Colorspace::Acescg) { Colorspace::Acescg } else { Colorspace::Rec709 }
}

/// XYZ of a chromaticity, Y = 1.
fn xyz(Vec2(x, y): Vec2<f32>) -> DVec3 {
    let (x, y) = (f64::from(x), f64::from(y));
    DVec3::new(x / y, 1.0, (1.0 - x - y) / y)
}

fn to_xyz(space: Colorspace) -> DMat3 {
    let Chromaticities { red, green, blue, white } = chromaticities(space);
    let primaries = DMat3::from_cols(xyz(red), xyz(green), xyz(blue));
    let amounts = primaries.inverse() * xyz(white);
    primaries * DMat3::from_diagonal(amounts)
}

/// The matrix that takes linear colours from one space to another.
pub(super) fn matrix(from: Colorspace, to: Colorspace) -> DMat3 {
    // Responses of the three kinds of cones, by rows.
    let bradford =
        DMat3::from_cols_array_2d(&[[0.8951, -0.7502, 0.0389], [0.2664, 1.7135, -0.0685], [-0.1614, 0.0367, 1.0296]]);
    let white = |space| bradford * xyz(chromaticities(space).white);
    let adapted = bradford.inverse() * DMat3::from_diagonal(white(to) / white(from)) * bradford;
    to_xyz(to).inverse() * adapted * to_xyz(from)
}

/// The picture with every colour (channels called `R G B` after their last dot) in a space.
pub(super) fn converted(picture: &Picture, to: Colorspace) -> Cow<'_, Picture> {
    let from = picture.metadata.colorspace;
    if from == to {
        return Cow::Borrowed(picture);
    }
    let matrix = matrix(from, to);
    let mut picture = picture.clone();
    let place = |picture: &Picture, name: &str| picture.channels.iter().position(|channel| channel.name == name);
    for red in 0..picture.channels.len() {
        let name = &picture.channels[red].name;
        let Some(layer) = name.strip_suffix('R').filter(|layer| layer.is_empty() || layer.ends_with('.')) else {
            continue;
        };
        let [green, blue] = ["G", "B"].map(|color| place(&picture, &format!("{layer}{color}")));
        let (Some(green), Some(blue)) = (green, blue) else { continue };
        let mut colors = [red, green, blue].map(|index| std::mem::take(&mut picture.channels[index].samples));
        let [r, g, b] = &mut colors;
        r.par_iter_mut().zip(g).zip(b).for_each(|((r, g), b)| {
            let color = matrix * DVec3::new(f64::from(*r), f64::from(*g), f64::from(*b));
            [*r, *g, *b] = color.to_array().map(|value| value as f32);
        });
        for (index, samples) in [red, green, blue].into_iter().zip(colors) {
            picture.channels[index].samples = samples;
        }
    }
    picture.metadata.colorspace = to;
    Cow::Owned(picture)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::{Channel, SampleType, Window};

    #[test]
    fn white_stays_white_and_the_way_back_leads_back() {
        let there = matrix(Colorspace::Rec709, Colorspace::Acescg);
        assert!((there * DVec3::ONE - DVec3::ONE).abs().max_element() < 1e-12, "{there}");
        let back = matrix(Colorspace::Acescg, Colorspace::Rec709) * there;
        assert!((back - DMat3::IDENTITY).to_cols_array().iter().all(|off| off.abs() < 1e-12), "{back}");
        // The matrix that ACES' own transforms have (ACES 1.3, sRGB to AP1 by Bradford), to its digits.
        let known = [
            0.61309741, 0.07019372, 0.02061559, 0.33952315, 0.91635388, 0.10956977, 0.04737945, 0.01345240, 0.86981463,
        ];
        for (ours, known) in there.to_cols_array().into_iter().zip(known) {
            assert!((ours - known).abs() < 2e-5, "{there}");
        }
    }

    #[test]
    fn colours_change_and_data_do_not() {
        let channel = |name: &str, value: f32| Channel {
            name: name.into(),
            sample_type: SampleType::Float,
            samples: vec![value; 2],
        };
        let names = ["R", "G", "B", "A", "sky.R", "sky.G", "sky.B", "N.x", "CryptoBed00.r", "strange.R"];
        let picture = Picture {
            display: (2, 1),
            data: Window { x: 0, y: 0, width: 2, height: 1 },
            channels: names
                .iter()
                .zip([1.0, 0.0, 0.0, 0.5, 0.25, 0.25, 0.25, 0.7, 0.3, 0.9])
                .map(|(n, v)| channel(n, v))
                .collect(),
            ..Picture::default()
        };
        let seen = converted(&picture, Colorspace::Acescg);
        let value = |name: &str| seen.channel(name).unwrap().samples[1];
        assert!((value("R") - 0.6131).abs() < 1e-4 && (value("G") - 0.0702).abs() < 1e-4);
        assert!((value("sky.B") - 0.25).abs() < 1e-6);
        assert_eq!([value("A"), value("N.x"), value("CryptoBed00.r"), value("strange.R")], [0.5, 0.7, 0.3, 0.9]);
        assert_eq!(seen.metadata.colorspace, Colorspace::Acescg);
        assert!(matches!(converted(&picture, Colorspace::Rec709), Cow::Borrowed(_)));
    }
}
