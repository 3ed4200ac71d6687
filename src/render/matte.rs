//! The look of everything diffuse at a hit: ground, objects, spray. Both integrators light it, each in its own way.

use glam::Vec3;

use super::{film::Layer, spray::Drops, wave::Arrival, world::World};
use crate::lower::{Material, Shape};
use crate::terrain::{MeshAlbedo, MeshImages};

/// Spray that a ray passes before it takes the next for opaque; a ball counts twice, in and out.
pub(super) const PASSES: u16 = 64;

/// A streak too thin for its roundness to be seen: it is lit as a line (Zöckler, Stalling and Hege, Interactive
/// Visualization of 3D Vector Fields Using Illuminated Stream Lines, 1996; Banks, Illumination in Diverse Codimensions,
/// 1994).
///
/// Of all normals across a line theirs is the one in the plane of light and tangent, whose cosine is the sine of light and
/// tangent, s = sqrt(1 - (l.t)^2). A pixel holds all of them: the mean of a thin round rod's cosine over every normal
/// across it is the integral of s max(0, cos a) over a turn, by 2 pi: s / pi. (The same is the mean over all viewers
/// round the rod of what each sees of it.) Over all directions s / pi integrates to pi^2 / pi = pi, as a card's cosine
/// over its hemisphere does: an albedo of 1 throws back what comes in and no more.
#[derive(Clone, Copy, Debug)]
pub(super) struct Line {
    /// Unit, along the streak.
    tangent: Vec3,
    /// How much it is a line, 0..1; the rest is round.
    share: f32,
}

impl Line {
    /// A streak of `radius` (m) of which a pixel sees `footprint` (m): a line up to a radius of one pixel, round from two.
    fn new(tangent: Vec3, radius: f32, footprint: f32) -> Option<Self> {
        let share = (2.0 - radius / footprint).clamp(0.0, 1.0);
        (tangent.is_finite() && share > 0.0).then_some(Self { tangent, share })
    }

    /// The normal turned to one of those across the line; numbers are uniform. What is thrown back by the cosine about it
    /// goes by [`Matte::cosine`].
    pub(super) fn turned(&self, normal: Vec3, [choice, turn]: [f32; 2]) -> Vec3 {
        if choice >= self.share {
            return normal;
        }
        let (across, along) = self.tangent.any_orthonormal_pair();
        let (sine, cosine) = (std::f32::consts::TAU * turn).sin_cos();
        (across * cosine + along * sine).normalize()
    }

    /// The mean over the normals, of something that is a polynomial of degree up to three in them: four of them tell.
    pub(super) fn mean(&self, normal: Vec3, of: impl Fn(Vec3) -> Vec3) -> Vec3 {
        let (across, along) = self.tangent.any_orthonormal_pair();
        let line = [across, -across, along, -along].into_iter().map(&of).sum::<Vec3>() * 0.25;
        of(normal).lerp(line, self.share)
    }
}

/// Cosine of light from `direction` on something of a normal; see [`Matte::cosine`].
#[inline]
pub(super) fn cosine(normal: Vec3, facing: Option<Vec3>, line: Option<&Line>, direction: Vec3) -> f32 {
    let seen = facing.is_none_or(|facing| facing.dot(direction) > 0.0);
    let round = if seen { normal.dot(direction).max(0.0) } else { 0.0 };
    let Some(Line { tangent, share }) = line else { return round };
    let sine = (1.0 - tangent.dot(direction).powi(2)).max(0.0).sqrt();
    round + share * (sine * std::f32::consts::FRAC_1_PI - round)
}

/// A diffuse thing where a ray met it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Matte {
    /// Linear Rec.709 albedo.
    pub(super) albedo: Vec3,
    /// Unit normal to shade with, towards the viewer.
    pub(super) normal: Vec3,
    /// Unit geometric normal towards the viewer; `None` for what light reaches from both sides.
    pub(super) facing: Option<Vec3>,
    /// It is a streak too thin to be seen as round.
    pub(super) line: Option<Line>,
    /// Share of the sky that what stands around leaves free, where that is known without asking rays.
    pub(super) sky_view: f32,
    /// Share of the light that it stops.
    pub(super) opacity: f32,
    /// Velocity (m/s).
    pub(super) velocity: Vec3,
    /// Layer of what the camera's own rays see of it.
    pub(super) own_layer: Layer,
    /// Depth (m) under the water's surface; 0 in the air.
    pub(super) depth: f32,
    /// It is a drop in the air.
    pub(super) drops: Option<Drops>,
}

