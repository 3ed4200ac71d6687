//! Waves of many kinds against a dense search that knows nothing of bounds, spread against finite differences, and
//! queries that are at the edge of what can be asked.

use glam::{DVec3, Vec3};

use super::{super::*, WATER, connect, surface};
use crate::surface::{Lattice, SplineSurface};

/// Numbers 0..1 that look random.
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 33) as f64 + 0.5) / (1u64 << 31) as f64
    }
}

/// Waves of several lengths over columns of 10 cm, with steepness about `steep`.
fn waves(order: u32, columns: usize, steep: f64, seed: u64) -> SplineSurface {
    let mut noise = Noise(seed);
    let trains: Vec<[f64; 4]> = (0..5)
        .map(|_| {
            let length = 0.4 + 1.2 * noise.next();
            let angle = std::f64::consts::TAU * noise.next();
            let k = std::f64::consts::TAU / length;
            [k * angle.cos(), k * angle.sin(), std::f64::consts::TAU * noise.next(), 0.6 * steep / k]
        })
        .collect();
    surface(order, [columns; 2], [0.1; 2], |x, z| {
        trains.iter().map(|[kx, kz, phase, height]| height * (kx * x + kz * z + phase).sin()).sum()
    })
}

/// A question with all its parts.
#[derive(Clone, Copy, Debug)]
struct Question {
    from: Vec3,
    event: Event,
    target: Target,
    tilt: [f32; 2],
}

fn question(noise: &mut Noise, reach: f64) -> Question {
    let mut within = |low: f64, high: f64| (low + (high - low) * noise.next()) as f32;
    let event = if within(0.0, 1.0) < 0.6 { Event::Refraction } else { Event::Reflection };
    let below = if event == Event::Refraction { -1.0 } else { 1.0 };
    let half = 0.6 * reach;
    let from = Vec3::new(within(-half, half), below * within(0.25, 2.5), within(-half, half));
    let target = if within(0.0, 1.0) < 0.5 {
        Target::Direction(Vec3::new(within(-0.8, 0.8), within(0.3, 1.0), within(-0.8, 0.8)).normalize())
    } else {
        Target::Point(Vec3::new(within(-half, half), within(0.3, 3.0), within(-half, half)))
    };
    let tilt = if within(0.0, 1.0) < 0.3 { [within(-0.1, 0.1), within(-0.1, 0.1)] } else { [0.0; 2] };
    Question { from, event, target, tilt }
}

/// The surface's heights and slopes on a dense grid of every patch.
struct Dense<'a> {
    lattice: &'a Lattice,
    steps: usize,
    nodes: Vec<(f64, [f64; 2])>,
}

impl<'a> Dense<'a> {
    fn new(lattice: &'a Lattice, steps: usize) -> Self {
        let [nx, nz] = lattice.cells;
        let mut nodes = Vec::new();
        for patch in 0..nx * nz {
            for node in 0..(steps + 1) * (steps + 1) {
                let [u, v] = [node % (steps + 1), node / (steps + 1)].map(|k| k as f64 / steps as f64);
                nodes.push(lattice.evaluate(patch % nx, patch / nx, u, v));
            }
        }
        Self { lattice, steps, nodes }
    }

    /// The law's two equations at a place with this height and these slopes, and whether the sides are right.
    fn law(question: &Question, place: DVec3, slope: [f64; 2]) -> ([f64; 2], bool) {
        let d = (question.from.as_dvec3() - place).normalize();
        let w = match question.target {
            Target::Direction(to) => to.as_dvec3().normalize(),
            Target::Point(light) => (light.as_dvec3() - place).normalize(),
        };
        let (n, side) = match question.event {
            Event::Refraction => (f64::from(WATER), -1.0),
            Event::Reflection => (1.0, 1.0),
        };
        let h = n * d + w;
        let tilted = [0, 1].map(|axis| slope[axis] + f64::from(question.tilt[axis]));
        let right = [slope, tilted].iter().all(|slope| {
            let normal = DVec3::new(-slope[0], 1.0, -slope[1]);
            side * normal.dot(d) > 0.0 && normal.dot(w) > 0.0
        });
        ([h.x + tilted[0] * h.y, h.z + tilted[1] * h.y], right)
    }

