//! Lamps on a path: points, and balls that are sampled over the cone that they fill.

use glam::Vec3;

use super::{
    super::{
        batches::Scratch,
        world::{Lamp, World},
    },
    Link, Purpose,
    by_surface::Asker,
    share,
};

/// A way to a lamp.
struct Aim {
    direction: Vec3,
    reach: f32,
    /// Irradiance on a card across the way: of a ball, its radiance over the density.
    light: Vec3,
    /// Density (1/sr) of the direction; infinite for a point.
    density: f32,
}

impl World<'_> {
    /// One lamp by chance, straight and by way of the surface.
    pub(super) fn ask_lamp(&self, asker: &Asker, scratch: &mut Scratch) {
        let carrier = asker.carrier;
        let count = self.lamps.len();
        if count == 0 {
            return;
        }
        let [pick, u, v, _] = self.numbers(carrier, Purpose::Lamp, scratch);
        let lamp = &self.lamps[((pick * count as f32) as usize).min(count - 1)];
        if lamp.in_water != carrier.in_water {
            self.ask_lamp_by_surface(asker, lamp, [u, v], scratch);
            return;
        }
        if !carrier.in_water {
            self.ask_lamp_by_surface(asker, lamp, [u, v], scratch);
        }
        let Some(aim) = lamp.aim(asker.position, [u, v]) else { return };
        let value = (asker.value)(aim.direction);
        let (bow, drops) = self.bow(asker.drops.as_ref(), aim.direction);
        if value <= 0.0 && drops == Vec3::ZERO {
            return;
        }
        // A point has no density that chance could meet.
        let by_asking = if lamp.radius > 0.0 { share(aim.density / count as f32, value) } else { 1.0 };
        let scattered = Vec3::splat((1.0 - bow) * value * by_asking) + drops;
        let mut light = carrier.throughput * aim.light * scattered * count as f32;
        if carrier.in_water {
            light *= self.medium.transmittance(aim.reach)
                * self.past_bubbles(carrier, asker.position, aim.direction, aim.reach, 1, scratch);
        }
        let light = self.clamped(&carrier.path, light, scratch);
        // A ball's light is weighed against that of paths that meet it by chance, which sheets bend.
        let through_sheets = lamp.radius == 0.0 && !carrier.in_water;
        let link = Link { light, layer: asker.layer, group: lamp.group, through_sheets, ..Link::new(carrier) };
        self.push_link(asker.leave(aim.direction), aim.direction, aim.reach, link, scratch);
    }

    /// Density (1/sr) with which an event at `position` asks for the point of a lamp that it sees.
    pub(super) fn lamp_density(&self, lamp: &Lamp, position: Vec3) -> f32 {
        1.0 / (std::f32::consts::TAU
            * lamp.cone_height((lamp.position - position).length_squared())
            * self.lamps.len() as f32)
    }
}

impl Lamp {
    /// Radiance of the ball's surface; of a point none.
    pub(in crate::render) fn radiance(&self) -> Vec3 {
        if self.radius > 0.0 { self.intensity / (std::f32::consts::PI * self.radius * self.radius) } else { Vec3::ZERO }
    }

    /// 1 - cos of the cone that the ball fills from a squared distance, without the cancellation of a small one.
    fn cone_height(&self, distance2: f32) -> f32 {
        let sine2 = self.radius * self.radius / distance2;
        sine2 / (1.0 + (1.0 - sine2).max(0.0).sqrt())
    }

    /// A point of the lamp that is seen from `position`: `None` from inside its ball.
    ///
    /// *Source*: P. Shirley, C. Wang, K. Zimmerman, Monte Carlo techniques for direct lighting calculations, 1996.
    fn aim(&self, position: Vec3, u: [f32; 2]) -> Option<Aim> {
        let to = self.position - position;
        let distance2 = to.length_squared();
        if distance2 <= (self.radius * self.radius).max(f32::MIN_POSITIVE) {
            return None;
        }
        let distance = distance2.sqrt();
        let axis = to / distance;
        // The lamp is where the way ends: nothing at its very place stands in it.
        let short = 1.0 - 4.0 * f32::EPSILON;
        if self.radius <= 0.0 {
            let light = self.intensity / distance2;
            return Some(Aim { direction: axis, reach: distance * short, light, density: f32::INFINITY });
        }
        let height = self.cone_height(distance2);
        let down = u[0] * height;
        let sine = (down * (2.0 - down)).max(0.0).sqrt();
        let (sin, cos) = (std::f32::consts::TAU * u[1]).sin_cos();
        let (across, along) = axis.any_orthonormal_pair();
        let direction = (axis * (1.0 - down) + (across * cos + along * sin) * sine).normalize();
        let foot = to.dot(direction);
        let half = (self.radius * self.radius - (distance2 - foot * foot)).max(0.0).sqrt();
        let density = 1.0 / (std::f32::consts::TAU * height);
        Some(Aim { direction, reach: (foot - half) * short, light: self.radiance() / density, density })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ball_is_seen_over_its_cone_and_gives_a_points_light_from_afar() {
        let lamp = Lamp {
            position: Vec3::new(0.0, 4.0, 0.0),
            intensity: Vec3::ONE,
            radius: 1.5,
            group: 0,
            index: 0,
            in_water: false,
        };
        let sine = 1.5 / 4.0;
        let (mut sum, count) = (0.0, 4096);
        for index in 0..count {
            let [u, v, ..] = sobol_burley::sample_4d(index, 0, 3);
            let aim = lamp.aim(Vec3::ZERO, [u, v]).unwrap();
            assert!(aim.direction.cross(Vec3::Y).length() <= sine + 1e-5);
            let end = aim.reach * aim.direction;
            assert!(((end - lamp.position).length() - 1.5).abs() < 1e-3, "{end}");
            sum += aim.light.x * aim.direction.y;
        }
        // The irradiance of a whole ball over a level card under it is that of its point: I / d^2.
        let mean = sum / count as f32;
        assert!((mean * 16.0 - 1.0).abs() < 1e-3, "{mean}");
        assert!(lamp.aim(Vec3::new(0.0, 3.0, 0.0), [0.5; 2]).is_none());
    }
}
