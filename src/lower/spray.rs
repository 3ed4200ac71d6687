//! Particles → parts: what each class of spray is drawn as.

use std::sync::Arc;

use glam::{DVec3, Vec3};

use super::memory::{Account, Counts};
use super::{Curves, Discs, LowerError, Material, Shape, Spheres, Triangles, scene_origin};
use crate::mist::{self, Droplets, Mist, MistSettings};
use crate::particles::{self, Class, Judged, Shares, Sight, Spray};
use crate::scene::{DropMatter, Facing, ParticleRepresentation, Scene};
use crate::simd::SimdLevel;
use crate::state::{Frame, Particles};
use crate::surface::{SplineSurface, control};

/// Metres that a place lies under the water's surface; negative above it and where there is none.
fn depth(water: Option<&SplineSurface>, place: Vec3) -> f32 {
    let level = water.and_then(|water| water.height(place.x, place.z));
    level.map_or(f32::NEG_INFINITY, |level| level - place.y)
}

/// What each particle is.
fn judged(scene: &Scene, spray: &Spray, water: Option<&SplineSurface>) -> Vec<Shares> {
    let [whole, _] = streak_seconds(scene);
    let judged =
        Judged { position: &spray.position, velocity: &spray.velocity, radius: &spray.radius, exposure: whole as f32 };
    particles::shares(&judged, &scene.particles.classes, |place| depth(water, place))
}

/// How many particles of a frame are of each class, in the order of [`Class::ALL`]; who is of several counts in parts.
///
/// # Errors
/// The water cannot be a spline.
pub fn class_counts(scene: &Scene, frame: &Frame, simd: SimdLevel) -> Result<[f64; 5], LowerError> {
    let origin = scene_origin(&frame.columns);
    let lattice = control::water(&frame.columns, &scene.surface, origin.to_array())?;
    let water = lattice.map(|lattice| SplineSurface::new(lattice, scene.surface.solver, simd));
    let spray = Spray::build_at(frame.time, &frame.particles, &scene.particles, origin);
    let mut counts = [0.0; 5];
    for shares in judged(scene, &spray, water.as_ref()) {
        for (count, share) in counts.iter_mut().zip(shares) {
            *count += f64::from(share);
        }
    }
    Ok(counts)
}

/// How many particles are drawn for how many, where those under a pixel's part or a budget of memory are thinned.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Thinning {
    /// Drops, streaks and bubbles there are; what is of two classes counts twice.
    pub found: u64,
    /// Those that are drawn; each stands for the others as well.
    pub drawn: u64,
    /// Radius (pixels) under which they were thinned.
    pub least_pixels: f64,
    /// Bytes that the budget allows, and that all of them were estimated to take, where that is more than fits.
    pub over_budget: Option<[u64; 2]>,
}

/// What was gathered of a frame's particles: those that are drawn one by one, the others' mist, and how many were thinned.
type Gathered = (Spray, Option<Arc<Mist>>, Thinning);