    fn at(&self, question: &Question, patch: [usize; 2], [u, v]: [f64; 2]) -> ([f64; 2], bool, DVec3) {
        let (height, slope) = self.lattice.evaluate(patch[0], patch[1], u, v);
        let [x, z] = self.lattice.from_cell([patch[0] as f64 + u, patch[1] as f64 + v]);
        let place = DVec3::new(x, height, z);
        let (f, right) = Self::law(question, place, slope);
        (f, right, place)
    }

    /// Every place where a cell's corners differ in the sign of both equations, polished.
    fn solve(&self, question: &Question) -> Vec<DVec3> {
        let (row, [nx, nz]) = (self.steps + 1, self.lattice.cells);
        let mut roots: Vec<DVec3> = Vec::new();
        let mut values = vec![[0.0; 2]; row * row];
        for patch in 0..nx * nz {
            let cell = [patch % nx, patch / nx];
            for (node, value) in values.iter_mut().enumerate() {
                let (height, slope) = self.nodes[patch * row * row + node];
                let at =
                    [0, 1].map(|axis| cell[axis] as f64 + [node % row, node / row][axis] as f64 / self.steps as f64);
                let [x, z] = self.lattice.from_cell(at);
                *value = Self::law(question, DVec3::new(x, height, z), slope).0;
            }
            for b in 0..self.steps {
                for a in 0..self.steps {
                    let corners = [b * row + a, b * row + a + 1, (b + 1) * row + a, (b + 1) * row + a + 1];
                    let crosses = |k: usize| {
                        let positive = corners.iter().filter(|&&corner| values[corner][k] > 0.0).count();
                        (1..4).contains(&positive)
                    };
                    if crosses(0) && crosses(1) {
                        let start = [(a as f64 + 0.5) / self.steps as f64, (b as f64 + 0.5) / self.steps as f64];
                        if let Some(root) = self.polish(question, cell, start)
                            && roots.iter().all(|other| (*other - root).length() > 1e-6)
                        {
                            roots.push(root);
                        }
                    }
                }
            }
        }
        roots
    }

    /// Newton's iteration with differences for derivatives; a root of this patch within the domain with the right sides.
    fn polish(&self, question: &Question, patch: [usize; 2], mut at: [f64; 2]) -> Option<DVec3> {
        for _ in 0..30 {
            let f = self.at(question, patch, at).0;
            let step = 1e-6;
            let gx = self.at(question, patch, [at[0] + step, at[1]]).0;
            let gz = self.at(question, patch, [at[0], at[1] + step]).0;
            let j = [[(gx[0] - f[0]) / step, (gz[0] - f[0]) / step], [(gx[1] - f[1]) / step, (gz[1] - f[1]) / step]];
            let determinant = j[0][0] * j[1][1] - j[0][1] * j[1][0];
            at[0] -= (j[1][1] * f[0] - j[0][1] * f[1]) / determinant;
            at[1] -= (j[0][0] * f[1] - j[1][0] * f[0]) / determinant;
            if !at.iter().all(|t| (-0.5..1.5).contains(t)) {
                return None;
            }
        }
        let (f, right, place) = self.at(question, patch, at);
        let domain = self.lattice.domain;
        let inside = (0..2).all(|axis| {
            let coordinate = patch[axis] as f64 + at[axis];
            (-1e-9..=1.0 + 1e-9).contains(&at[axis]) && (domain[0][axis]..=domain[1][axis]).contains(&coordinate)
        });
        (inside && right && f[0].abs().max(f[1].abs()) < 1e-9).then_some(place)
    }
}

