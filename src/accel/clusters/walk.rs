//! A packet's way through the tree, together or ray by ray, nearest boxes first.
//!
//! Either way a ray takes the nearest (of equals, the highest numbered) of the hits that its own tests find in those
//! clusters whose boxes its own slab test passes, no hit counting before the ray's entry into the box. Slab tests are
//! monotone in the box, in floating point too, so a ray that passes a cluster's box passes those of all nodes above it; and
//! the beam's test is the ray's with each number replaced by an interval that holds it. So which clusters are *visited*
//! depends on how the ray travels, but the answer does not. Only a beam's skipping of single particles within a cluster
//! rests on bounds of rounding instead (see `PAD` and `ROUNDINGS`).

use super::build::{MOST_DEPTH, PAD};
use super::cluster::{Cluster, Rays, loaded, splat};
use super::ray::{Beam, Packet};
use super::{CLUSTER, Cloud, Node, WIDTH};
use crate::simd::{Kernel, Simd};
use crate::surface::{LANES, LaneRays};

/// Children that wait, at most: all but one of each node on the way, and all of the last.
const WAITING: usize = MOST_DEPTH as usize * (WIDTH - 1) + WIDTH + 1;

/// Nearest hits, or some hits.
pub(super) struct Found {
    pub(super) t: [f32; LANES],
    /// Cluster times sixteen, plus the particle's place in it.
    pub(super) at: [u32; LANES],
    pub(super) hit: u16,
}

impl Found {
    pub(super) const NONE: Self = Self { t: [f32::INFINITY; LANES], at: [0; LANES], hit: 0 };
}

/// A packet and where its answers go.
pub(super) struct Walk<'a, C, const ANY: bool> {
    pub(super) cloud: &'a Cloud<C>,
    pub(super) rays: &'a LaneRays,
    pub(super) found: &'a mut Found,
}

/// Children to come back to, the nearest on top of those of its node.
struct Stack {
    entries: [(f32, u32); WAITING],
    count: usize,
}

impl Stack {
    /// Adds a node's children, of which `near` tells the entries, so that the nearest is on top.
    #[inline(always)]
    fn push(&mut self, mut children: u32, near: &[f32; WIDTH], names: &[u32; WIDTH]) {
        let base = self.count;
        while children != 0 {
            let slot = children.trailing_zeros() as usize;
            children &= children - 1;
            let mut at = self.count;
            while at > base && self.entries[at - 1].0 < near[slot] {
                self.entries[at] = self.entries[at - 1];
                at -= 1;
            }
            self.entries[at] = (near[slot], names[slot]);
            self.count += 1;
        }
    }

    #[inline(always)]
    fn pop(&mut self) -> Option<(f32, u32)> {
        self.count = self.count.checked_sub(1)?;
        Some(self.entries[self.count])
    }
}

/// A ray's nearest hit so far.
struct Best {
    t: f32,
    at: u32,
    /// The particle's number plus one; 0 for none.
    above: u32,
}

impl Best {
    /// Takes a hit that is nearer, or as near and of a higher number (a hit at the ray's very end counts).
    #[inline(always)]
    fn offer(&mut self, t: f32, at: u32, number: u32) {
        let above = number + 1;
        if t < self.t || (t == self.t && above > self.above) {
            *self = Self { t, at, above };
        }
    }
}

impl<C: Cluster, const ANY: bool> Kernel for Walk<'_, C, ANY> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(mut self, s: S) {
        let packet = Packet::new(s, self.rays);
        let mut stack = Stack { entries: [(0.0, 0); WAITING], count: 0 };
        let bounds = &self.cloud.bounds;
        let size = (bounds.high - bounds.low).max_element();
        if let Some(beam) = Beam::new(&packet, self.rays.active, size) {
            self.together(s, &packet, &beam, &mut stack);
            return;
        }
        let mut lanes = self.rays.active;
        while lanes != 0 {
            let lane = lanes.trailing_zeros() as usize;
            lanes &= lanes - 1;
            self.alone(s, &packet, lane, &mut stack);
        }
    }
}