impl Matte {
    /// Cosine of light from `direction`; 0 where the thing's own surface is in the way: a smooth shading normal may see
    /// what the flat surface under it turns its back to.
    #[inline]
    pub(super) fn cosine(&self, direction: Vec3) -> f32 {
        cosine(self.normal, self.facing, self.line.as_ref(), direction)
    }
}

impl World<'_> {
    /// The diffuse look of what a ray met; `None` where it leaves a droplet from inside and nothing is there.
    pub(super) fn matte(&self, arrival: &Arrival) -> Option<Matte> {
        let Arrival { carrier, direction, part, primitive, contact, .. } = arrival;
        let towards_viewer = |normal: Vec3| if direction.dot(normal) > 0.0 { -normal } else { normal };
        let mut matte = Matte {
            albedo: Vec3::ZERO,
            normal: if direction.dot(contact.normal) > 0.0 { -contact.shading } else { contact.shading },
            facing: Some(towards_viewer(contact.normal)),
            line: None,
            sky_view: 1.0,
            opacity: 1.0,
            velocity: Vec3::ZERO,
            own_layer: Layer::Terrain,
            depth: if carrier.in_water { self.depth_at(contact.position) } else { 0.0 },
            drops: None,
        };
        match &part.material {
            Material::Ground => {
                let footprint = carrier.distance * self.camera.pixel_angle() as f32;
                let look = self.matter.ground(contact.position, contact.shading, matte.depth, footprint);
                matte.normal = if direction.dot(contact.normal) > 0.0 { -look.normal } else { look.normal };
                matte.sky_view = look.sky_view;
                let spans = carrier.cone.spans(carrier.distance, *direction, contact.normal);
                let image = self.matter.ground_image(contact.position, spans);
                matte.albedo = image.map_or(look.albedo, |image| image.truncate() + (1.0 - image.w) * look.albedo);
            }
            Material::Spray { first } => {
                let ball = matches!(part.shape, Shape::Spheres(_) | Shape::Curves(_));
                if ball && direction.dot(contact.normal) > 0.0 && carrier.passed < PASSES {
                    return None;
                }
                let width = carrier.cone.width(carrier.distance);
                let look = self.spray_look(part, first + *primitive, *primitive, contact, *direction, width);
                matte.own_layer = Layer::Spray;
                matte.velocity = look.velocity;
                matte.opacity = look.opacity;
                if !ball {
                    matte.facing = None;
                }
                if self.bow.is_some() && !carrier.in_water {
                    let radius = self.matter.drop_radius(first + *primitive);
                    matte.drops = radius.map(|radius| Drops { direction: *direction, radius, diffract: false });
                }
                matte.albedo = look.albedo;
                // Under water light comes from above alone, by ways that ask for a normal.
                if let (Shape::Curves(curves), false) = (&part.shape, carrier.in_water) {
                    let [head, tail] = curves.ends[*primitive as usize];
                    let radius = curves.cone(*primitive as usize).ball_under(contact.position.as_dvec3()).1;
                    // Widened, it is as round as it was.
                    let radius = radius * f64::from(look.share);
                    let footprint = carrier.distance * self.camera.pixel_angle() as f32;
                    matte.line = Line::new((head - tail).normalize_or(Vec3::NAN), radius as f32, footprint);
                    if matte.line.is_some() {
                        matte.facing = None;
                    }
                }
            }
            Material::Diffuse(albedo) => matte.albedo = *albedo,
            Material::VertexColours(colours) => matte.albedo = vertex_colour(arrival, colours),
            Material::Images { albedo, images } => {
                let albedo = match &**albedo {
                    MeshAlbedo::Uniform(albedo) => *albedo,
                    MeshAlbedo::PerVertex(colours) => vertex_colour(arrival, colours),
                };
                let spans = carrier.cone.spans(carrier.distance, *direction, contact.normal);
                matte.albedo = albedo * image_colour(arrival, images, spans);
            }
            // Water has a shading of its own.
            Material::Water | Material::Sheet => {}
        }
        Some(matte)
    }

    /// Depth (m) of a point under the water's surface above it; 0 where the water's height is not known.
    fn depth_at(&self, position: Vec3) -> f32 {
        self.matter.water_level(position.x, position.z).map_or(0.0, |level| (level - position.y).max(0.0))
    }
}