/// The particles that are drawn, sorted by class where the scene leaves the choice to them, and the mist that the others
/// are; thinned as far as they are small from where they are seen, or as a budget (bytes) asks for, of which
/// meshes' `images` take some.
pub(super) fn gather(
    scene: &Scene,
    frame: &Frame,
    origin: DVec3,
    water: Option<&SplineSurface>,
    sight: Option<Sight>,
    budget: Option<u64>,
    images: u64,
) -> Result<Gathered, LowerError> {
    let settings = &scene.particles;
    let account = Account::new(scene, frame, images);
    let mist_budget = |misty: usize| match budget {
        Some(budget) => Ok(account.left_for_mist(budget, misty)?.min(mist::BUDGET)),
        None => Ok::<u64, LowerError>(mist::BUDGET),
    };
    let mut cloud = MistSettings::from_scene(settings);
    match settings.representation {
        ParticleRepresentation::None => {
            mist_budget(0)?;
            return Ok((Spray::default(), None, Thinning::default()));
        }
        ParticleRepresentation::Mist => {
            let Particles { position, velocity, mass, .. } = &frame.particles;
            let spread = particles::size_spreads(settings)[Class::Mist as usize];
            // The cube of a radius's factor.
            let factor = |index: usize| match spread {
                0.0 => 1.0,
                _ => particles::size_factor(particles::seed(&frame.particles, index, frame.time), spread).powi(3),
            };
            let mass: Vec<f64> =
                mass.iter().enumerate().map(|(index, mass)| mass * settings.mist_share * factor(index)).collect();
            let droplets = Droplets { position, velocity, mass: &mass };
            let mist = Mist::build_within(&droplets, &cloud, origin, mist_budget(mass.len())?)?;
            return Ok((Spray::default(), Some(Arc::new(mist)), Thinning::default()));
        }
        _ => {}
    }
    mist_budget(0)?;
    let mut spray = Spray::build_at(frame.time, &frame.particles, settings, origin);
    if settings.representation == ParticleRepresentation::Surface {
        if let Some(budget) = budget {
            account.most(budget, &Counts { joined: spray.len(), ..Counts::default() })?;
        }
        return Ok((spray, None, Thinning::default()));
    }
    if settings.representation != ParticleRepresentation::Auto {
        let streaks = settings.representation == ParticleRepresentation::Streamlines;
        let class = if streaks { Class::Streak } else { Class::Drop };
        let spread = particles::size_spreads(settings)[class as usize];
        if spread != settings.size_spread {
            spray.spread(settings.size_spread, |_| spread);
        }
        let counts = Counts { drawn: spray.len(), streaks, ..Counts::default() };
        let (least, over_budget) = least_pixels(&account, &spray, settings, sight, budget, &counts, |_| 1)?;
        if streaks {
            close_up(scene, &mut spray, sight, &[], &[]);
        }
        if let Some(sight) = sight.filter(|_| least > 0.0) {
            spray.thin(particles::covers(&spray, sight, least));
        }
        let thinning =
            Thinning { found: counts.drawn as u64, drawn: spray.len() as u64, least_pixels: least, over_budget };
        return Ok((spray, None, thinning));
    }
    let mut shares = judged(scene, &spray, water);
    spread_by_class(settings, &mut spray, &mut shares);
    let streaks: Vec<f32> = shares.iter().map(|shares| shares[Class::Streak as usize]).collect();
    // A drop of water is another matter than a streak or a bubble: from one to the other it fades.
    let stretch: Vec<f32> = match settings.matter {
        DropMatter::Diffuse => shares.iter_mut().map(particles::drawn_once).collect(),
        DropMatter::Water => Vec::new(),
    };
    close_up(scene, &mut spray, sight, &streaks, &stretch);
    drop(streaks);
    // What is too small to be told apart stops as much light as its own drops would: water in finer ones counts for more.
    let fine = settings.classes.atomised;
    let (mut position, mut velocity, mut mass) = (Vec::new(), Vec::new(), Vec::new());
    for (index, shares) in shares.iter().enumerate() {
        let (share, radius) = (f64::from(shares[Class::Mist as usize]), f64::from(spray.radius[index]));
        if share > 0.0 {
            position.push((origin + spray.position[index].as_dvec3()).to_array());
            velocity.push(spray.velocity[index].as_dvec3().to_array());
            let own = settings.droplet_radius / radius;
            mass.push(share * particles::mass(radius) * (fine + (1.0 - fine) * own));
        }
    }
    // Radii have the scene's scale already.
    cloud.scale = 1.0;
    let misty = mass.len();
    let droplets = Droplets { position: &position, velocity: &velocity, mass: &mass };
    let mist = match misty {
        0 => None,
        _ => Some(Arc::new(Mist::build_within(&droplets, &cloud, origin, mist_budget(misty)?)?)),
    };
    drop((position, velocity, mass));
    let stands = |index: usize, class: Class| class.holds(shares[index][class as usize]);
    let single = [Class::Drop, Class::Streak, Class::Bubble];
    let times = |index: usize| single.into_iter().filter(|&class| stands(index, class)).count();
    let counts = Counts {
        drawn: (0..spray.len()).map(times).sum(),
        streaks: (0..spray.len()).any(|index| stands(index, Class::Streak)),
        joined: (0..spray.len()).filter(|&index| stands(index, Class::Sheet)).count(),
        misty,
        mist: mist.as_ref().map_or(0, |mist| mist.bytes()),
    };
    let (least, over_budget) = least_pixels(&account, &spray, settings, sight, budget, &counts, times)?;
    let covers = match sight {
        Some(sight) if least > 0.0 => particles::covers(&spray, sight, least),
        _ => Vec::new(),
    };
    let sorted = spray.sorted_and_thinned(&shares, &covers, &stretch);
    let found = counts.drawn as u64;
    let thinning = Thinning { found, drawn: found - sorted.thinned, least_pixels: least, over_budget };
    Ok((sorted, mist, thinning))
}

