//! Cryptomatte 1.2.0: ids of names, the attributes that say which id is whose, and the ranks that channels hold.
//! Which objects there are, and how much of a pixel each covers, is the render room's matter.
//!
//! *Source*: J. Friedman, A. C. Jones, Fully automatic ID mattes with support for motion blur and transparency, 2015, and
//! Psyop's specification 1.2.0.

use exr::meta::attribute::{AttributeValue, Text};

use super::{Picture, attributes};

/// Ranks of a pixel, two to a set of channels: what a seventh thing covers is not told.
pub const RANKS: usize = 6;

/// The names that one set of mattes is about.
#[derive(Clone, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Cryptomatte {
    /// The layer's name without its digits, as `CryptoObject`.
    pub layer: String,
    /// Names, each once.
    pub names: Vec<String>,
}

/// MurmurHash3 (x86, 32 bits, seed 0) of a name's UTF-8 bytes.
fn hash(name: &str) -> u32 {
    murmur3::murmur3_32(&mut name.as_bytes(), 0).expect("reading from memory does not fail")
}

/// The bits of a name's id: its hash, with one bit of the exponent turned where they would be no normal number.
pub fn id_bits(name: &str) -> u32 {
    let hash = hash(name);
    match hash >> 23 & 0xff {
        0 | 0xff => hash ^ 1 << 23,
        _ => hash,
    }
}

/// A name's id as channels hold it.
pub fn id(name: &str) -> f32 {
    f32::from_bits(id_bits(name))
}

/// Names of the channels of a layer, in the order of the ranks: id, coverage, id, coverage ...
pub fn channels(layer: &str) -> [String; 2 * RANKS] {
    // Lower case: DWA takes a channel called `.R` for colour and loses ids.
    std::array::from_fn(|index| format!("{layer}{:02}.{}", index / 4, ["r", "g", "b", "a"][index % 4]))
}

impl Cryptomatte {
    /// The name's id by name: JSON, one object.
    pub fn manifest(&self) -> String {
        let ids = self.names.iter().map(|name| (name.clone(), format!("{:08x}", id_bits(name)).into()));
        serde_json::Value::Object(ids.collect()).to_string()
    }

    /// The first seven hexadecimal digits of the layer's own hash, which tell several sets of attributes apart.
    fn key(&self) -> String {
        format!("{:08x}", hash(&self.layer))[..7].to_owned()
    }

    /// The four attributes, by name.
    pub(super) fn attributes(&self) -> [(String, AttributeValue); 4] {
        let key = self.key();
        [
            ("name", self.layer.clone()),
            ("hash", "MurmurHash3_32".to_owned()),
            ("conversion", "uint32_to_float32".to_owned()),
            ("manifest", self.manifest()),
        ]
        .map(|(what, value)| (format!("cryptomatte/{key}/{what}"), attributes::text(&value)))
    }
}

/// What a file's attributes say of its mattes, in order of their layers; sets without a manifest that can be read have no names.
pub(super) fn read<'a>(attributes: impl Iterator<Item = (&'a [u8], &'a Text)>) -> Vec<Cryptomatte> {
    let mut found: std::collections::BTreeMap<String, Cryptomatte> = Default::default();
    for (name, value) in attributes {
        let Ok(name) = std::str::from_utf8(name) else { continue };
        let Some((key, what)) = name.strip_prefix("cryptomatte/").and_then(|rest| rest.split_once('/')) else {
            continue;
        };
        let value = attributes::string(value);
        let set = found.entry(key.to_owned()).or_default();
        match what {
            "name" => set.layer = value,
            "manifest" => {
                let manifest = serde_json::from_str(&value).unwrap_or_default();
                let manifest: serde_json::Map<String, serde_json::Value> = manifest;
                set.names = manifest.into_iter().map(|(name, _)| name).collect();
            }
            _ => {}
        }
    }
    let mut sets: Vec<Cryptomatte> = found.into_values().filter(|set| !set.layer.is_empty()).collect();
    sets.sort_by(|a, b| a.layer.cmp(&b.layer));
    sets
}

/// Forgets the names of layers whose channels a picture does not have.
pub(super) fn keep_present(picture: &mut Picture) {
    let Picture { channels, metadata, .. } = picture;
    metadata.cryptomattes.retain(|set| {
        let first = format!("{}00.r", set.layer);
        channels.iter().any(|channel| channel.name == first)
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_are_those_of_the_specification_and_of_files_from_elsewhere() {
        for (name, expected) in [
            ("torus", 0xf19c_73fd_u32),
            ("равнина", 0x9623_511e),
            ("bunny", 0x1385_1a76),
            ("default", 0x42c9_679f),
            ("bunny_porcelain_mat", 0xb24b_26d4),
            ("ball_asset", 0x79b6_2f5e),
            ("toroidal_asset", 0x1539_c043),
            ("water", 0x36ba_945b),
            ("terrain", 0xcaee_35fa),
            ("spray", 0x7d37_5e97),
            ("foam", 0x4a67_873b),
            ("mist", 0x8b19_3021),
            ("sky", 0xd12b_e799),
        ] {
            assert_eq!(id_bits(name), expected, "{name}");
        }
        // As the specification prints them.
        assert_eq!(id("torus"), -1.549_436_2e30);
        assert_eq!(id("равнина"), -1.319_263_1e-25);
    }

    #[test]
    fn ids_are_normal_numbers_whatever_the_hash() {
        // Exponents of 0 and of 255: a denormal and something that is no number.
        assert_eq!((hash("particle751"), id_bits("particle751")), (0x0063_2ea1, 0x00e3_2ea1));
        assert_eq!((hash("particle120"), id_bits("particle120")), (0xffa8_cdab, 0xff28_cdab));
        for index in 0..100_000 {
            let name = format!("particle{index}");
            assert!(id(&name).is_normal(), "{name}");
        }
    }

    #[test]
    fn keys_are_the_first_digits_of_the_layer_s_hash() {
        let key = |layer: &str| Cryptomatte { layer: layer.into(), names: Vec::new() }.key();
        assert_eq!(["CryptoObject", "CryptoMaterial", "CryptoAsset"].map(key), ["3ae39a5", "be359d6", "f42029d"]);
        assert_eq!(["crypto_asset", "crypto_material", "crypto_object"].map(key), ["28322e9", "bda530a", "f834d0a"]);
    }

    #[test]
    fn the_manifest_comes_back_with_every_letter() {
        let names = ["water", "a \"quoted\" name\\", "равнина", "two\nlines"].map(str::to_owned).to_vec();
        let set = Cryptomatte { layer: "CryptoObject".into(), names };
        assert!(set.manifest().starts_with("{\"water\":\"36ba945b\","), "{}", set.manifest());
        let other = Cryptomatte { layer: "CryptoBed".into(), names: vec!["terrain".into()] };
        let list: Vec<_> = [&set, &other].into_iter().flat_map(Cryptomatte::attributes).collect();
        let texts = list.iter().map(|(name, value)| match value {
            AttributeValue::Text(text) => (name.as_bytes(), text),
            other => panic!("{other:?}"),
        });
        assert_eq!(read(texts), [other.clone(), set.clone()]);
    }

    #[test]
    fn channels_are_pairs_of_id_and_coverage() {
        let names = channels("CryptoBed");
        assert_eq!(names[0], "CryptoBed00.r");
        assert_eq!(names[5], "CryptoBed01.g");
        assert_eq!(names[11], "CryptoBed02.a");
    }
}