fn vertex_colour(arrival: &Arrival, colours: &[Vec3]) -> Vec3 {
    let Shape::Triangles(triangles) = &arrival.part.shape else { return Vec3::ZERO };
    let [a, b, c] = triangles.index[arrival.primitive as usize].map(|corner| colours[corner as usize]);
    let [u, v] = arrival.place;
    a * (1.0 - u - v) + b * u + c * v
}

fn image_colour(arrival: &Arrival, images: &MeshImages, spans: [Vec3; 2]) -> Vec3 {
    let Shape::Triangles(triangles) = &arrival.part.shape else { return Vec3::ONE };
    let corners = triangles.index[arrival.primitive as usize];
    let position = corners.map(|corner| triangles.position[corner as usize]);
    images.at(arrival.primitive, corners, position, arrival.place, spans)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lines_cosine_is_the_mean_over_its_normals_and_throws_back_no_more_than_a_cards() {
        let normal = Vec3::new(0.0, 0.6, 0.8);
        let tangent = Vec3::X;
        for radius in [0.5, 1.5] {
            let line = Line::new(tangent, radius, 1.0).unwrap();
            let steps = 400;
            let (mut whole, mut worst) = (0.0, 0.0_f64);
            for j in 0..steps {
                for i in 0..steps {
                    let y = (f64::from(j) + 0.5) / f64::from(steps) * 2.0 - 1.0;
                    let turn = (f64::from(i) + 0.5) / f64::from(steps) * std::f64::consts::TAU;
                    let side = (1.0 - y * y).sqrt();
                    let direction = glam::DVec3::new(side * turn.sin(), y, side * turn.cos()).as_vec3();
                    let value = f64::from(cosine(normal, None, Some(&line), direction));
                    whole += value * 4.0 * std::f64::consts::PI / f64::from(steps * steps);
                    if i % 40 == 0 && j % 40 == 0 {
                        let count = 256;
                        let mean: f32 = (0..count)
                            .map(|k| {
                                let k = k as f32 + 0.5;
                                line.turned(normal, [k / 16.0 % 1.0, k / count as f32]).dot(direction).max(0.0)
                            })
                            .sum::<f32>()
                            / count as f32;
                        worst = worst.max((f64::from(mean) - value).abs());
                    }
                }
            }
            assert!((whole / std::f64::consts::PI - 1.0).abs() < 1e-3, "{whole}");
            assert!(worst < 5e-3, "{worst}");
        }
        assert!(Line::new(tangent, 2.0, 1.0).is_none() && Line::new(Vec3::NAN, 0.1, 1.0).is_none());
    }

    #[test]
    fn the_mean_over_a_lines_normals_is_exact_for_what_skies_give() {
        let line = Line::new(Vec3::new(0.36, 0.48, 0.8), 0.5, 1.0).unwrap();
        let of = |n: Vec3| Vec3::new(1.0 + n.x, n.y * n.y - n.z * n.x, 2.0 + n.x * n.y - n.z);
        let count = 1000;
        let turned = |k: usize| line.turned(Vec3::Y, [0.0, k as f32 / count as f32]);
        let expected = (0..count).map(|k| of(turned(k))).sum::<Vec3>() / count as f32;
        assert!((line.mean(Vec3::Y, of) - expected).abs().max_element() < 1e-4);
    }
}
