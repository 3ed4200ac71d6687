//! The look of the ground: rock where it is steep, sand and gravel by the water, wet where water reaches, soil and grass above.
//!
//! All from the place, the slope, the height above the water and noise; no textures. Detail finer than a pixel's footprint
//! fades to its mean. Colours are linear Rec.709 albedos of natural materials, 0.03 to 0.45.

use glam::{DVec3, Vec3};

use crate::scene;

use super::noise::Field;

/// Where the ground is asked for its look.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GroundPoint {
    /// Place in the local frame (m).
    pub position: Vec3,
    /// Unit geometric normal, upward.
    pub normal: Vec3,
    /// Metres above (+) or below (-) the nearest water; +inf where there is none.
    pub height_above_water: f32,
    /// Metres of water over it, 0 for dry ground.
    pub water_depth: f32,
}

/// The ground of a scene.
#[derive(Clone, Debug)]
pub struct Ground {
    kind: Kind,
}

#[derive(Clone, Debug)]
enum Kind {
    Plain(Vec3),
    Natural(Box<Natural>),
}

#[derive(Clone, Debug)]
struct Natural {
    /// A slow drift between patches of meadow, so that a wide view is not the same everywhere.
    regions: Field,
    /// Large patches, from `detail` downward.
    patches: Field,
    /// Grain and relief, from a tenth of `detail` downward.
    grain: Field,
    /// Height (m) of the band of sand above the water.
    shore: f32,
    /// Height (m) to which waves and seepage keep it wet.
    wet: f32,
}

impl Ground {
    /// The ground that a scene asks for; `column_width` (m) sets the size of its detail where the scene does not.
    ///
    /// `origin` is where the local frame lies in the world: the pattern belongs to the world, not to the frame.
    pub fn build(terrain: &scene::Terrain, column_width: f64, origin: DVec3) -> Self {
        let kind = match terrain.ground {
            scene::Ground::Plain => Kind::Plain(Vec3::from_array(terrain.albedo.map(|value| value as f32))),
            scene::Ground::Natural => {
                let detail = terrain.detail.unwrap_or(20.0 * column_width);
                // Shores grow more slowly than the landscape: decimetres by a brook, metres by a river valley of 90 m columns.
                let shore = (0.06 * detail.powf(0.6)) as f32;
                Kind::Natural(Box::new(Natural {
                    regions: Field::new(5.3 * detail, origin, 3),
                    patches: Field::new(detail, origin, 1),
                    grain: Field::new(0.11 * detail, origin, 2),
                    shore,
                    // Capillary rise and splash end at half a metre, however large the landscape.
                    wet: (0.6 * shore).min(0.5),
                }))
            }
        };
        Self { kind }
    }

    /// Albedo, detail finer than `footprint` (m) averaged away.
    #[inline]
    pub fn albedo(&self, point: &GroundPoint, footprint: f32) -> Vec3 {
        match &self.kind {
            Kind::Plain(albedo) => *albedo,
            Kind::Natural(natural) => natural.look(point, footprint).0,
        }
    }

    /// Unit shading normal: the geometric one, tilted by relief that the bed's columns are too coarse for.
    #[inline]
    pub fn bump(&self, point: &GroundPoint, footprint: f32) -> Vec3 {
        self.look(point, footprint).1
    }

    /// Albedo and shading normal at once, for the price of little more than one.
    #[inline]
    pub fn look(&self, point: &GroundPoint, footprint: f32) -> (Vec3, Vec3) {
        match &self.kind {
            Kind::Plain(albedo) => (*albedo, point.normal),
            Kind::Natural(natural) => natural.look(point, footprint),
        }
    }
}

