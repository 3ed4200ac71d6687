//! What shading knows of the whole frame: looks, lights, the water's constants, tolerances. Nothing here changes while
//! a picture is rendered.

use glam::{DVec3, Vec3, Vec4};

use crate::{
    accel::Accelerator,
    foam::{Aeration, FoamLook},
    lower::{Lowered, Material},
    mist::Mist,
    optics::{Interface, Medium, Rainbow, Sky, SkySampler, Sun, fresnel, highlight::Lobe},
    particles::Texel,
    scene,
};

use super::{
    Camera, Moment, Sampler,
    caustics::{BeamError, BeamMap, BeamSun, Manifold},
    cone::{self, Cone},
    cryptomatte::{Names, Things},
    single_scattering,
    spray::Bow,
    wave::Arrival,
};

/// The look of the ground at a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GroundLook {
    /// Linear Rec.709 albedo.
    pub albedo: Vec3,
    /// Unit normal to shade with.
    pub normal: Vec3,
    /// Share of the sky that the ground around leaves free, 0..1.
    pub sky_view: f32,
}

/// The look of one particle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SprayLook {
    /// Linear Rec.709 albedo.
    pub albedo: Vec3,
    /// Share of the light that it stops, 0..1: through its middle.
    pub opacity: f32,
    /// Factor on what it stops anywhere, 0..1.
    pub share: f32,
    /// Velocity (m/s).
    pub velocity: Vec3,
}

/// What the integrator asks about matter, in the local frame.
pub trait Matter: Sync {
    /// The ground at `position` with unit normal `normal`, under `depth` metres of water (0 in air); `footprint` is the
    /// width (m) of what one sample sees of it.
    fn ground(&self, position: Vec3, normal: Vec3, depth: f32, footprint: f32) -> GroundLook;
    /// Particle `index`.
    fn spray(&self, index: u32) -> SprayLook;
    /// Height of the water's surface at x, z; `None` where no water is.
    fn water_level(&self, x: f32, z: f32) -> Option<f32>;
    /// Height of the bed at x, z; `None` outside the domain.
    fn bed_level(&self, x: f32, z: f32) -> Option<f32>;
    /// The foam on the water's surface at `position`, over a `footprint` (m); `None` where there is none.
    fn foam(&self, _position: Vec3, _footprint: f32) -> Option<FoamLook> {
        None
    }
    /// Whether there is foam anywhere.
    fn has_foam(&self) -> bool {
        false
    }
    /// Greatest extinction (1/m) of bubbles anywhere; 0 where there are none.
    fn most_bubbles(&self) -> f32 {
        0.0
    }
    /// The mist in the air; `None` where there is none.
    fn mist(&self) -> Option<&Mist> {
        None
    }
    /// Radius (m) of particle `index` as a drop of water; `None` where it is none.
    fn drop_radius(&self, _index: u32) -> Option<f32> {
        None
    }
    /// How drops scatter sunlight; `None` where nobody asks.
    fn rainbow(&self) -> Option<&Rainbow> {
        None
    }
    /// The texture of particle `index` as a billboard at x, y, each -1 to 1 over its disc, y upright, averaged over a
    /// `footprint` of the same unit; `None` without one.
    fn texture(&self, _index: u32, _place: [f32; 2], _footprint: f32) -> Option<Texel> {
        None
    }
    /// The image on the ground at `position`: albedo times cover, and cover, over a footprint that two `spans` across it (m)
    /// give; `None` without one.
    fn ground_image(&self, _position: Vec3, _spans: [Vec3; 2]) -> Option<Vec4> {
        None
    }
    /// Whether there is an image on the ground.
    fn has_ground_image(&self) -> bool {
        false
    }
    /// The bubbles in the water under its surface at x, z; `None` where there are none.
    fn bubbles(&self, _x: f32, _z: f32) -> Option<Aeration> {
        None
    }
}

/// Light group of the sun.
pub(super) const SUN: u16 = 0;

/// Light group of the sky.
pub(super) const SKY: u16 = 1;

/// Names of the light groups: sun, sky, then those of the lamps, each once.
pub(super) fn groups(scene: &scene::Scene) -> Vec<String> {
    let mut groups = vec!["sun".to_owned(), "sky".to_owned()];
    for light in &scene.light {
        if !groups.contains(&light.group) {
            groups.push(light.group.clone());
        }
    }
    groups
}

/// A lamp in the local frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lamp {
    /// Position (m).
    pub(super) position: Vec3,
    /// Radiant intensity.
    pub(super) intensity: Vec3,
    /// Radius (m), 0 for a point.
    pub(super) radius: f32,
    /// Light group.
    pub(super) group: u16,
    /// Its place among the scene's.
    pub(super) index: usize,
    /// It hangs under the water's surface.
    pub(super) in_water: bool,
}

