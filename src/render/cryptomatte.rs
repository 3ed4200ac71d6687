//! Which thing covers how much of a pixel, for Cryptomatte: names of things, what a ray still decides, sums per pixel.
//! Ids and attributes are `output::cryptomatte`'s.
//!
//! Every sample of the camera gives the whole of itself away: to what it meets first, and, where that is water, to what it
//! meets behind the surface. So coverage has the beauty's filter, lens and shutter.

use crate::{
    lower::{Lowered, Material},
    output::cryptomatte::{Cryptomatte, RANKS, channels, id_bits},
    terrain::MeshAlbedo,
};

use super::{
    batches::{Carrier, Scratch},
    world::World,
};

/// Which sets of mattes a picture gets.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Mattes {
    /// `CryptoObject`: parts by their names.
    pub object: bool,
    /// `CryptoMaterial`: what things are made of.
    pub material: bool,
    /// `CryptoBed`: parts seen through the water.
    pub bed: bool,
}

impl std::fmt::Display for Mattes {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let names: Vec<&str> = self.kinds().map(|kind| LAYERS[kind]).collect();
        if names.is_empty() { f.write_str("none") } else { f.write_str(&names.join(", ")) }
    }
}

/// Names of the sets' layers, in the order of [`Mattes::asked`].
const LAYERS: [&str; 3] = ["CryptoObject", "CryptoMaterial", "CryptoBed"];

impl Mattes {
    /// All three.
    pub const ALL: Self = Self { object: true, material: true, bed: true };

    /// The sets of which `wanted` asks for the first channel.
    pub fn wanted(wanted: impl Fn(&str) -> bool) -> Self {
        let [object, material, bed] = LAYERS.map(|layer| wanted(&channels(layer)[0]));
        Self { object, material, bed }
    }

    fn asked(self) -> [bool; 3] {
        [self.object, self.material, self.bed]
    }

    fn kinds(self) -> impl Iterator<Item = usize> {
        (0..3).filter(move |&kind| self.asked()[kind])
    }

    /// Names of the channels.
    pub(super) fn channels(self) -> impl Iterator<Item = String> {
        self.kinds().flat_map(|kind| channels(LAYERS[kind]))
    }
}

/// A thing by its place in the lists of [`Names`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Seen {
    object: u16,
    material: u16,
}

/// The things of a frame by name, over all moments of its shutter.
#[derive(Clone, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub(super) struct Names {
    mattes: Mattes,
    objects: List,
    materials: List,
}

/// Names, each once, with their ids.
#[derive(Clone, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
struct List(Vec<(String, u32)>);

impl List {
    /// The place of a name, which is added if it is new.
    fn place(&mut self, name: &str) -> u16 {
        let found = self.0.iter().position(|(known, _)| known == name).unwrap_or_else(|| {
            self.0.push((name.to_owned(), id_bits(name)));
            self.0.len() - 1
        });
        // A scene has a part per mesh, panel and sphere. Those beyond 65535 share the last one's matte.
        found.min(usize::from(u16::MAX)) as u16
    }

    fn names(&self) -> Vec<String> {
        self.0.iter().map(|(name, _)| name.clone()).collect()
    }
}

fn material(material: &Material) -> &'static str {
    match material {
        Material::Water | Material::Sheet => "water",
        Material::Ground => "ground",
        Material::Spray { .. } => "spray",
        Material::Diffuse(_) => "diffuse",
        Material::VertexColours(_) => "vertex_colours",
        // An image on it makes no other thing of it.
        Material::Images { albedo, .. } => match **albedo {
            MeshAlbedo::Uniform(_) => "diffuse",
            MeshAlbedo::PerVertex(_) => "vertex_colours",
        },
    }
}

/// The things of one moment, as rays meet them.
#[derive(Clone, Debug, Default)]
pub(super) struct Things {
    asked: bool,
    parts: Vec<Seen>,
    mist: Seen,
    water: Seen,
    foam: u16,
    lamps: Vec<Seen>,
}

impl Names {
    /// The names of nothing yet.
    pub(super) fn new(mattes: Mattes) -> Self {
        Self { mattes, ..Self::default() }
    }