/// Count of dense roots, of those not among ours, and of ours that the dense search lacks.
fn compare(order: u32, steps: usize, surfaces: u64, questions: usize) -> [usize; 3] {
    let mut totals = [0; 3];
    let mut doubts = 0;
    for seed in 0..surfaces {
        let steep = [0.05, 0.15, 0.35, 0.7][seed as usize % 4];
        let surface = waves(order, 7, steep, seed + 17 * u64::from(order));
        let manifold = Manifold::new(&surface);
        let dense = Dense::new(surface.lattice(), steps);
        let mut noise = Noise(seed + 1000);
        for _ in 0..questions {
            let question = question(&mut noise, 0.7);
            let (found, counts) = connect(&manifold, question.from, question.event, question.target, question.tilt);
            doubts += counts.gave_up;
            let truth = dense.solve(&question);
            let near = |a: Vec3, b: DVec3| (a.as_dvec3() - b).length() < 2e-6;
            totals[0] += truth.len();
            let lost: Vec<_> = truth.iter().filter(|&&root| !found.iter().any(|c| near(c.surface, root))).collect();
            if !lost.is_empty() {
                eprintln!("order {order}, waves {seed}, {question:?}: lost {lost:?} of {truth:?}, found {found:?}");
            }
            totals[1] += lost.len();
            totals[2] += found.iter().filter(|c| !truth.iter().any(|&root| near(c.surface, root))).count();
            for (k, c) in found.iter().enumerate() {
                // Whatever is found obeys the law, and is found once.
                let (f, right, _) = {
                    let cell = surface.lattice().to_cell(f64::from(c.surface.x), f64::from(c.surface.z));
                    let patch = [0, 1].map(|axis| (cell[axis] as usize).min(surface.lattice().cells[axis] - 1));
                    dense.at(&question, patch, [0, 1].map(|axis| cell[axis] - patch[axis] as f64))
                };
                // Bilinear patches have another slope beyond their border, where rounding may have put the place.
                assert!(order == 2 || (right && f[0].abs().max(f[1].abs()) < 3e-6), "{question:?}: {c:?} {f:?}");
                assert!(found[..k].iter().all(|other| (other.surface - c.surface).length() > 1e-6));
                assert!(c.spread.is_finite() && c.spread > 0.0);
            }
        }
    }
    assert_eq!(doubts, 0, "order {order}");
    totals
}

#[test]
fn no_solution_that_a_dense_search_finds_is_lost() {
    for order in 2..=4 {
        let [roots, lost, more] = compare(order, 24, 12, 40);
        eprintln!("order {order}: {roots} dense solutions, {lost} lost, {more} more");
        assert!(roots > 150, "order {order}: only {roots} solutions");
        assert_eq!(lost, 0, "order {order}: of {roots}");
        // Pairs in one cell of the dense search, whose corners show no change of sign.
        assert!(more * 50 <= roots, "order {order}: {more} more than {roots}");
    }
}

/// Solid angle at the point per solid angle or area of the light, by moving the light both ways along two axes.
fn differences(manifold: &Manifold, question: &Question, connection: &Connection) -> Option<f64> {
    let w = connection.to_light.as_dvec3();
    let (a, b) = w.any_orthonormal_pair();
    let step = 2e-3;
    let moved = |by: DVec3| {
        let target = match question.target {
            Target::Direction(_) => Target::Direction((w + by).normalize().as_vec3()),
            Target::Point(place) => Target::Point((place.as_dvec3() + by).as_vec3()),
        };
        let (found, _) = connect(manifold, question.from, question.event, target, question.tilt);
        let nearest = found.iter().min_by(|x, y| {
            let far = |c: &Connection| (c.surface - connection.surface).length();
            far(x).total_cmp(&far(y))
        })?;
        Some((nearest.surface.as_dvec3() - question.from.as_dvec3()).normalize())
    };
    let along_a = (moved(step * a)? - moved(-step * a)?) / (2.0 * step);
    let along_b = (moved(step * b)? - moved(-step * b)?) / (2.0 * step);
    Some(along_a.cross(along_b).length())
}

#[test]
fn spread_is_what_moving_the_light_does() {
    for order in [3, 4] {
        let mut checked = [0; 2];
        for seed in 0..8 {
            let manifold = Manifold::new(&waves(order, 12, 0.12, seed + 50));
            let mut noise = Noise(seed);
            for _ in 0..60 {
                let question = question(&mut noise, 0.8);
                let (found, _) = connect(&manifold, question.from, question.event, question.target, question.tilt);
                // Far from folds, whose square root no difference follows, and from the borders of patches of order 3,
                // where curvature jumps.
                for c in found.iter().filter(|c| c.spread * c.distance.min(1.0) < 1.5) {
                    let Some(expected) = differences(&manifold, &question, c) else { continue };
                    let off = (f64::from(c.spread) - expected).abs() / expected;
                    checked[0] += 1;
                    checked[1] += usize::from(off < 0.03);
                }
            }
        }
        assert!(
            checked[0] > 200 && checked[1] * 100 >= checked[0] * if order == 4 { 95 } else { 80 },
            "order {order}: {checked:?}"
        );
    }
}

