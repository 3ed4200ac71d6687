//! The border of two dielectrics, smooth or covered with ripples too small to be in the surface: where light goes next.
//!
//! GGX facets (B. Walter et al., Microfacet models for refraction through rough surfaces, 2007), one bounce among them,
//! drawn by what is seen of them (J. Dupuy and A. Benyoub, Sampling visible GGX normals with spherical caps, 2023).
//! Fresnel's factor and the n^2 of radiance are the caller's, so that both reflectance formulas and both kinds of
//! transport (radiance, importance) serve. Highlights of the noise-free integrator are in `highlight`.

use std::f32::consts::{PI, TAU};

use glam::Vec3;

use crate::scene;

use super::fresnel;

/// A border between air and a denser medium.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interface {
    /// GGX roughness, 0 to 1: tangents of the facets' tilts are spread by about this.
    pub alpha: f32,
    /// Index of refraction of the denser side; the other side is air.
    pub ior: f32,
}

/// Where light goes on from a border.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounce {
    /// Unit vector away from the point.
    pub direction: Vec3,
    /// Facets' value times cosine over density, without Fresnel's factor: what the facets' shadowing leaves, 0 to 1.
    pub weight: f32,
    /// Density (1/sr) with which `facet` and then this kind of bounce give this direction; infinite for a smooth border.
    pub pdf: f32,
    /// Unit normal of the facet, on the eye's side.
    pub facet: Vec3,
}

/// What a border sends from one direction into another.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Evaluation {
    /// The facets' value times the cosine at the light (1/sr), without Fresnel's factor and without n^2 of radiance.
    pub value: f32,
    /// Density (1/sr) with which `facet` and then this kind of bounce would have given the light's direction.
    pub pdf: f32,
    /// Cosine between the eye and the facet that does it: Fresnel's incident cosine.
    pub cosine: f32,
}

/// Share of the facets' spread by which rounding may move a facet, where an interface still counts as rough.
const FACET_ROUNDING: f32 = 0.01;

impl Interface {
    /// The surface of a scene's water.
    pub fn from_scene(water: &scene::Water) -> Self {
        Self { alpha: water.roughness as f32, ior: water.ior as f32 }
    }

    /// Whether light is mirrored and bent as by a plane: bounces are without density, evaluations are 0.
    ///
    /// A rough border finds its facet from two directions, each component of which is rounded by 2^-24. Through
    /// refraction the facet is `n to_light + to_eye`, n - 1 long, made of terms that add up to n + 1: its slope is off by
    /// 2^-24 (n + 1) / (n - 1). Where that is over a hundredth of alpha (for water, alpha under 4.2e-5), densities would be
    /// noise; the lobe is then 1/100 of the sun's disc wide, and it counts as none. Equal indices bend nothing: smooth.
    #[inline]
    pub fn is_smooth(&self) -> bool {
        let rounding = 0.5 * f32::EPSILON;
        // Not (alpha > limit), so that an alpha that is no number is smooth as well.
        !(self.alpha * (self.ior - 1.0).abs() * FACET_ROUNDING > rounding * (self.ior + 1.0))
    }

    /// Unit normal of a facet as the eye sees it, on the eye's side.
    ///
    /// `normal` and `to_eye` are unit vectors, `normal` on the eye's side; an eye that rounding or interpolation put under
    /// the surface is taken as level with it. The normal itself for a smooth border.
    #[inline]
    pub fn facet(&self, normal: Vec3, to_eye: Vec3, u: [f32; 2]) -> Vec3 {
        if self.is_smooth() {
            return normal;
        }
        let (across, along) = normal.any_orthonormal_pair();
        let eye = Vec3::new(to_eye.dot(across), to_eye.dot(along), to_eye.dot(normal).max(0.0));
        // Stretched so that the facets are those of a hemisphere, of which the eye sees a cap (Dupuy and Benyoub, list. 3).
        let eye = Vec3::new(self.alpha * eye.x, self.alpha * eye.y, eye.z).normalize_or(Vec3::Z);
        let height = (1.0 - u[1]) * (1.0 + eye.z);
        let z = height - eye.z;
        let side = ((1.0 - z) * (1.0 + z)).max(0.0).sqrt();
        let (sin, cos) = (TAU * u[0]).sin_cos();
        let half = Vec3::new(side * cos + eye.x, side * sin + eye.y, height);
        let facet = self.alpha * half.x * across + self.alpha * half.y * along + half.z * normal;
        // Only the cap's very edge has no length.
        facet.normalize_or(normal)
    }

