//! What is particular to spray: drops that scatter light as water does, textures on billboards, and rays that go on behind what
//! turned to them. Both integrators ask here; how they light and weigh it is theirs.

use glam::Vec3;

use super::{
    contact::Contact,
    wave::Arrival,
    world::{SprayLook, World},
};
use crate::{
    lower::{Part, Shape},
    optics::Rainbow,
};

/// Drops of water that scatter light by their own phase function.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bow<'a> {
    pub(super) rainbow: &'a Rainbow,
    /// Share of the light of sun and lamps that they scatter so.
    pub(super) share: f32,
    /// Radius (m) of mist's droplets.
    pub(super) mist_radius: f32,
}

/// Drops where a ray has met them.
#[derive(Clone, Copy, Debug)]
pub(super) struct Drops {
    /// Unit, along the eye's ray.
    pub(super) direction: Vec3,
    /// Metres.
    pub(super) radius: f32,
    /// They stop twice their outline, of which one half is diffracted; else their outline alone.
    pub(super) diffract: bool,
}

impl World<'_> {
    /// Drops of mist on a ray.
    pub(super) fn mist_drops(&self, direction: Vec3) -> Option<Drops> {
        self.bow.map(|bow| Drops { direction, radius: bow.mist_radius, diffract: true })
    }

    /// The share of a light that drops scatter by their own phase function, and that times its value (1/sr) towards a light.
    ///
    /// Light without it is what it was: it takes 1 - share of the plain one's. It is only ever asked for, never met by
    /// chance: a direction that is chosen by the plain function finds the plain share.
    #[inline]
    pub(super) fn bow(&self, drops: Option<&Drops>, to_light: Vec3) -> (f32, Vec3) {
        let (Some(Bow { rainbow, share, .. }), Some(drops)) = (self.bow, drops) else { return (0.0, Vec3::ZERO) };
        let cosine = drops.direction.dot(to_light);
        let value = if drops.diffract {
            rainbow.scattered(drops.radius, cosine)
        } else {
            rainbow.refracted(drops.radius, cosine)
        };
        (share, share * value)
    }

    /// A particle's look where a ray along `direction` has met it: of a billboard with a texture, what a ray of `width` (m) sees
    /// of it there; of balls and streaks as opaque as what the ray passes of them.
    pub(super) fn spray_look(
        &self,
        part: &Part,
        index: u32,
        primitive: u32,
        contact: &Contact,
        direction: Vec3,
        width: f32,
    ) -> SprayLook {
        let mut look = self.matter.spray(index);
        if matches!(part.shape, Shape::Spheres(_) | Shape::Curves(_)) {
            // Finer drops whose density falls from the middle as 1 - (distance / radius)^2: along a chord of half length c
            // (in radii) there are c^3 times as many as through the middle. Light falls as Beer and Lambert have it.
            let chord = direction.dot(contact.normal).abs().min(1.0);
            let drops = 1.0 - self.softness * (1.0 - chord * chord * chord);
            look.opacity = 1.0 - (1.0 - look.opacity).powf(drops);
        }
        look.opacity *= look.share;
        if let Shape::Discs(discs) = &part.shape {
            let offset = contact.position - discs.center[primitive as usize];
            let axis = contact.normal;
            // Upright in the world, from whichever side it is seen; seen from above, x is east.
            let right = Vec3::Y.cross(axis).normalize_or(Vec3::X);
            let place = [right, axis.cross(right)].map(|side| offset.dot(side) / discs.radius[primitive as usize]);
            let footprint = width / discs.radius[primitive as usize];
            if let Some(texel) = self.matter.texture(index, place, footprint) {
                look.albedo *= texel.color;
                look.opacity *= texel.alpha;
            }
        }
        look
    }

    /// Origin and least t of the ray that goes on behind what let it through.
    ///
    /// What faces a ray's origin stands differently for each origin, and is not met at all from within its ball: of all that
    /// lie in a row, the ray itself must go on, not another one from the first.
    pub(super) fn behind(part: &Part, contact: &Contact, origin: Vec3, direction: Vec3, t: f32) -> (Vec3, f32) {
        match &part.shape {
            Shape::Discs(discs) if discs.normal.is_none() => (origin, t.next_up()),
            _ => (contact.leave(direction), 0.0),
        }
    }

    /// [`World::behind`] what a wave's ray has met, and its tolerance (m) at that origin.
    pub(super) fn behind_arrival(&self, arrival: &Arrival) -> (Vec3, f32, f32) {
        let Arrival { carrier, direction, part, contact, whole, .. } = arrival;
        let (origin, tnear) = Self::behind(part, contact, whole.0, *direction, whole.1);
        (origin, tnear, self.secondary_tolerance_at((carrier.distance - tnear).max(0.0)))
    }
}