#[test]
fn a_tilt_is_the_tilt_of_the_whole_water() {
    // Flat water with its facets tilted answers with the law of water that slopes, at the flat water's place.
    let tilt = [0.12f32, -0.07];
    let manifold = Manifold::new(&surface(3, [60; 2], [0.1; 2], |_, _| 0.0));
    let sun = Vec3::new(0.3, 0.8, -0.2).normalize();
    let from = Vec3::new(0.1, -1.4, 0.2);
    let (found, _) = connect(&manifold, from, Event::Refraction, Target::Direction(sun), tilt);
    let facet = Vec3::new(-tilt[0], 1.0, -tilt[1]).normalize();
    let up = -crate::optics::fresnel::refract(-sun, facet, 1.0, WATER).unwrap();
    assert_eq!(found.len(), 1);
    assert!((found[0].direction - up).length() < 1e-6 && (found[0].facet - facet).length() < 1e-6);
    assert_eq!(found[0].normal.y, 1.0);
    // The direction does not depend on the place: solid angles change as through a plane of that slope.
    let expected = sun.dot(facet) / (WATER * WATER * up.dot(facet));
    assert!((found[0].spread / expected - 1.0).abs() < 1e-4, "{} for {expected}", found[0].spread);
}

#[test]
fn the_same_question_has_the_same_answer_to_the_bit() {
    let surface = waves(4, 20, 0.3, 9);
    let (first, second) = (Manifold::new(&surface), Manifold::new(&surface));
    let mut noise = Noise(5);
    let mut solutions = 0;
    for _ in 0..100 {
        let question = question(&mut noise, 1.5);
        let ask = |manifold| connect(manifold, question.from, question.event, question.target, question.tilt);
        let (a, b) = (ask(&first), ask(&second));
        assert_eq!(a, b);
        solutions += a.0.len();
    }
    assert!(solutions > 100);
}

#[test]
fn a_solution_on_a_border_counts_once() {
    // Straight below corners and edges of patches, whose slope is nought there.
    for order in 2..=4 {
        let manifold = Manifold::new(&surface(order, [20; 2], [0.125; 2], |_, _| 0.25));
        for k in 0..64 {
            let from = Vec3::new(0.0625 * (k % 8) as f32 - 0.25, -1.0, 0.0625 * (k / 8) as f32 - 0.25);
            for target in [Target::Direction(Vec3::Y), Target::Point(from + 3.0 * Vec3::Y)] {
                let (found, counts) = connect(&manifold, from, Event::Refraction, target, [0.0; 2]);
                assert_eq!((found.len(), counts.gave_up), (1, 0), "order {order}, {from}");
                assert!((found[0].surface - Vec3::new(from.x, 0.25, from.z)).length() < 1e-6);
            }
        }
    }
}

#[test]
fn water_ends_where_its_patches_do() {
    let heights = [0.0; 400];
    let lattice = Lattice::new(3, [20; 2], [0.05; 2], [0.1; 2], &heights, |k| k % 20 < 10).unwrap();
    let surface =
        SplineSurface::new(lattice, crate::scene::SolverKind::Univariate, crate::surface::SimdLevel::detect());
    let manifold = Manifold::new(&surface);
    // Patches lean on the columns beside them: there are eleven along x.
    for (x, solutions) in [(0.0, 1), (0.5, 1), (1.05, 1), (1.15, 0), (1.9, 0), (-0.1, 0)] {
        let target = Target::Direction(Vec3::Y);
        let (found, counts) = connect(&manifold, Vec3::new(x, -1.0, 1.0), Event::Refraction, target, [0.0; 2]);
        assert_eq!((found.len(), counts.gave_up), (solutions, 0), "x = {x}");
    }
}