    /// The mirrored direction; `None` where it would go through the surface.
    #[inline]
    pub fn reflect(&self, normal: Vec3, to_eye: Vec3, facet: Vec3) -> Option<Bounce> {
        let direction = fresnel::reflect(-to_eye, facet).normalize();
        let (cos_eye, cos_light) = (normal.dot(to_eye).max(0.0), normal.dot(direction));
        let facet_cosine = facet.dot(to_eye);
        if !(cos_light > 0.0 && facet_cosine > 0.0) {
            return None;
        }
        if self.is_smooth() {
            return Some(Bounce { direction, weight: 1.0, pdf: f32::INFINITY, facet });
        }
        let pdf = self.visible(normal, cos_eye, facet) * 0.25;
        Some(Bounce { direction, weight: self.unshadowed(cos_eye, cos_light), pdf, facet })
    }

    /// The refracted direction; `None` at total reflection, and where it would not go through the surface.
    ///
    /// `from_water` says that the eye is on the denser side.
    #[inline]
    pub fn refract(&self, normal: Vec3, to_eye: Vec3, facet: Vec3, from_water: bool) -> Option<Bounce> {
        let (eta_eye, eta_light) = self.indices(from_water);
        let facet_cosine = facet.dot(to_eye);
        if !(facet_cosine > 0.0) {
            return None;
        }
        let direction = fresnel::refract(-to_eye, facet, eta_eye, eta_light)?;
        let (cos_eye, cos_light) = (normal.dot(to_eye).max(0.0), -normal.dot(direction));
        if !(cos_light > 0.0) {
            return None;
        }
        if self.is_smooth() {
            return Some(Bounce { direction, weight: 1.0, pdf: f32::INFINITY, facet });
        }
        let spread = self.spread(facet_cosine, -facet.dot(direction), eta_eye, eta_light);
        let pdf = self.visible(normal, cos_eye, facet) * facet_cosine * spread;
        Some(Bounce { direction, weight: self.unshadowed(cos_eye, cos_light), pdf, facet })
    }

    /// What is mirrored from `to_light` to `to_eye`; all 0 for a smooth border and where no facet does it.
    #[inline]
    pub fn evaluate_reflection(&self, normal: Vec3, to_eye: Vec3, to_light: Vec3) -> Evaluation {
        let (cos_eye, cos_light) = (normal.dot(to_eye).max(0.0), normal.dot(to_light));
        if self.is_smooth() || !(cos_light > 0.0) {
            return Evaluation::default();
        }
        let Some(facet) = (to_eye + to_light).try_normalize() else { return Evaluation::default() };
        let cosine = facet.dot(to_eye);
        if !(cosine > 0.0 && facet.dot(normal) > 0.0) {
            return Evaluation::default();
        }
        let pdf = self.visible(normal, cos_eye, facet) * 0.25;
        Evaluation { value: pdf * self.unshadowed(cos_eye, cos_light), pdf, cosine: cosine.min(1.0) }
    }

    /// What is refracted from `to_light` to `to_eye`; all 0 for a smooth border and where no facet does it.
    #[inline]
    pub fn evaluate_refraction(&self, normal: Vec3, to_eye: Vec3, to_light: Vec3, from_water: bool) -> Evaluation {
        let (cos_eye, cos_light) = (normal.dot(to_eye).max(0.0), -normal.dot(to_light));
        if self.is_smooth() || !(cos_light > 0.0) {
            return Evaluation::default();
        }
        let (eta_eye, eta_light) = self.indices(from_water);
        // The sum of both, each as long as its index, stands on the facet and points into the denser side.
        let Some(sum) = (eta_eye * to_eye + eta_light * to_light).try_normalize() else { return Evaluation::default() };
        let facet = if eta_light > eta_eye { -sum } else { sum };
        let (cosine, beyond) = (facet.dot(to_eye), -facet.dot(to_light));
        if !(cosine > 0.0 && beyond > 0.0 && facet.dot(normal) > 0.0) {
            return Evaluation::default();
        }
        let pdf = self.visible(normal, cos_eye, facet) * cosine * self.spread(cosine, beyond, eta_eye, eta_light);
        Evaluation { value: pdf * self.unshadowed(cos_eye, cos_light), pdf, cosine: cosine.min(1.0) }
    }