impl<C: Cluster, const ANY: bool> Walk<'_, C, ANY> {
    /// One ray: boxes, then particles, in the lanes.
    #[inline(always)]
    fn alone<S: Simd>(&mut self, s: S, packet: &Packet, lane: usize, stack: &mut Stack) {
        let tnear = s.splat(packet.tnear[lane]);
        let ray = Rays::<S> {
            origin: splat(s, &packet.origin, lane),
            direction: splat(s, &packet.direction, lane),
            inverse_squared: s.splat(packet.inverse_squared[lane]),
            tnear,
        };
        let mut inverse = [[tnear; 2]; 3];
        let mut sign = [0; 3];
        for axis in 0..3 {
            inverse[axis] = [s.splat(packet.inverse[axis][0][lane]), s.splat(packet.inverse[axis][1][lane])];
            sign[axis] = usize::from(packet.direction[axis][lane].is_sign_negative());
        }
        let mut best = Best { t: packet.tfar[lane], at: 0, above: 0 };
        let mut near = [0.0; WIDTH];
        let mut node = &self.cloud.nodes[0];
        stack.count = 0;
        loop {
            let mut children = 0;
            for from in (0..WIDTH).step_by(S::LANES) {
                let (mut enter, mut leave) = (tnear, s.splat(best.t));
                for axis in 0..3 {
                    let planes = &node.planes[axis];
                    let to = s.load(&planes[sign[axis]][from..]) - ray.origin[axis];
                    let out = s.load(&planes[sign[axis] ^ 1][from..]) - ray.origin[axis];
                    // NaN changes nothing.
                    enter = s.max(to * inverse[axis][0], enter);
                    leave = s.min(out * inverse[axis][1], leave);
                }
                children |= s.bits(s.le(enter, leave)) << from;
                s.store(enter, &mut near[from..]);
            }
            let mut clusters = children;
            while clusters != 0 {
                let child = node.child[clusters.trailing_zeros() as usize];
                clusters &= clusters - 1;
                // By the time that it is visited, it is here.
                if child & CLUSTER != 0 {
                    s.prefetch(&self.cloud.clusters[(child & !CLUSTER) as usize]);
                } else {
                    s.prefetch(&self.cloud.nodes[child as usize]);
                }
            }
            stack.push(children, &near, &node.child);
            let next = loop {
                let Some((enter, child)) = stack.pop() else { return self.record(packet, lane, &best) };
                if enter > best.t {
                    continue;
                }
                if child & CLUSTER == 0 {
                    break child;
                }
                self.visit(s, child & !CLUSTER, enter, &ray, &mut best);
                if ANY && best.above != 0 {
                    return self.record(packet, lane, &best);
                }
            };
            node = &self.cloud.nodes[next as usize];
        }
    }

    /// One ray against a cluster that it enters at `enter`.
    #[inline(always)]
    fn visit<S: Simd>(&self, s: S, index: u32, enter: f32, ray: &Rays<S>, best: &mut Best) {
        let cluster = &self.cloud.clusters[index as usize];
        for from in (0..WIDTH).step_by(S::LANES) {
            let (hit, t) = cluster.hits(s, from, ray);
            let mut hits = s.bits(hit & s.le(s.splat(enter), t) & s.le(t, s.splat(best.t)));
            if hits == 0 {
                continue;
            }
            let mut places = [0.0; WIDTH];
            s.store(t, &mut places);
            while hits != 0 {
                let slot = hits.trailing_zeros() as usize;
                hits &= hits - 1;
                best.offer(places[slot], index * WIDTH as u32 + (from + slot) as u32, cluster.number(from + slot));
            }
        }
    }

    #[inline(always)]
    fn record(&mut self, packet: &Packet, lane: usize, best: &Best) {
        if best.above != 0 {
            self.found.hit |= 1 << lane;
            self.found.t[lane] = best.t / packet.scale[lane];
            self.found.at[lane] = best.at;
        }
    }

    /// All rays at once: boxes against the beam in the lanes, then rays in the lanes.
    #[inline(always)]
    fn together<S: Simd>(&mut self, s: S, packet: &Packet, beam: &Beam, stack: &mut Stack) {
        let active = self.rays.active;
        let mut best = packet.tfar;
        let (mut at, mut above) = ([0_u32; LANES], [0_u32; LANES]);
        // Lanes that still look for something.
        let mut open = active;
        let mut last = farthest(&best, open);
        let mut near = [0.0; WIDTH];
        let mut index = 0_u32;
        stack.count = 0;
        'nodes: loop {
            let node = &self.cloud.nodes[index as usize];
            let mut children = 0;
            for from in (0..WIDTH).step_by(S::LANES) {
                let mut planes = [[s.splat(0.0); 2]; 3];
                for axis in 0..3 {
                    planes[axis] = [s.load(&node.planes[axis][0][from..]), s.load(&node.planes[axis][1][from..])];
                }
                let (enter, leave) = beam_through(s, beam, last, &planes);
                children |= s.bits(s.le(enter, leave)) << from;
                s.store(enter, &mut near[from..]);
            }
            let mut names = [0; WIDTH];
            for (slot, name) in names.iter_mut().enumerate() {
                *name = index * WIDTH as u32 + slot as u32;
            }
            stack.push(children, &near, &names);
            loop {
                let Some((enter, slot)) = stack.pop() else { break 'nodes };
                if enter > last {
                    continue;
                }
                let (node, slot) = (&self.cloud.nodes[slot as usize / WIDTH], slot as usize % WIDTH);
                let child = node.child[slot];
                if child & CLUSTER == 0 {
                    index = child;
                    break;
                }
                let hits =
                    self.visit_together(s, packet, beam, (node, slot), open, last, (&mut best, &mut at, &mut above));
                if hits != 0 {
                    if ANY {
                        open &= !hits;
                        if open == 0 {
                            break 'nodes;
                        }
                    }
                    last = farthest(&best, open);
                }
            }
        }
        for lane in (0..LANES).filter(|lane| active >> lane & 1 == 1) {
            self.record(packet, lane, &Best { t: best[lane], at: at[lane], above: above[lane] });
        }
    }

    /// All rays against the cluster that is a node's child; the lanes that found something.
    #[inline(always)]
    fn visit_together<S: Simd>(
        &self,
        s: S,
        packet: &Packet,
        beam: &Beam,
        (node, slot): (&Node, usize),
        open: u16,
        last: f32,
        (best, at, above): (&mut [f32; LANES], &mut [u32; LANES], &mut [u32; LANES]),
    ) -> u16 {
        // Each ray's own test of the cluster's box.
        let mut enters = [0.0; LANES];
        let mut inside = 0;
        for from in (0..LANES).step_by(S::LANES) {
            let (mut enter, mut leave) = (s.load(&packet.tnear[from..]), s.load(&best[from..]));
            for axis in 0..3 {
                let origin = s.load(&packet.origin[axis][from..]);
                let planes = &node.planes[axis];
                let to = s.splat(planes[beam.sign[axis]][slot]) - origin;
                let out = s.splat(planes[beam.sign[axis] ^ 1][slot]) - origin;
                enter = s.max(to * s.load(&packet.inverse[axis][0][from..]), enter);
                leave = s.min(out * s.load(&packet.inverse[axis][1][from..]), leave);
            }
            inside |= s.bits(s.le(enter, leave)) << from;
            s.store(enter, &mut enters[from..]);
        }
        let inside = inside & u32::from(open);
        if inside == 0 {
            return 0;
        }
        let index = node.child[slot] & !CLUSTER;
        let cluster = &self.cloud.clusters[index as usize];
        // The particles that the beam meets.
        let mut met = 0;
        for from in (0..WIDTH).step_by(S::LANES) {
            let radius = s.load(&cluster.radius()[from..]);
            let mut planes = [[radius; 2]; 3];
            for axis in 0..3 {
                let center = s.load(&cluster.center()[axis][from..]);
                let reach = s.fma(radius + s.abs(center), s.splat(PAD), radius);
                planes[axis] = [center - reach, center + reach];
            }
            let (enter, leave) = beam_through(s, beam, last, &planes);
            // A radius that is not a number marks a place that is not taken.
            met |= s.bits(s.le(enter, leave) & s.le(radius, radius)) << from;
        }
        let mut found = 0;
        while met != 0 {
            let slot = met.trailing_zeros() as usize;
            met &= met - 1;
            for from in (0..LANES).step_by(S::LANES) {
                let rays = Rays::<S> {
                    origin: loaded(s, &packet.origin, from),
                    direction: loaded(s, &packet.direction, from),
                    inverse_squared: s.load(&packet.inverse_squared[from..]),
                    tnear: s.load(&packet.tnear[from..]),
                };
                let (hit, t) = cluster.hits_on(s, slot, &rays);
                let within = hit & s.le(s.load(&enters[from..]), t) & s.le(t, s.load(&best[from..]));
                let mut hits = s.bits(within) & inside >> from;
                if hits == 0 {
                    continue;
                }
                let mut places = [0.0; LANES];
                s.store(t, &mut places);
                found |= hits << from;
                while hits != 0 {
                    let part = hits.trailing_zeros() as usize;
                    hits &= hits - 1;
                    let lane = from + part;
                    let mut of = Best { t: best[lane], at: at[lane], above: above[lane] };
                    of.offer(places[part], index * WIDTH as u32 + slot as u32, cluster.number(slot));
                    (best[lane], at[lane], above[lane]) = (of.t, of.at, of.above);
                }
            }
        }
        found as u16
    }
}