    /// Adds the things of a moment; `groups` are the light groups of the lamps that can be seen.
    pub(super) fn add(&mut self, lowered: &Lowered, foam: bool, mist: bool, groups: &[Option<&str>]) -> Things {
        if self.mattes == Mattes::default() {
            return Things::default();
        }
        let mut seen = |object: &str, material: &str| Seen {
            object: self.objects.place(object),
            material: self.materials.place(material),
        };
        let parts = lowered.parts.iter().map(|part| seen(&part.name, material(&part.material))).collect();
        let wet = lowered.parts.iter().any(|part| matches!(part.material, Material::Water));
        Things {
            asked: true,
            parts,
            mist: if mist { seen("mist", "mist") } else { Seen::default() },
            water: if wet { seen("water", "water") } else { Seen::default() },
            lamps: groups
                .iter()
                .map(|group| group.map_or(Seen::default(), |group| seen(&format!("light_{group}"), "light")))
                .collect(),
            foam: if foam { self.materials.place("foam") } else { 0 },
        }
    }

    /// The sets that there are names for.
    pub(super) fn mattes(&self) -> Mattes {
        self.mattes
    }

    /// What the file tells of the names.
    pub(super) fn cryptomattes(&self) -> Vec<Cryptomatte> {
        let names = |kind| if kind == 1 { self.materials.names() } else { self.objects.names() };
        self.mattes.kinds().map(|kind| Cryptomatte { layer: LAYERS[kind].to_owned(), names: names(kind) }).collect()
    }

    /// The values of a pixel's channels in the order of [`Mattes::channels`].
    pub(super) fn resolve(&self, pixel: &Pixel, share: f32, values: &mut Vec<f32>) {
        for kind in self.mattes.kinds() {
            let list = if kind == 1 { &self.materials } else { &self.objects };
            let mut ranks: Vec<(f32, u32)> = pixel[kind]
                .iter()
                // Weights that were chosen by chance may add up to more than there is.
                .map(|&(slot, weight)| ((weight * share).min(1.0), list.0[usize::from(slot)].1))
                .filter(|&(coverage, _)| coverage > 0.0)
                .collect();
            ranks.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
            ranks.resize(RANKS, (0.0, 0));
            values.extend(ranks.into_iter().flat_map(|(coverage, id)| [f32::from_bits(id), coverage]));
        }
    }
}

/// What things a pixel's samples have met: place in the list of names and weight, by set.
pub(super) type Pixel = [Vec<(u16, f32)>; 3];

/// The sums of a tile's pixels.
#[derive(Clone, Debug, Default, serde::Serialize, serde::Deserialize)]
pub(super) struct Coverage {
    /// Empty unless a matte is asked for and something has been met.
    pixels: Vec<Pixel>,
}

impl Coverage {
    /// Forgets everything but the memory.
    pub(super) fn clear(&mut self) {
        self.pixels.iter_mut().flatten().for_each(Vec::clear);
    }

    /// Adds the sums of later samples of the same pixels.
    pub(super) fn join(&mut self, later: &Self) {
        for (pixel, sets) in (0..).zip(&later.pixels) {
            for (kind, list) in sets.iter().enumerate() {
                list.iter().for_each(|&(slot, weight)| self.add(pixel, kind, slot, weight));
            }
        }
    }

    /// Whether everything that has been met has a name.
    pub(super) fn is_of(&self, names: &Names) -> bool {
        let count = |kind| if kind == 1 { names.materials.0.len() } else { names.objects.0.len() };
        let known = |kind: usize, list: &[(u16, f32)]| list.iter().all(|&(slot, _)| usize::from(slot) < count(kind));
        self.pixels.iter().all(|sets| sets.iter().enumerate().all(|(kind, list)| known(kind, list)))
    }

    /// What a pixel's samples have met.
    pub(super) fn pixel(&self, pixel: usize) -> &Pixel {
        const NOTHING: &Pixel = &[Vec::new(), Vec::new(), Vec::new()];
        self.pixels.get(pixel).unwrap_or(NOTHING)
    }

    #[inline]
    fn add(&mut self, pixel: u32, kind: usize, slot: u16, weight: f32) {
        let pixel = pixel as usize;
        if pixel >= self.pixels.len() {
            self.pixels.resize_with(pixel + 1, Pixel::default);
        }
        let list = &mut self.pixels[pixel][kind];
        match list.iter_mut().find(|entry| entry.0 == slot) {
            Some(entry) => entry.1 += weight,
            None => list.push((slot, weight)),
        }
    }
}

/// The share of a sample's mattes that is still to be given away, by what the ray that carries it will meet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Sight {
    /// It has met nothing yet.
    Direct(f32),
    /// It went through the water's surface.
    Through(f32),
    /// Nothing is left.
    Over,
}

impl Sight {
    /// A share of it.
    #[inline]
    pub(super) fn times(self, share: f32) -> Self {
        match self {
            Self::Direct(weight) => Self::Direct(weight * share),
            Self::Through(weight) => Self::Through(weight * share),
            Self::Over => Self::Over,
        }
    }
}

