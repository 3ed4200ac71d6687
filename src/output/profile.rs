//! Channels by the names that a program looks for. The names of docs/formats.md are Nuke's; Blender has its own.
//! Samples stay what they are, but for the half of Blender's `Vector` that has the other sign.

use super::{Channel, Picture, layers::layer_of, views};

/// Blender's view layer, whose name begins every channel.
const VIEW_LAYER: &str = "ViewLayer";

/// The picture with the channels that Blender's compositor and its EXR reader know, and its mattes renamed alike.
///
/// Passes that Cycles has get the names that Cycles writes; all others keep theirs, with one letter for each channel, as
/// Blender takes no other.
pub(super) fn blender(picture: &Picture) -> Picture {
    let channels = picture.channels.iter().map(|channel| {
        let (plain, view) = views::split(&channel.name, picture.metadata.right_eye.is_some());
        let (name, sign) = name(&plain);
        let name = format!("{VIEW_LAYER}.{name}");
        let name = view.map_or_else(|| name.clone(), |view| views::insert(&name, view));
        let mut samples = channel.samples.clone();
        if sign < 0.0 {
            // Not the zeros: a motion of -0 is nothing that a reader should have to think about.
            samples.iter_mut().filter(|sample| **sample != 0.0).for_each(|sample| *sample = -*sample);
        }
        Channel { name, sample_type: channel.sample_type, samples }
    });
    let mut metadata = picture.metadata.clone();
    for set in &mut metadata.cryptomattes {
        set.layer = format!("{VIEW_LAYER}.{}", set.layer);
    }
    Picture { channels: channels.collect(), metadata, ..*picture }
}

/// Pass and channel, and the sign of the samples.
///
/// *Source*: the names are those of Cycles (`intern/cycles/blender/addon/engine.py`); `Vector` is X, Y = previous - now and
/// Z, W = now - next (`camera_motion_vector` in `src/kernel/camera/camera.h`).
fn name(channel: &str) -> (String, f32) {
    let layer = layer_of(channel);
    let last = channel.rsplit('.').next().unwrap_or_default();
    let axis = |pass: &str| (format!("{pass}.{}", last.to_ascii_uppercase()), 1.0);
    match (layer.as_str(), last) {
        ("beauty", _) => axis("Combined"),
        ("noisy", _) => axis("Noisy Image"),
        ("z", _) => ("Depth.Z".into(), 1.0),
        ("n", _) => axis("Normal"),
        ("p", _) => axis("Position"),
        ("backward", "u") => ("Vector.X".into(), 1.0),
        ("backward", _) => ("Vector.Y".into(), 1.0),
        ("forward", "u") => ("Vector.Z".into(), -1.0),
        ("forward", _) => ("Vector.W".into(), -1.0),
        ("albedo", _) => axis("Denoising Albedo"),
        ("dnormal", _) => axis("Denoising Normal"),
        ("samplecount", _) => ("Debug Sample Count.X".into(), 1.0),
        ("variance", _) => ("Variance.X".into(), 1.0),
        ("velocity", _) => axis("velocity"),
        ("water", _) => (format!("water_{last}.X"), 1.0),
        ("mask", _) => (format!("mask_{last}.X"), 1.0),
        // Mattes keep their small letters, which Cycles writes too, and layers of light have capitals already.
        _ => (channel.to_owned(), 1.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::{Cryptomatte, SampleType};

    #[test]
    fn every_channel_has_blender_s_name() {
        for (ours, theirs) in [
            ("R", "Combined.R"),
            ("A", "Combined.A"),
            ("noisy.G", "Noisy Image.G"),
            ("Z", "Depth.Z"),
            ("N.x", "Normal.X"),
            ("P.z", "Position.Z"),
            ("albedo.B", "Denoising Albedo.B"),
            ("dnormal.y", "Denoising Normal.Y"),
            ("reflection.R", "reflection.R"),
            ("light_Sun.G", "light_Sun.G"),
            ("water.depth", "water_depth.X"),
            ("water.path", "water_path.X"),
            ("mask.foam", "mask_foam.X"),
            ("velocity.x", "velocity.X"),
            ("sampleCount", "Debug Sample Count.X"),
            ("CryptoObject00.r", "CryptoObject00.r"),
            ("CryptoBed02.a", "CryptoBed02.a"),
        ] {
            assert_eq!(name(ours), (theirs.to_owned(), 1.0), "{ours}");
        }
    }

    #[test]
    fn vector_is_previous_less_now_and_now_less_next() {
        let channel = |name: &str, samples: [f32; 2]| Channel {
            name: name.into(),
            sample_type: SampleType::Float,
            samples: samples.to_vec(),
        };
        let mut picture = Picture {
            channels: vec![
                channel("forward.u", [1.5, 0.0]),
                channel("forward.v", [-2.5, 1.0]),
                channel("backward.u", [-3.0, 0.0]),
                channel("backward.v", [4.0, 1.0]),
            ],
            ..Picture::default()
        };
        picture.metadata.cryptomattes = vec![Cryptomatte { layer: "CryptoBed".into(), names: vec!["terrain".into()] }];
        let renamed = blender(&picture);
        let samples = |name: &str| renamed.channel(name).map(|channel| channel.samples.clone());
        assert_eq!(samples("ViewLayer.Vector.X"), Some(vec![-3.0, 0.0]));
        assert_eq!(samples("ViewLayer.Vector.Y"), Some(vec![4.0, 1.0]));
        assert_eq!(samples("ViewLayer.Vector.Z"), Some(vec![-1.5, 0.0]));
        assert_eq!(samples("ViewLayer.Vector.W"), Some(vec![2.5, -1.0]));
        assert!(samples("ViewLayer.Vector.Z").is_some_and(|samples| samples[1].is_sign_positive()));
        assert_eq!(renamed.metadata.cryptomattes[0].layer, "ViewLayer.CryptoBed");
    }
}
