//! The layers that a user names (`--layers beauty,z,n`) and the channels that they stand for (docs/formats.md, section 3).

use super::{OutputError, Picture, cryptomatte};

/// Every layer name, but for the light groups (`light_<group>`), of which there are as many as a scene has.
pub const KNOWN: [&str; 30] = [
    "beauty",
    "noisy",
    "z",
    "n",
    "p",
    "motion",
    "forward",
    "backward",
    "albedo",
    "dnormal",
    "reflection",
    "refraction",
    "volume",
    "caustics",
    "spray",
    "foam",
    "mist",
    "terrain",
    "sky",
    "lights",
    "water",
    "mask",
    "velocity",
    "crypto",
    "cryptoobject",
    "cryptomaterial",
    "cryptobed",
    "samplecount",
    "variance",
    "all",
];

/// The layer a channel belongs to: `R` → `beauty`, `N.x` → `n`, `CryptoBed01.r` → `cryptobed`, `light_sun.R` → `light_sun`.
pub fn layer_of(channel: &str) -> String {
    let first = match channel.split_once('.') {
        None if matches!(channel, "R" | "G" | "B" | "A") => return "beauty".into(),
        None => channel,
        Some((first, _)) => first,
    };
    if first.starts_with("light_") {
        return first.into(); // The group's name is the user's own, capitals and digits included.
    }
    let lower = first.to_ascii_lowercase();
    if lower.starts_with("crypto") { lower.trim_end_matches(|c: char| c.is_ascii_digit()).into() } else { lower }
}

/// Whether a name asks for a layer.
fn asks_for(name: &str, layer: &str) -> bool {
    match name {
        "all" => true,
        "motion" => matches!(layer, "forward" | "backward"),
        "lights" => layer.starts_with("light_"),
        "crypto" => layer.starts_with("crypto"),
        _ => name == layer,
    }
}

/// Names as they are compared: light groups as given, all else in lower case.
fn normal(name: &str) -> String {
    let name = name.trim();
    if name.starts_with("light_") { name.into() } else { name.to_ascii_lowercase() }
}

/// Checks names before there is a picture.
///
/// *Errors*: an unknown name, with the nearest known one.
pub fn check<S: AsRef<str>>(names: &[S]) -> Result<(), OutputError> {
    for name in names {
        let wanted = normal(name.as_ref());
        let group = wanted.strip_prefix("light_").is_some_and(|g| !g.is_empty());
        if group || KNOWN.contains(&wanted.as_str()) {
            continue;
        }
        let nearest = KNOWN
            .iter()
            .map(|k| (strsim::damerau_levenshtein(k, &wanted), *k))
            .min()
            // More than a third of the letters wrong is another word, not a slip.
            .filter(|(distance, k)| *distance <= (k.len().max(wanted.len())).div_ceil(3))
            .map(|(_, k)| k.to_string());
        let known = format!("{}, light_<group>", KNOWN.join(", "));
        return Err(OutputError::UnknownLayer { name: name.as_ref().into(), nearest, known });
    }
    Ok(())
}

/// Whether a channel is among the named layers; without names, everything but `variance` is.
pub fn wants<S: AsRef<str>>(names: &[S], channel: &str) -> bool {
    let layer = layer_of(channel);
    if names.is_empty() { layer != "variance" } else { names.iter().any(|n| asks_for(&normal(n.as_ref()), &layer)) }
}

/// Leaves only the channels of the named layers in a picture; no names mean the default, everything but `variance`.
///
/// *Errors*: an unknown name, or a layer that this picture does not have.
pub fn select<S: AsRef<str>>(picture: &mut Picture, names: &[S]) -> Result<(), OutputError> {
    check(names)?;
    let mut present: Vec<String> = Vec::new();
    for channel in &picture.channels {
        let layer = layer_of(&channel.name);
        if !present.contains(&layer) {
            present.push(layer);
        }
    }
    for name in names {
        if !present.iter().any(|layer| asks_for(&normal(name.as_ref()), layer)) {
            return Err(OutputError::AbsentLayer { name: name.as_ref().into(), present: present.join(", ") });
        }
    }
    picture.channels.retain(|channel| wants(names, &channel.name));
    cryptomatte::keep_present(picture);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::{Channel, SampleType};

    fn picture(names: &[&str]) -> Picture {
        let channel = |name: &&str| Channel { name: name.to_string(), sample_type: SampleType::Half, samples: vec![] };
        Picture { channels: names.iter().map(channel).collect(), ..Picture::default() }
    }

    fn kept(from: &[&str], names: &[&str]) -> Vec<String> {
        let mut picture = picture(from);
        select(&mut picture, names).unwrap();
        picture.channels.into_iter().map(|c| c.name).collect()
    }

    const ALL: [&str; 14] = [
        "R",
        "G",
        "B",
        "A",
        "Z",
        "N.x",
        "forward.u",
        "backward.v",
        "water.depth",
        "light_Sun1.R",
        "CryptoBed01.r",
        "sampleCount",
        "variance",
        "dnormal.x",
    ];

    #[test]
    fn names_stand_for_channels() {
        assert_eq!(kept(&ALL, &["beauty"]), ["R", "G", "B", "A"]);
        assert_eq!(kept(&ALL, &["z", "N"]), ["Z", "N.x"]);
        assert_eq!(kept(&ALL, &["motion"]), ["forward.u", "backward.v"]);
        assert_eq!(kept(&ALL, &["lights", "crypto"]), ["light_Sun1.R", "CryptoBed01.r"]);
        assert_eq!(kept(&ALL, &["light_Sun1", "cryptobed", "sampleCount"]).len(), 3);
        assert_eq!(kept(&ALL, &["all"]).len(), ALL.len());
        let default = kept(&ALL, &[]);
        assert!(default.len() == ALL.len() - 1 && !default.contains(&"variance".to_string()));
    }

    #[test]
    fn unknown_and_absent_layers_are_told_apart() {
        let error = select(&mut picture(&ALL), &["beuty"]).unwrap_err().to_string();
        assert!(error.contains("did you mean `beauty`") && error.contains("caustics"), "{error}");
        let error = check(&["qqqqqqqq"]).unwrap_err().to_string();
        assert!(!error.contains("did you mean"), "{error}");
        let mut whole = picture(&ALL);
        let error = select(&mut whole, &["beauty", "caustics"]).unwrap_err();
        assert!(matches!(error, OutputError::AbsentLayer { ref name, .. } if name == "caustics"));
        assert_eq!(whole.channels.len(), ALL.len());
    }

    #[test]
    fn every_channel_of_the_format_has_a_known_layer() {
        for channel in
            ["P.z", "albedo.R", "reflection.G", "sky.B", "mask.foam", "velocity.x", "CryptoMaterial00.a", "noisy.R"]
        {
            assert!(KNOWN.contains(&layer_of(channel).as_str()), "{channel}");
        }
    }
}