/// What water does to light, in single precision, with what follows from it.
#[derive(Clone, Copy, Debug)]
pub(super) struct WaterLook {
    /// Index of refraction.
    pub(super) ior: f32,
    /// Absorption per metre.
    pub(super) absorption: Vec3,
    fresnel: scene::Fresnel,
    r0: Option<f32>,
    /// Diffuse reflectance of the surface itself.
    pub(super) diffuse: Vec3,
    /// Scale of mirror reflection and highlight.
    pub(super) specular: Vec3,
    /// The sun's image on the surface.
    pub(super) lobe: Lobe,
    /// GGX roughness of the sun's image seen through the surface from below, `None` without a highlight.
    pub(super) alpha: Option<f32>,
    /// Share of a uniform sky's light that a level surface lets in.
    pub(super) diffuse_transmittance: f32,
    /// Mean length of that light's way down, per metre of depth.
    pub(super) diffuse_path: f32,
    /// Share of uniform light from below that the surface sends back down.
    pub(super) diffuse_return: f32,
}

impl WaterLook {
    pub(super) fn new(water: &scene::Water) -> Self {
        let lobe = Lobe::new(water);
        let mut look = Self {
            ior: water.ior as f32,
            absorption: Vec3::from_array(water.absorption.map(|value| value as f32)),
            fresnel: water.fresnel,
            r0: water.r0.map(|value| value as f32),
            diffuse: Vec3::from_array(water.diffuse.map(|value| value as f32)),
            specular: Vec3::from_array(water.specular.map(|value| value as f32)),
            lobe,
            alpha: match lobe {
                Lobe::Ggx { alpha } => Some(alpha),
                // Blinn's relation between a Phong exponent about the mirror direction and a roughness.
                Lobe::Phong { exponent } => Some((8.0 / (exponent + 8.0)).sqrt().min(1.0)),
                Lobe::None => None,
            },
            diffuse_transmittance: 1.0,
            diffuse_path: 1.0,
            diffuse_return: 0.0,
        };
        // 2 * integral of T(mu) mu over mu in 0..1, midpoints: T is smooth but for its last half degree.
        let (mut through, mut cosines) = (0.0, 0.0);
        let steps = 4096;
        for step in 0..steps {
            let cosine = (f64::from(step) + 0.5) / f64::from(steps);
            let share = (1.0 - f64::from(look.reflectance(cosine as f32, false))) * 2.0 * cosine / f64::from(steps);
            let below = (1.0 - (1.0 - cosine * cosine) / (water.ior * water.ior)).sqrt();
            through += share;
            cosines += share * below;
        }
        look.diffuse_transmittance = through as f32;
        // By the mean cosine, as the average cosine of downwelling light is used for its attenuation (Kirk 1984).
        look.diffuse_path = (through / cosines) as f32;
        // Reciprocity: what leaves by a surface of index n is T / n^2 of uniform light from below, the rest comes back.
        look.diffuse_return = (1.0 - through / (water.ior * water.ior)) as f32;
        look
    }

    /// Reflectance for light that arrives at `cosine` from outside or (`from_water`) from inside.
    #[inline]
    pub(super) fn reflectance(&self, cosine: f32, from_water: bool) -> f32 {
        let (from, to) = if from_water { (self.ior, 1.0) } else { (1.0, self.ior) };
        match self.fresnel {
            scene::Fresnel::Exact => fresnel::reflectance_exact(cosine, from, to),
            scene::Fresnel::Schlick => fresnel::reflectance_schlick(cosine, from, to, self.r0),
        }
    }
}

/// The sun as it shines under a level surface.
#[derive(Clone, Copy, Debug)]
pub(super) struct SunBelow {
    /// Unit vector up along the refracted beam.
    pub(super) direction: Vec3,
    /// Irradiance on a card across the beam, just under the surface.
    pub(super) irradiance: Vec3,
}

/// Where paths end.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limits {
    /// Events on diffuse things.
    pub(super) diffuse: u32,
    /// Events in the water.
    pub(super) scattered: u32,
    /// Of how many of the camera's samples how many search for light by way of the surface at first sight.
    pub(super) searches: [u32; 2],
    /// Width (m) of the smallest part of the surface that the search looks into.
    pub(super) caustic_tolerance: f32,
    /// Greatest contribution after the first such event.
    pub(super) clamp: Option<f32>,
}

/// What all moments of a frame share.
pub(super) struct Shared {
    /// Where the sky is bright; only paths ask.
    sky_sampler: Option<SkySampler>,
}