/// The greatest t of some lanes.
#[inline(always)]
fn farthest(t: &[f32; LANES], lanes: u16) -> f32 {
    let mut last = 0.0;
    for lane in 0..LANES {
        if lanes >> lane & 1 == 1 && t[lane] > last {
            last = t[lane];
        }
    }
    last
}

/// Bounds of where any of the beam's rays enters and leaves boxes, one per lane: intervals in place of each number of
/// `alone`'s test.
#[inline(always)]
fn beam_through<S: Simd>(s: S, beam: &Beam, last: f32, planes: &[[S::F; 2]; 3]) -> (S::F, S::F) {
    let (mut enter, mut leave) = (s.splat(beam.tnear), s.splat(last));
    for axis in 0..3 {
        let sign = beam.sign[axis];
        // The origin that is nearest to the plane ahead, and the one farthest from the plane behind.
        let to = planes[axis][sign] - s.splat(beam.origin[axis][sign ^ 1]);
        let out = planes[axis][sign ^ 1] - s.splat(beam.origin[axis][sign]);
        let [low, high] = beam.inverse[axis];
        enter = s.max(s.min(to * s.splat(low[0]), to * s.splat(low[1])), enter);
        leave = s.min(s.max(out * s.splat(high[0]), out * s.splat(high[1])), leave);
    }
    (enter, leave)
}