impl Things {
    /// A part.
    #[inline]
    pub(super) fn part(&self, index: usize) -> Seen {
        if self.asked { self.parts[index] } else { Seen::default() }
    }

    /// Mist.
    #[inline]
    pub(super) fn mist(&self) -> Seen {
        self.mist
    }

    /// What throws light back inside of the water.
    #[inline]
    pub(super) fn water(&self) -> Seen {
        self.water
    }

    /// The foam on a part of the water: the same object, another material.
    #[inline]
    pub(super) fn foam_on(&self, water: Seen) -> Seen {
        Seen { material: self.foam, ..water }
    }

    /// A lamp's ball.
    #[inline]
    pub(super) fn lamp(&self, index: usize) -> Seen {
        self.lamps.get(index).copied().unwrap_or_default()
    }
}

impl World<'_> {
    /// Gives `share` of what a ray still decides to a thing that it has met; returns what is left to the ray.
    #[inline]
    pub(super) fn cover(&self, carrier: &Carrier, seen: Seen, share: f32, scratch: &mut Scratch) -> Sight {
        let coverage = &mut scratch.film.coverage;
        match carrier.sight {
            Sight::Direct(weight) if self.things.asked => {
                coverage.add(carrier.place.pixel, 0, seen.object, weight * share);
                coverage.add(carrier.place.pixel, 1, seen.material, weight * share);
            }
            Sight::Through(weight) if self.things.asked => {
                coverage.add(carrier.place.pixel, 2, seen.object, weight * share);
            }
            _ => return Sight::Over,
        }
        carrier.sight.times(1.0 - share)
    }

    /// Whether a ray is in the water, and what it meets there counts as seen through its surface.
    #[inline]
    pub(super) fn sees_through_water(&self, carrier: &Carrier) -> bool {
        carrier.in_water && self.things.asked && matches!(carrier.sight, Sight::Through(_))
    }

    /// What a ray decides beyond the water's surface that it has met at `seen`.
    #[inline]
    pub(super) fn cover_water(&self, carrier: &Carrier, seen: Seen, scratch: &mut Scratch) -> Sight {
        match carrier.sight {
            Sight::Direct(weight) => {
                self.cover(carrier, seen, 1.0, scratch);
                Sight::Through(weight)
            }
            // What is seen through the water's far side is seen through the water as well.
            other => other,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::cryptomatte::id;

    #[test]
    fn ranks_go_by_coverage_then_by_id_and_six_are_told() {
        let mut names = Names::new(Mattes { object: true, ..Mattes::default() });
        let all: Vec<u16> = (0..8).map(|index| names.objects.place(&format!("panel_{index}"))).collect();
        let mut coverage = Coverage::default();
        for (&slot, weight) in all.iter().zip([1.0, 2.0, 2.0, 3.0, 0.5, 0.25, 0.75, 0.5]) {
            coverage.add(3, 0, slot, 0.5 * weight);
            coverage.add(3, 0, slot, 0.5 * weight);
        }
        let mut values = Vec::new();
        names.resolve(coverage.pixel(3), 0.1, &mut values);
        assert_eq!(values.len(), 2 * RANKS);
        let shares: Vec<f32> = values.iter().skip(1).step_by(2).copied().collect();
        for (share, expected) in shares.iter().zip([0.3, 0.2, 0.2, 0.1, 0.075, 0.05]) {
            assert!((share - expected).abs() < 1e-6, "{shares:?}");
        }
        assert_eq!(values[0].to_bits(), id("panel_3").to_bits());
        let mut pair = [id_bits("panel_1"), id_bits("panel_2")];
        pair.sort();
        assert_eq!([values[2].to_bits(), values[4].to_bits()], pair);
        // Other pixels, and those that nothing was added to, are empty.
        values.clear();
        names.resolve(coverage.pixel(700), 0.1, &mut values);
        assert_eq!(values, [0.0; 2 * RANKS]);
        coverage.clear();
        assert!(coverage.pixel(3)[0].is_empty());
    }

    #[test]
    fn no_matte_that_is_not_asked_for_has_channels_or_names() {
        let names = Names::new(Mattes { bed: true, ..Mattes::default() });
        assert!(names.mattes.channels().all(|name| name.starts_with("CryptoBed")));
        assert_eq!(names.cryptomattes().len(), 1);
        assert_eq!(Mattes::wanted(|name| name.starts_with("CryptoMaterial")).asked(), [false, true, false]);
        assert_eq!(Mattes::default().channels().count(), 0);
    }
}