impl Shared {
    pub(super) fn new(scene: &scene::Scene, sky: &Sky) -> Self {
        let paths = scene.render.integrator == scene::Integrator::Path;
        Self { sky_sampler: paths.then(|| SkySampler::new(sky)) }
    }
}

/// Everything about a frame that shading reads.
pub(super) struct World<'a> {
    pub(super) lowered: &'a Lowered,
    pub(super) accelerator: &'a dyn Accelerator,
    pub(super) matter: &'a dyn Matter,
    pub(super) sky: &'a Sky,
    pub(super) sun: Sun,
    pub(super) sun_below: Option<SunBelow>,
    pub(super) lamps: Vec<Lamp>,
    pub(super) water: WaterLook,
    pub(super) camera: Camera,
    pub(super) sampler: Sampler,
    pub(super) sky_visible: bool,
    /// Albedo of the bed at large, for what it throws back at things above it under water: the ground's of the sky.
    pub(super) bed_albedo: Vec3,
    /// Reflections and refractions that are followed.
    pub(super) depth: u16,
    /// The eye is in the water.
    pub(super) eye_in_water: bool,
    pub(super) integrator: scene::Integrator,
    pub(super) sky_sampler: Option<&'a SkySampler>,
    /// The water's border as paths meet it.
    pub(super) interface: Interface,
    /// What paths meet in the water.
    pub(super) medium: Medium,
    /// Finds ways to lights by the water's surface.
    pub(super) manifold: Option<Manifold>,
    /// It finds mirrored light as well.
    pub(super) mirrored: bool,
    /// The sun's light carried down to the bed.
    pub(super) beams: Option<BeamMap>,
    pub(super) limits: Limits,
    /// Greatest extinction (1/m) of bubbles.
    pub(super) most_bubbles: f32,
    /// The mist in the air, if there is any.
    pub(super) mist: Option<&'a Mist>,
    /// Drops scatter light as water does.
    pub(super) bow: Option<Bow<'a>>,
    /// 1 where balls and streaks of spray stop less light towards their edges, 0 where they do so evenly.
    pub(super) softness: f32,
    /// Mean radiance of the sky and the far ground, all around.
    pub(super) mean_sky: Vec3,
    /// What Cryptomatte tells apart.
    pub(super) things: Things,
    /// Links may be thinned by spray, or by sheets of it.
    pub(super) may_thin: bool,
    /// There are images whose detail a ray's width averages: how the water bends it is worth knowing.
    pub(super) has_images: bool,
    /// Tolerance of a surface hit: metres, and metres per metre travelled.
    pub(super) tolerance: [f32; 2],
    /// The same for rays after the first.
    pub(super) secondary_tolerance: [f32; 2],
}