    /// Slopes (tangents along two axes) of a facet by the facets' own distribution, whoever sees them, and a weight.
    ///
    /// The density over slopes is P22(s) = 1 / (pi alpha^2 (1 + |s|^2 / alpha^2)^2). With the weight, 1 over the facet's
    /// cosine, a mean over such facets is an integral over solid angle against Walter's D; without it, against D times the
    /// facet's cosine, which is 1 in all. Zero slopes for a smooth border.
    #[inline]
    pub fn slopes(&self, u: [f32; 2]) -> ([f32; 2], f32) {
        if self.is_smooth() {
            return ([0.0; 2], 1.0);
        }
        // Random numbers of 24 bits end at 1 - 2^-24: the longest slope is 4096 alpha.
        let length = self.alpha * (u[1] / (1.0 - u[1]).max(0.5 * f32::EPSILON)).sqrt();
        let (sin, cos) = (TAU * u[0]).sin_cos();
        ([length * cos, length * sin], (1.0 + length * length).sqrt())
    }

    /// Indices on the eye's and the light's side of a refraction.
    #[inline]
    fn indices(&self, from_water: bool) -> (f32, f32) {
        if from_water { (self.ior, 1.0) } else { (1.0, self.ior) }
    }

    /// Density of seen facets over the cosine between facet and eye: D G1 / cos(eye) (Heitz 2018, eq. 1).
    #[inline]
    fn visible(&self, normal: Vec3, cos_eye: f32, facet: Vec3) -> f32 {
        let alpha2 = self.alpha * self.alpha;
        let cos_facet = normal.dot(facet);
        // 1 - cos^2 from the cross product: near the peak the plain difference would lose all its digits.
        let width = cos_facet * cos_facet * alpha2 + normal.cross(facet).length_squared();
        let distribution = alpha2 / (PI * width * width);
        // G1 / cos = 2 / (cos + sqrt(cos^2 + alpha^2 sin^2)): no division by a vanishing cosine.
        distribution * 2.0 / (cos_eye + self.stretched(cos_eye))
    }

    /// G2 / G1: share of the light that other facets let pass, of which the eye sees the facet already.
    ///
    /// Smith's masking and shadowing, correlated by height (E. Heitz, Understanding the masking-shadowing function, 2014,
    /// eq. 99): G2 = 1 / (1 + a + b), both for reflection and refraction. For the latter light leaves among facets lower,
    /// not higher, and a beta function of 1 + a and 1 + b stands there (Heitz et al., Multiple-scattering microfacet BSDFs,
    /// 2016): what it takes away are later bounces, which would come back out. They are not followed here, so the form that
    /// loses least is right for the whole. Never over 1: no energy is made.
    #[inline]
    fn unshadowed(&self, cos_eye: f32, cos_light: f32) -> f32 {
        // 1 + 2 Lambda = stretched / cos; numerator and denominator are taken times both cosines.
        let (eye, light) = (self.stretched(cos_eye), self.stretched(cos_light));
        ((cos_eye + eye) * cos_light / (eye * cos_light + light * cos_eye)).min(1.0)
    }

    /// Length of a unit vector of this cosine after the sideways stretch by alpha.
    #[inline]
    fn stretched(&self, cosine: f32) -> f32 {
        let cosine = cosine.min(1.0);
        (cosine * cosine + self.alpha * self.alpha * (1.0 - cosine) * (1.0 + cosine)).sqrt()
    }

    /// Solid angle of facets per solid angle of refracted light (Walter 2007, eq. 17); both cosines positive.
    #[inline]
    fn spread(&self, facet_cosine: f32, beyond_cosine: f32, eta_eye: f32, eta_light: f32) -> f32 {
        let length = eta_eye * facet_cosine - eta_light * beyond_cosine;
        eta_light * eta_light * beyond_cosine / (length * length)
    }
}

#[cfg(test)]
mod tests;