/// Radius (pixels) under which particles are thinned, of which particle k is drawn `times(k)` times: the scene's, or a
/// greater one by which they fit in the budget; and then the budget, and what all would take (bytes).
fn least_pixels(
    account: &Account,
    spray: &Spray,
    settings: &crate::scene::Particles,
    sight: Option<Sight>,
    budget: Option<u64>,
    counts: &Counts,
    times: impl Fn(usize) -> usize,
) -> Result<(f64, Option<[u64; 2]>), LowerError> {
    let least = settings.least_pixels;
    // Questions have no eye: nothing is small to them.
    let (Some(sight), Some(budget)) = (sight, budget) else { return Ok((least, None)) };
    let most = account.most(budget, counts)?;
    let asked = particles::least_for(spray, sight, times, most);
    if asked <= least {
        return Ok((least, None));
    }
    Ok((asked, Some([budget, account.spray(counts)])))
}

/// Time (s) of flight that a streak shows in the whole picture, and at one moment of it.
///
/// Motion blur looks at moments of the exposure, each for its own samples: each shows its own part, and together they
/// show the way of the whole exposure once. Without, 1/50 s: what a camera at 25 frames a second with a half-open shutter
/// takes. A time that the scene gives is every moment's.
fn streak_seconds(scene: &Scene) -> [f64; 2] {
    let camera = &scene.camera;
    let open = camera.shutter / scene.frames.fps;
    match scene.particles.streak {
        Some(seconds) => [seconds; 2],
        None if camera.motion_steps > 1 && open > 0.0 => [open, open / f64::from(camera.motion_steps)],
        None => [1.0 / 50.0; 2],
    }
}

/// Spreads the radii as the particles' classes ask for. Who is of several has as much of each one's spread as of the class: with
/// its number, which it keeps, its size goes evenly from one to the other.
///
/// What a particle is was judged before, by `particles.size_spread` alone.
fn spread_by_class(settings: &crate::scene::Particles, spray: &mut Spray, shares: &mut Vec<Shares>) {
    let spreads = particles::size_spreads(settings);
    if spreads.iter().all(|&spread| spread == settings.size_spread) {
        return;
    }
    let spread =
        |index: usize| spreads.iter().zip(shares[index]).map(|(spread, share)| spread * f64::from(share)).sum();
    if let Some(stays) = spray.spread(settings.size_spread, spread) {
        let mut stays = stays.into_iter();
        shares.retain(|_| stays.next() == Some(true));
    }
}

/// Notes how wide streaks have to be to close up with neighbours that move alike. `share` is how much of each particle is a streak,
/// `stretch` the part of its flight that it shows; none of either for all of it.
///
/// By all particles, also those that others will stand for: how dense they are does not hang on which are drawn.
fn close_up(scene: &Scene, spray: &mut Spray, sight: Option<Sight>, share: &[f32], stretch: &[f32]) {
    let merging = scene.particles.merging as f32;
    // Questions have no eye: no streak is wider for them than it is.
    if sight.is_none() || !(merging > 0.0) {
        return;
    }
    let [whole, _] = streak_seconds(scene);
    let length =
        |index: usize| spray.velocity[index].length() * whole as f32 * stretch.get(index).copied().unwrap_or(1.0);
    let veils = particles::veils(spray, share, merging, length);
    spray.set_veils(veils);
}