impl<'a> World<'a> {
    pub(super) fn new(
        scene: &scene::Scene,
        shared: &'a Shared,
        moment: &Moment<'a>,
        sky: &'a Sky,
        camera: Camera,
        names: &mut Names,
    ) -> Result<Self, BeamError> {
        let Moment { lowered, accelerator, matter, .. } = *moment;
        let water = WaterLook::new(&scene.water);
        let sun = Sun::build(&scene.sun, &scene.sky);
        let groups = groups(scene);
        let under_water = |point: Vec3| {
            let over_bed = matter.bed_level(point.x, point.z).is_none_or(|bed| point.y > bed);
            over_bed && matter.water_level(point.x, point.z).is_some_and(|level| point.y < level)
        };
        let local = |point: DVec3| (point - lowered.origin).as_vec3();
        let lamps: Vec<Lamp> = scene
            .light
            .iter()
            .enumerate()
            .map(|(index, light)| Lamp {
                index,
                position: local(light.position.into()),
                in_water: under_water(local(light.position.into())),
                intensity: Vec3::from_array(light.intensity.map(|value| value as f32)),
                radius: light.radius as f32,
                group: groups.iter().position(|group| *group == light.group).unwrap_or_default() as u16,
            })
            .collect();
        let mist = matter.mist().filter(|mist| !mist.is_empty());
        // The Whitted integrator's lamps are points that nobody sees.
        let paths = scene.render.integrator == scene::Integrator::Path;
        let shining: Vec<Option<&str>> =
            scene.light.iter().map(|light| (paths && light.radius > 0.0).then_some(&*light.group)).collect();
        let things = names.add(lowered, matter.has_foam(), mist.is_some(), &shining);
        let interface = Interface::from_scene(&scene.water);
        let tolerance = match scene.surface.tolerance {
            Some(metres) => [metres as f32, 0.0],
            None => [0.0, (scene.surface.accuracy * camera.pixel_angle()) as f32],
        };
        let mut world = Self {
            lowered,
            accelerator,
            matter,
            sky,
            sun,
            sun_below: sun_below(&sun, &water),
            lamps,
            water,
            camera,
            sampler: Sampler::new(&scene.render),
            sky_visible: scene.sky.visible,
            bed_albedo: Vec3::from_array(scene.sky.ground_albedo.map(|value| value as f32)),
            depth: scene.render.depth.min(u32::from(u16::MAX)) as u16,
            // Without a bed the water is closed by whatever else stands there, and being under its top is what counts.
            eye_in_water: under_water(local(camera.pose.eye)),
            integrator: scene.render.integrator,
            sky_sampler: shared.sky_sampler.as_ref(),
            interface,
            medium: Medium::from_scene(&scene.water),
            manifold: None,
            mirrored: scene.render.mirrored_caustics,
            beams: None,
            limits: Limits {
                diffuse: scene.render.diffuse_depth,
                scattered: scene.render.volume_depth,
                searches: [scene.render.samples, scene.render.caustic_samples.unwrap_or(scene.render.samples)],
                caustic_tolerance: 0.0,
                clamp: scene.render.clamp.map(|limit| limit as f32),
            },
            most_bubbles: matter.most_bubbles(),
            mist,
            things,
            softness: scene.particles.softness as f32,
            bow: matter.rainbow().filter(|_| scene.particles.rainbow > 0.0).map(|rainbow| Bow {
                rainbow,
                share: scene.particles.rainbow as f32,
                mist_radius: scene.particles.droplet_radius as f32,
            }),
            mean_sky: single_scattering::mean_radiance(sky),
            may_thin: lowered
                .parts
                .iter()
                .any(|part| matches!(part.material, Material::Spray { .. } | Material::Sheet)),
            has_images: sky.is_image()
                || matter.has_ground_image()
                || lowered.parts.iter().any(|part| matches!(part.material, Material::Images { .. })),
            tolerance,
            secondary_tolerance: tolerance.map(|part| part * scene.surface.secondary_accuracy as f32),
        };
        let caustics = scene.caustics();
        let lit = !world.lamps.is_empty() || world.sun.irradiance.max_element() > 0.0;
        if let Some(water) = moment.water.filter(|_| lit && caustics != scene::Caustics::Off) {
            // Beams carry the sun to the bed alone: what is scattered in the water, and lamps, still ask the surface.
            let column = water.lattice().width.into_iter().fold(f64::INFINITY, f64::min);
            world.limits.caustic_tolerance = (scene.render.caustic_accuracy * column) as f32;
            world.manifold = Some(Manifold::new(water));
            if caustics == scene::Caustics::Beams {
                let sun = BeamSun {
                    direction: world.sun.direction,
                    irradiance: world.sun.irradiance,
                    ior: world.water.ior,
                    attenuation: world.medium.extinction(),
                    reflectance: &|cosine| world.water.reflectance(cosine, false),
                    clear: &|point| world.clear_of_mist(point, world.sun.direction, f32::INFINITY),
                };
                let beams = BeamMap::build(water, lowered, accelerator, &sun, scene.render.beam_samples)?;
                world.beams = Some(beams);
            }
        }
        Ok(world)
    }

    /// The width of the camera's rays.
    #[inline]
    pub(super) fn pixel_cone(&self) -> Cone {
        Cone::pixel(self.camera.pixel_angle() as f32)
    }

    /// By how much the normal of water turns over what a ray covers where it has met it; 0 where no image asks.
    #[inline]
    pub(super) fn bend(&self, arrival: &Arrival) -> f32 {
        if !self.has_images {
            return 0.0;
        }
        let Arrival { carrier, direction, part, primitive, place, contact, .. } = arrival;
        cone::bend(part, *primitive, *place, contact, *direction, carrier.cone.width(carrier.distance))
    }

    /// Tolerance (m) at the start of a reflected, refracted or shadow ray, `distance` metres after the eye.
    #[inline]
    pub(super) fn secondary_tolerance_at(&self, distance: f32) -> f32 {
        self.secondary_tolerance[0] + self.secondary_tolerance[1] * distance
    }
}

/// The sun's beam under a level surface: bent, thinned by reflection, and as wide as its own new slant.
fn sun_below(sun: &Sun, water: &WaterLook) -> Option<SunBelow> {
    let cosine = sun.direction.y;
    if cosine <= 0.0 || sun.irradiance.max_element() <= 0.0 {
        return None;
    }
    let direction = -fresnel::refract(-sun.direction, Vec3::Y, 1.0, water.ior)?;
    let through = 1.0 - water.reflectance(cosine, false);
    Some(SunBelow { direction, irradiance: sun.irradiance * (through * cosine / direction.y) })
}