#[test]
fn what_cannot_be_asked_or_settled_is_counted_and_ends() {
    let manifold = Manifold::new(&waves(3, 30, 0.2, 3));
    let (sun, below) = (Target::Direction(Vec3::new(0.1, 0.9, 0.2).normalize()), Vec3::new(0.1, -1.0, 0.2));
    let (nan, inf) = (f32::NAN, f32::INFINITY);
    let mut found = Vec::new();
    for (from, target, ior, tilt, tolerance) in [
        (Vec3::new(nan, 0.0, 0.0), sun, WATER, [0.0; 2], 1e-5),
        (Vec3::new(0.0, inf, 0.0), sun, WATER, [0.0; 2], 1e-5),
        (Vec3::splat(1e30), sun, WATER, [0.0; 2], 1e-5),
        (below, Target::Direction(Vec3::ZERO), WATER, [0.0; 2], 1e-5),
        (below, Target::Direction(Vec3::splat(nan)), WATER, [0.0; 2], 1e-5),
        (below, Target::Point(Vec3::splat(inf)), WATER, [0.0; 2], 1e-5),
        (below, sun, nan, [0.0; 2], 1e-5),
        (below, sun, 0.0, [0.0; 2], 1e-5),
        (below, sun, WATER, [nan, 0.0], 1e-5),
        (below, sun, WATER, [0.0; 2], nan),
    ] {
        let mut counts = ManifoldCounts::default();
        manifold.connect(from, Event::Refraction, target, ior, tilt, tolerance, &mut found, &mut counts);
        assert_eq!((counts.gave_up, found.len()), (1, 0), "{from} {target:?} {ior} {tilt:?} {tolerance}");
    }
    // These may or may not be settled: they end, and what they find are numbers.
    let on = manifold.connect_one(below, sun);
    for from in [on, on - 1e-6 * Vec3::Y, on - 1e-3 * Vec3::Y, Vec3::new(0.0, -1e9, 0.0), Vec3::new(1e7, -1.0, 0.0)] {
        for event in [Event::Refraction, Event::Reflection] {
            for target in [sun, Target::Point(on), Target::Point(from), Target::Point(on + 1e-5 * Vec3::Y)] {
                for tolerance in [0.0, 1e-4, 10.0] {
                    let mut counts = ManifoldCounts::default();
                    manifold.connect(from, event, target, WATER, [0.0; 2], tolerance, &mut found, &mut counts);
                    for c in &found {
                        assert!(c.surface.is_finite() && c.normal.is_normalized() && c.direction.is_normalized());
                        assert!(c.to_light.is_normalized() && c.distance >= 0.0 && c.spread >= 0.0);
                    }
                }
            }
        }
    }
}

impl Manifold {
    /// Some place of the surface.
    fn connect_one(&self, from: Vec3, target: Target) -> Vec3 {
        connect(self, from, Event::Refraction, target, [0.0; 2]).0[0].surface
    }
}

#[test]
#[ignore = "minutes: 200 x 200 cells to a patch"]
fn no_solution_that_a_very_dense_search_finds_is_lost() {
    for order in 2..=4 {
        let [roots, lost, more] = compare(order, 200, 12, 40);
        eprintln!("order {order}, 480 questions: {roots} dense solutions, {lost} lost, {more} more");
        assert_eq!(lost, 0, "order {order}: of {roots}");
        assert!(more * 200 <= roots, "order {order}: {more} more than {roots}");
    }
}

#[test]
fn where_waves_focus_most_parts_are_thrown_away_together() {
    // Crests as lenses whose focus is about where the points are: halving alone looks at more than eighty cells for each.
    let pool = surface(3, [96; 2], [0.2; 2], |x, z| {
        0.05 * (4.8 * (0.8 * x + 0.6 * z)).sin() + 0.03 * (7.6 * (0.92 * z - 0.4 * x) + 1.0).sin()
    });
    let manifold = Manifold::new(&pool);
    let sun = Target::Direction(Vec3::new(0.3, 0.85, 0.2).normalize());
    let (mut found, mut counts) = (Vec::new(), ManifoldCounts::default());
    for k in 0..200 {
        let [a, b, ..] = sobol_burley::sample_4d(k, 0, 3);
        let from = Vec3::new(2.0 * a - 1.0, -3.0, 2.0 * b - 1.0);
        manifold.connect(from, Event::Refraction, sun, WATER, [0.0; 2], 5e-4, &mut found, &mut counts);
    }
    assert!(counts.solutions >= 200 && counts.cells < 15 * counts.queries, "{counts:?}");
}