/// The parts of a spray, each by its class's name. It is seen from an eye (local frame, m) with pixels of so many radians;
/// what is drawn wider than it is becomes as much less opaque.
pub(super) fn parts(
    scene: &Scene,
    spray: &mut Spray,
    eye: Option<(DVec3, f64)>,
    water: Option<&SplineSurface>,
    add: &mut impl FnMut(&str, Material, Shape),
) -> Result<(), LowerError> {
    let settings = &scene.particles;
    let drawn_as = |class: Class| match (settings.representation, class) {
        (ParticleRepresentation::Auto, Class::Streak) => ParticleRepresentation::Streamlines,
        (ParticleRepresentation::Auto, _) => ParticleRepresentation::Spheres,
        (one, _) => one,
    };
    let mut class_part = |class: Class, spray: &mut Spray| {
        let range = spray.of(class);
        if range.is_empty() {
            return;
        }
        if drawn_as(class) == ParticleRepresentation::Streamlines {
            let [_, seconds] = streak_seconds(scene);
            let streaks = particles::streaks(&spray.part(range.clone()), settings, seconds, eye);
            spray.set_shares(range.start, &streaks.share);
            spray.out_of_range += streaks.out_of_range;
            let curves = Curves { ends: streaks.ends, radius: streaks.radius };
            let material = Material::Spray { first: range.start as u32 };
            return add(Class::Streak.name(), material, Shape::Curves(Arc::new(curves)));
        }
        // Air in water stays bright: a bubble is no drop.
        let water = settings.matter == DropMatter::Water && class != Class::Bubble;
        let spray_material = Material::Spray { first: range.start as u32 };
        let (center, radius) = (spray.position[range.clone()].to_vec(), spray.drawn_radius(range.clone()));
        let facing = (drawn_as(class) == ParticleRepresentation::Billboards).then_some(settings.billboard.facing);
        let (material, shape) = match (facing, eye) {
            (Some(Facing::Ray), _) => (spray_material, Shape::Discs(Arc::new(Discs { center, radius, normal: None }))),
            (Some(Facing::Eye), Some((eye, _))) => {
                let normal = Some(particles::facing(&spray.part(range), eye.as_vec3()).normal);
                (spray_material, Shape::Discs(Arc::new(Discs { center, radius, normal })))
            }
            _ => {
                let material = if water { Material::Sheet } else { spray_material };
                (material, Shape::Spheres(Arc::new(Spheres { center, radius })))
            }
        };
        add(class.name(), material, shape);
    };
    let all_joined = settings.representation == ParticleRepresentation::Surface;
    let joined = if all_joined { 0..spray.len() } else { spray.of(Class::Sheet) };
    if !all_joined {
        for class in [Class::Drop, Class::Streak, Class::Bubble] {
            class_part(class, spray);
        }
    }
    // What is under water is water already.
    let drops: Vec<usize> = joined.filter(|&index| depth(water, spray.position[index]) <= 0.0).collect();
    if !drops.is_empty() {
        let position: Vec<Vec3> = drops.iter().map(|&index| spray.position[index]).collect();
        let radius: Vec<f32> = drops.iter().map(|&index| spray.radius[index]).collect();
        let first = spray.of(Class::Sheet).start;
        let share: Vec<f32> = match spray.sheet_shares() {
            [] => Vec::new(),
            shares => drops.iter().map(|&index| shares[index - first]).collect(),
        };
        let radius = particles::mean_radius(&radius);
        let sheet = particles::sheet(&position, &share, radius, &scene.particles.sheet)?;
        let particles::Sheet { position, normal, index } = sheet;
        let triangles = Triangles { position, normal, index };
        add(Class::Sheet.name(), Material::Sheet, Shape::Triangles(Arc::new(triangles)));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lower::{Environment, lower};
    use crate::scene;
    use crate::state::{Columns, Particles};

    /// Level water a metre deep, with one particle of every kind: a drop, a streak, mist, a bubble, and a crowd.
    fn frame() -> Frame {
        let columns = Columns::level([0.0; 2], [0.5; 2], [8, 8], 0.0, 1.0);
        let drop = |radius: f64| 4.0 / 3.0 * std::f64::consts::PI * radius.powi(3) * 1000.0;
        let mut particles = Particles {
            position: vec![[1.0, 3.0, 1.0], [2.0, 3.0, 1.0], [1.0, 3.0, 2.0], [2.0, 0.5, 2.0]],
            velocity: vec![[0.0; 3], [6.0, 0.0, 0.0], [0.0; 3], [0.0; 3]],
            mass: vec![drop(0.01), drop(0.01), drop(0.0002), drop(0.01)],
            age: vec![0.0; 4],
            id: None,
        };
        for k in 0..512 {
            let place = [k % 8, k / 8 % 8, k / 64].map(|step| 2.5 + 0.016 * f64::from(step));
            particles.position.push(place);
            particles.velocity.push([0.0; 3]);
            particles.mass.push(drop(0.01));
            particles.age.push(0.0);
        }
        Frame { columns, particles, ..Frame::default() }
    }

    fn parts_of(representation: ParticleRepresentation, matter: DropMatter) -> Vec<(String, Material, usize)> {
        let mut scene = Scene::default();
        (scene.particles.representation, scene.particles.matter) = (representation, matter);
        let lowered = lower(&scene, &frame(), &Environment::default(), None, SimdLevel::Portable).unwrap();
        let spray = lowered
            .lowered
            .parts
            .into_iter()
            .filter(|part| matches!(part.material, Material::Spray { .. } | Material::Sheet));
        spray
            .map(|part| {
                let count = match &part.shape {
                    Shape::Spheres(spheres) => spheres.center.len(),
                    Shape::Triangles(mesh) => mesh.index.len(),
                    Shape::Curves(curves) => curves.ends.len(),
                    _ => 0,
                };
                (part.name, part.material, count)
            })
            .collect()
    }

    #[test]
    fn every_class_is_a_part_of_its_own_name() {
        let parts = parts_of(ParticleRepresentation::Auto, DropMatter::Diffuse);
        let names: Vec<&str> = parts.iter().map(|(name, ..)| name.as_str()).collect();
        assert_eq!(names, ["spray", "streaks", "bubbles", "sheet"]);
        let mut first = 0;
        for (name, material, count) in &parts[..3] {
            let Material::Spray { first: begins } = *material else { panic!("{name}") };
            assert!(begins >= first && *count > 0, "{name}");
            first = begins + *count as u32;
        }
        // The crowd's edge is on its way between drops and sheet, its middle is all sheet.
        assert!(parts[0].2 < 500 && parts[3].2 > 100, "{parts:?}");
    }

    #[test]
    fn a_drop_on_its_way_to_a_streak_is_drawn_once() {
        let mut frame = frame();
        // Of 1/50 s it flies one and a half diameters.
        frame.particles.velocity[1] = [1.5, 0.0, 0.0];
        let names = |scene: &Scene| -> Vec<(String, usize)> {
            let lowered = lower(scene, &frame, &Environment::default(), None, SimdLevel::Portable).unwrap();
            let spray = &lowered.spray;
            let count = |class: Class| (class.name().to_owned(), spray.of(class).len());
            vec![count(Class::Streak), count(Class::Drop)]
        };
        let mut scene = Scene::default();
        let diffuse = names(&scene);
        scene.particles.matter = DropMatter::Water;
        let water = names(&scene);
        assert_eq!((diffuse[0].1, water[0].1), (1, 1), "{diffuse:?} {water:?}");
        assert_eq!(diffuse[1].1 + 1, water[1].1, "{diffuse:?} {water:?}");
    }

    /// Drops that fly apart at a speed (m/s), each a kilometre from the next, as they are drawn: radii by what the mass says.
    fn sizes(spreads: scene::SizeSpreads, speed: f64, matter: DropMatter) -> Vec<f64> {
        let count = 4000_u32;
        let ball = 4.0 / 3.0 * std::f64::consts::PI * 0.01_f64.powi(3) * 1000.0;
        let particles = Particles {
            position: (0..count).map(|k| [1e3 * f64::from(k), 3.0, 1.0]).collect(),
            velocity: vec![[0.0, 0.0, speed]; count as usize],
            mass: vec![ball; count as usize],
            age: vec![0.0; count as usize],
            id: Some((0..u64::from(count)).collect()),
        };
        let frame = Frame { particles, ..Frame::default() };
        let mut scene = Scene::default();
        (scene.particles.matter, scene.particles.least_pixels) = (matter, 0.0);
        (scene.particles.size_spread, scene.particles.size_spreads) = (0.1, spreads);
        let (spray, ..) = gather(&scene, &frame, DVec3::ZERO, None, None, None, 0).unwrap();
        // By their places, since who is of two classes stands in both.
        let mut sizes = vec![0.0; count as usize];
        for (place, radius) in spray.position.iter().zip(&spray.radius) {
            sizes[(place.x / 1e3).round() as usize] = f64::from(*radius) / 0.01;
        }
        sizes
    }

    #[test]
    fn sizes_differ_by_class_about_the_same_water() {
        let spreads = scene::SizeSpreads { spray: Some(0.3), streaks: Some(0.5), ..Default::default() };
        for (speed, spread) in [(0.0, 0.3), (50.0, 0.5)] {
            let sizes = sizes(spreads.clone(), speed, DropMatter::Diffuse);
            let mean = |of: &dyn Fn(f64) -> f64| sizes.iter().map(|&size| of(size)).sum::<f64>() / sizes.len() as f64;
            let middle = mean(&f64::ln);
            let deviation = mean(&|size| (size.ln() - middle).powi(2)).sqrt();
            assert!((deviation / spread - 1.0).abs() < 0.03, "{speed}: {deviation}");
            // The mean of the cubes has this deviation itself, by the square root of the count.
            let (volume, cubes) = (mean(&|size| size.powi(3)), ((9.0 * spread * spread).exp_m1() / 4000.0).sqrt());
            assert!((volume - 1.0).abs() < 3.0 * cubes, "{speed}: {volume} within {cubes}");
        }
        let plain = sizes(scene::SizeSpreads::default(), 50.0, DropMatter::Diffuse);
        let other = sizes(
            scene::SizeSpreads { bubbles: Some(2.0), mist: Some(1.0), ..Default::default() },
            50.0,
            DropMatter::Diffuse,
        );
        assert_eq!(plain, other, "no bubble is among them, and no mist");
    }

    #[test]
    fn no_size_pops_as_a_drop_becomes_a_streak() {
        for matter in [DropMatter::Diffuse, DropMatter::Water] {
            let at = |speed: f64| {
                let spreads = scene::SizeSpreads { streaks: Some(0.6), ..Default::default() };
                sizes(spreads, speed, matter)
            };
            let (slow, steps) = (at(0.9), 60);
            let mut last = slow.clone();
            let mut largest = 0.0_f64;
            for step in 1..=steps {
                let now = at(0.9 + 1.2 * f64::from(step) / f64::from(steps));
                for (k, (now, last)) in now.iter().zip(&last).enumerate() {
                    // Whoever is large among drops is large among streaks.
                    largest = largest.max((now / last).ln().abs() / (0.5 + (slow[k].ln() / 0.1).abs()));
                }
                last = now;
            }
            // Half of the spread lies between: by a sixtieth of the way at most a twentieth of that.
            assert!(largest < 0.05, "{matter:?}: {largest}");
            assert!(last != slow);
        }
    }

    #[test]
    fn the_count_of_classes_adds_up_to_the_particles() {
        let counts = class_counts(&Scene::default(), &frame(), SimdLevel::Portable).unwrap();
        assert!((counts.iter().sum::<f64>() - 516.0).abs() < 1e-3, "{counts:?}");
        // One of each that stands alone, besides the crowd's own.
        for class in [Class::Streak, Class::Mist, Class::Bubble] {
            assert!((counts[class as usize] - 1.0).abs() < 1e-3, "{counts:?}");
        }
        assert!(counts[Class::Sheet as usize] > 100.0);
    }

    #[test]
    fn drops_may_be_of_water_and_all_may_be_joined() {
        let water = parts_of(ParticleRepresentation::Spheres, DropMatter::Water);
        assert!(matches!(&water[..], [(name, Material::Sheet, 516)] if name == "spray"), "{water:?}");
        let joined = parts_of(ParticleRepresentation::Surface, DropMatter::Diffuse);
        assert!(matches!(&joined[..], [(name, Material::Sheet, 1000..)] if name == "sheet"), "{joined:?}");
    }
}