/// 0 up to `low`, 1 from `high`, smooth between; infinite values are fine.
#[inline]
fn ramp(low: f32, high: f32, value: f32) -> f32 {
    let t = ((value - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

const fn rgb(r: f32, g: f32, b: f32) -> Vec3 {
    Vec3::new(r, g, b)
}

impl Natural {
    fn look(&self, point: &GroundPoint, footprint: f32) -> (Vec3, Vec3) {
        let p = point.position;
        let broad = self.patches.plan(p, footprint, 0, 5, 0.55) + 0.5 * self.regions.plan(p, footprint, 0, 1, 1.0);
        let (fine, slope) = self.grain.with_slope(p, footprint, 0, 6, 0.7);
        // Borders are ragged by both scales of noise.
        let ragged = 0.7 * broad + 0.35 * fine;
        let height = point.height_above_water + 0.7 * self.shore * ragged;

        let steep = 1.0 - point.normal.y.clamp(0.0, 1.0);
        let rock = ramp(0.10, 0.26, steep + 0.07 * ragged);
        let shore = 1.0 - ramp(0.6 * self.shore, 2.4 * self.shore, height);
        let grass = ramp(1.2 * self.shore, 4.5 * self.shore, height + 1.5 * self.shore * broad)
            * ramp(-0.45, 0.15, broad + 0.3 * fine)
            * (1.0 - ramp(0.05, 0.16, steep + 0.04 * fine));

        let mut albedo = self.soil(broad, fine);
        if grass > 0.0 {
            albedo = albedo.lerp(self.grass(p, footprint, broad, fine), grass);
        }
        if shore > 0.0 {
            albedo = albedo.lerp(self.sand(p, footprint, broad, fine, height), shore);
        }
        if rock > 0.0 {
            albedo = albedo.lerp(self.rock(p, footprint, broad, fine), rock);
        }

        let reach = self.wet * (0.7 + 0.6 * ragged).max(0.1);
        // Under water the renderer's own surface darkens the ground, by the same Fresnel terms as `wet`: once is enough.
        let wetness =
            if point.water_depth > 0.0 { 0.0 } else { 1.0 - ramp(0.3 * reach, reach, point.height_above_water) };
        if wetness > 0.0 {
            albedo = albedo.lerp(wet(albedo), wetness);
        }
        // A brown-green film grows on what stays under water.
        let film = 0.35 * ramp(0.0, 1.5 * self.shore, -height);
        if film > 0.0 {
            albedo = albedo.lerp(albedo * rgb(0.92, 0.98, 0.72), film);
        }

        // Relief is strongest on rock and among stones, least in sand above the water.
        let relief = 0.16 + 0.16 * rock + 0.08 * grass;
        let across = slope - slope.dot(point.normal) * point.normal;
        let normal = (point.normal - relief * across).normalize_or(point.normal);
        (albedo, normal)
    }

    fn soil(&self, broad: f32, fine: f32) -> Vec3 {
        let dry = ramp(-0.5, 0.6, broad + 0.4 * fine);
        rgb(0.115, 0.082, 0.054).lerp(rgb(0.235, 0.182, 0.122), dry) * (1.0 + 0.35 * fine)
    }

    fn grass(&self, p: Vec3, footprint: f32, broad: f32, fine: f32) -> Vec3 {
        // Tufts: the finest octaves alone, so that they show against the patches.
        let tufts = self.grain.plan(p, footprint, 3, 8, 0.8);
        let lush = rgb(0.050, 0.070, 0.024);
        let dry = rgb(0.190, 0.168, 0.078);
        let green = lush.lerp(rgb(0.098, 0.112, 0.042), ramp(-0.6, 0.6, tufts));
        green.lerp(dry, 0.8 * ramp(-0.2, 0.7, broad + 0.5 * fine)) * (1.0 + 0.3 * tufts.max(-1.0))
    }

    fn sand(&self, p: Vec3, footprint: f32, broad: f32, fine: f32, height: f32) -> Vec3 {
        let stones = self.grain.plan(p, footprint, 1, 7, 0.85);
        let sand = rgb(0.300, 0.258, 0.192) * (1.0 + 0.12 * fine);
        // Stones of two colours, as a river brings them.
        let gravel = rgb(0.155, 0.148, 0.138).lerp(rgb(0.315, 0.282, 0.232), ramp(-0.5, 0.5, stones))
            * (1.0 + 0.25 * fine + 0.3 * broad);
        // The current carries sand away: gravel under water and at its edge, sand where it dries out, both in patches.
        let washed = ramp(0.5, -0.4, height / self.shore - 0.8 * broad);
        sand.lerp(gravel, (0.25 + 0.75 * washed).min(1.0))
    }

    fn rock(&self, p: Vec3, footprint: f32, broad: f32, fine: f32) -> Vec3 {
        // Beds: layers over height, bent by the broad noise.
        let bent = p.y + 0.35 * self.shore * (broad + 0.3 * fine);
        let beds = 0.6 * self.grain.layer(1, bent, footprint) + 0.4 * self.grain.layer(3, bent, footprint);
        let grey = rgb(0.165, 0.158, 0.150).lerp(rgb(0.300, 0.285, 0.262), ramp(-0.6, 0.6, 0.7 * beds + 0.8 * fine));
        // Iron stains follow the patches.
        let stained = grey.lerp(rgb(0.265, 0.195, 0.135), 0.55 * ramp(0.05, 0.7, broad + 0.3 * beds));
        stained * (1.0 + 0.28 * fine)
    }
}

/// Albedo of wet ground: light that the ground throws back is partly caught again under the film's surface.
///
/// Source: Angstrom 1925 as in Lekner and Dorf, Why Some Things Are Darker When Wet, 1988: (1-r)(1-p) a / (1 - p a), with
/// water's diffuse reflectance r = 0.066 from outside and p = 1 - (1-r)/n^2 = 0.474 from inside.
fn wet(albedo: Vec3) -> Vec3 {
    const OUTSIDE: f32 = 0.066;
    const INSIDE: f32 = 0.474;
    (1.0 - OUTSIDE) * (1.0 - INSIDE) * albedo / (Vec3::ONE - INSIDE * albedo)
}

#[cfg(test)]
mod look;
#[cfg(test)]
mod tests;
