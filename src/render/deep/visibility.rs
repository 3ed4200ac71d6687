//! What several camera samples see along their rays, as one pixel's deep samples.
//!
//! Each sample leaves a share T(z) of what lies behind depth z to be seen: steps at surfaces, exponential falls in balls and
//! mist. A pixel's T is their mean, and its deep samples are chosen so that they have this T, steps within a relative depth
//! taken together and falls within a share of it: so flattening them, and holding them out at any depth, is right within both
//! (OpenEXR, Interpreting OpenEXR Deep Pixels, 2013).

use crate::output::DeepSample;

/// Kinds of things whose colours are told apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// Drops, streaks, billboards, bubbles.
    Spray,
    /// Droplets in the air.
    Mist,
    /// Everything else, the sky as well.
    Solid,
}

/// Count of kinds.
pub(super) const KINDS: usize = 3;

/// What one camera sample meets: from `front` to `back` (planar depths, m) a share `alpha` is stopped.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Event {
    /// Number of the camera's sample among the pixel's.
    pub(super) sample: u32,
    pub(super) kind: Kind,
    pub(super) front: f32,
    pub(super) back: f32,
    pub(super) alpha: f32,
}

/// How far deep samples may be from what was seen.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tolerance {
    /// Share of what lies behind, 0..1.
    pub(super) alpha: f32,
    /// Of depth, relative.
    pub(super) depth: f32,
}

/// A part of the pixel's way along which something is stopped: a step where `front` is `back`.
#[derive(Clone, Copy, Debug)]
struct Segment {
    front: f32,
    back: f32,
    /// What is left to be seen before and behind it.
    before: f64,
    behind: f64,
    /// What of that each kind has stopped.
    stopped: [f64; KINDS],
}

/// A pixel's deep samples, from what `count` camera samples have met, in any order. `light` is the pixel's flat light by
/// kind (premultiplied), given out along each kind's own samples by what they stop.
pub(super) fn deep_samples(
    events: &mut [Event],
    count: u32,
    tolerance: Tolerance,
    light: Option<[[f32; 3]; KINDS]>,
) -> Vec<DeepSample> {
    // Half of what may be off goes to falls that are no exponentials, half to joining.
    let tolerance = Tolerance { alpha: 0.5 * tolerance.alpha, ..tolerance };
    let segments = joined(segments(events, count, tolerance.alpha), tolerance);
    let mut whole = [0.0; KINDS];
    for segment in &segments {
        for (sum, part) in whole.iter_mut().zip(segment.stopped) {
            *sum += part;
        }
    }
    let mut left = light;
    let mut samples: Vec<DeepSample> = Vec::with_capacity(segments.len());
    for segment in &segments {
        let alpha = (1.0 - segment.behind / segment.before).clamp(0.0, 1.0) as f32;
        // An alpha of 1 is a wall at the front: a fall that rounds to it would stop everything where it begins.
        let alpha = if segment.back > segment.front { alpha.min(1.0f32.next_down()) } else { alpha };
        let color = light.map(|light| {
            let mut color = [0.0f32; 3];
            for kind in 0..KINDS {
                let share = if whole[kind] > 0.0 { segment.stopped[kind] / whole[kind] } else { 0.0 };
                for (sum, light) in color.iter_mut().zip(light[kind]) {
                    // In isolation: as if nothing stood before it.
                    *sum += (f64::from(light) * share / segment.before) as f32;
                }
                if let Some(left) = &mut left
                    && share > 0.0
                {
                    left[kind] = [0.0; 3];
                }
            }
            color
        });
        samples.push(DeepSample { front: segment.front, back: segment.back, alpha, color });
    }
    // Light of a kind that no sample stopped (a foam of one sample in many, say) stays in the picture with the last one.
    if let (Some(left), Some(sample), Some(segment)) = (left, samples.last_mut(), segments.last())
        && let Some(color) = &mut sample.color
    {
        for kind in left {
            for (sum, light) in color.iter_mut().zip(kind) {
                *sum += (f64::from(light) / segment.before) as f32;
            }
        }
    }
    samples
}

/// The pixel's mean as steps and falls between all depths at which anything begins or ends.
fn segments(events: &mut [Event], count: u32, tolerance: f32) -> Vec<Segment> {
    events.sort_unstable_by(|a, b| {
        (a.front.total_cmp(&b.front)).then(a.back.total_cmp(&b.back)).then(a.sample.cmp(&b.sample))
    });
    let mut depths: Vec<f32> = events.iter().flat_map(|event| [event.front, event.back]).collect();
    depths.sort_unstable_by(f32::total_cmp);
    depths.dedup();
    let mut way = Way {
        seen: vec![1.0 / f64::from(count.max(1)); count as usize],
        total: 1.0,
        tolerance: f64::from(tolerance),
        found: Vec::new(),
    };
    let mut open: Vec<Event> = Vec::new();
    let mut next = events.iter().peekable();
    for (index, &depth) in depths.iter().enumerate() {
        open.retain(|event| event.back > depth);
        let mut stopped = [0.0; KINDS];
        while let Some(event) = next.next_if(|event| event.front == depth) {
            // What lets nothing through is a step, however thick.
            if event.back > depth && event.alpha < 1.0 {
                open.push(*event);
            } else {
                way.stop(event, f64::from(event.alpha), &mut stopped);
            }
        }
        way.push(depth, depth, stopped);
        let Some(&end) = depths.get(index + 1) else { break };
        if !open.is_empty() {
            way.fall(&open, depth, end, HALVINGS);
        }
    }
    way.found
}

/// Times that a fall may be halved: 64 parts of what is between two depths of a pixel's samples.
const HALVINGS: u32 = 6;

/// A pixel's way from the eye.
struct Way {
    /// What each sample leaves to be seen, its share of the pixel included.
    seen: Vec<f64>,
    /// Their sum.
    total: f64,
    /// How far a fall may be off half-way.
    tolerance: f64,
    found: Vec<Segment>,
}

impl Way {
    fn stop(&mut self, event: &Event, share: f64, stopped: &mut [f64; KINDS]) {
        let seen = &mut self.seen[event.sample as usize];
        let gone = *seen * share;
        *seen -= gone;
        stopped[event.kind as usize] += gone;
    }

    /// All that is open falls from one depth to another. A mean of exponentials is none: where one exponential would be off, it
    /// is taken by halves.
    fn fall(&mut self, open: &[Event], front: f32, back: f32, halvings: u32) {
        let share = |event: &Event, to: f32| {
            let part = f64::from(to - front) / f64::from(event.back - event.front);
            1.0 - (1.0 - f64::from(event.alpha)).powf(part)
        };
        let middle = 0.5 * (front + back);
        if halvings > 0 && middle > front && middle < back {
            let left = |to: f32| {
                let mut seen = self.seen.clone();
                for event in open {
                    seen[event.sample as usize] *= 1.0 - share(event, to);
                }
                seen.iter().sum::<f64>()
            };
            let (half, whole) = (left(middle), left(back));
            if (half - (self.total * whole).sqrt()).abs() > self.tolerance {
                self.fall(open, front, middle, halvings - 1);
                return self.fall(open, middle, back, halvings - 1);
            }
        }
        let mut stopped = [0.0; KINDS];
        for event in open {
            self.stop(event, share(event, back), &mut stopped);
        }
        self.push(front, back, stopped);
    }

    fn push(&mut self, front: f32, back: f32, stopped: [f64; KINDS]) {
        let gone: f64 = stopped.iter().sum();
        // Nothing in front of what has nothing left, whatever rounding says.
        if gone > 0.0 && self.total > 0.0 {
            let behind = if self.total - gone > 1e-9 { self.total - gone } else { 0.0 };
            self.found.push(Segment { front, back, before: self.total, behind, stopped });
            self.total = behind;
        }
    }
}

/// Takes segments together that are one within the tolerance.
fn joined(segments: Vec<Segment>, tolerance: Tolerance) -> Vec<Segment> {
    let mut done: Vec<Segment> = Vec::with_capacity(segments.len());
    // Those that the last of `done` stands for.
    let mut first = 0;
    for (index, segment) in segments.iter().enumerate() {
        let fits = done.last().is_some_and(|last| {
            let near = segment.back <= last.front + tolerance.depth * last.front.abs();
            let touches = segment.front == last.back && segment.back > segment.front && last.back > last.front;
            near || touches && follows(&segments[first..=index], f64::from(tolerance.alpha))
        });
        match done.last_mut() {
            Some(last) if fits => {
                last.back = if last.front == last.back { last.back } else { segment.back };
                last.behind = segment.behind;
                for (sum, part) in last.stopped.iter_mut().zip(segment.stopped) {
                    *sum += part;
                }
            }
            _ => {
                first = index;
                done.push(*segment);
            }
        }
    }
    done
}

/// Whether one exponential fall over all of the segments, each beginning where the one before ends, is within a share of
/// theirs everywhere.
fn follows(segments: &[Segment], share: f64) -> bool {
    let (Some(first), Some(last)) = (segments.first(), segments.last()) else { return true };
    let length = f64::from(last.back - first.front);
    if !(length > 0.0 && last.behind > 0.0) {
        return false;
    }
    let whole = last.behind / first.before;
    let one = |depth: f32| first.before * whole.powf(f64::from(depth - first.front) / length);
    segments.iter().all(|segment| {
        let own = [segment.before, segment.behind];
        apart(own, [one(segment.front), one(segment.back)]) <= share
    })
}

/// How far two exponential falls, given by their ends, are apart at most.
fn apart([a, a_end]: [f64; 2], [b, b_end]: [f64; 2]) -> f64 {
    let ends = (a - b).abs().max((a_end - b_end).abs());
    let [a_rate, b_rate] = [(a / a_end).ln(), (b / b_end).ln()];
    // Where both fall equally fast, their difference is greatest.
    let part = (a_rate * a / (b_rate * b)).ln() / (a_rate - b_rate);
    if part > 0.0 && part < 1.0 {
        return ends.max((a * (-a_rate * part).exp() - b * (-b_rate * part).exp()).abs());
    }
    ends
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const EXACT: Tolerance = Tolerance { alpha: 0.0, depth: 0.0 };

    fn event(sample: u32, kind: Kind, front: f32, back: f32, alpha: f32) -> Event {
        Event { sample, kind, front, back, alpha }
    }

    /// What is seen behind a depth through deep samples, each split as OpenEXR says.
    fn through(samples: &[DeepSample], depth: f32) -> f64 {
        samples.iter().fold(1.0, |left, sample| left * (1.0 - f64::from(sample.alpha_before(depth))))
    }

    /// The same of the events themselves.
    fn truth(events: &[Event], count: u32, depth: f32) -> f64 {
        let mut left = vec![1.0 / f64::from(count); count as usize];
        for event in events {
            let (front, back) = (f64::from(event.front), f64::from(event.back));
            let part = if back > front && event.alpha < 1.0 {
                ((f64::from(depth) - front) / (back - front)).clamp(0.0, 1.0)
            } else {
                f64::from(u8::from(depth > event.front))
            };
            left[event.sample as usize] *= (1.0 - f64::from(event.alpha)).powf(part);
        }
        left.iter().sum()
    }

    #[test]
    fn a_mist_before_a_wall_is_a_fall_and_a_step() {
        let mut events = [event(0, Kind::Mist, 2.0, 6.0, 0.75), event(0, Kind::Solid, 10.0, 10.0, 1.0)];
        let light = [[0.0; 3], [0.3, 0.2, 0.1], [0.05; 3]];
        let samples = deep_samples(&mut events, 1, EXACT, Some(light));
        assert_eq!(samples.len(), 2);
        assert_eq!((samples[0].front, samples[0].back, samples[0].alpha), (2.0, 6.0, 0.75));
        assert_eq!((samples[1].front, samples[1].back, samples[1].alpha), (10.0, 10.0, 1.0));
        // Half of the fall's length stops half of what it lets through by its end.
        assert!((samples[0].alpha_before(4.0) - 0.5).abs() < 1e-6);
        let [mist, wall] = [samples[0].color.unwrap(), samples[1].color.unwrap()];
        assert!((mist[0] - 0.3).abs() < 1e-6 && (wall[0] - 0.2).abs() < 1e-6, "{mist:?} {wall:?}");
    }

    #[test]
    fn a_thick_mist_begins_softly() {
        // What leaves e^-30 begins no less gently for that: after a tenth of the way e^-3 would be left.
        let mut events = [
            event(0, Kind::Mist, 2.0, 5.0, -(-15.0f32).exp_m1()),
            event(0, Kind::Mist, 2.0, 5.0, -(-15.0f32).exp_m1()),
        ];
        let samples = deep_samples(&mut events, 1, EXACT, None);
        let alpha = samples.iter().map(|sample| sample.alpha).fold(0.0, f32::max);
        assert!(alpha < 1.0, "{samples:?}");
        assert!((through(&samples, 2.3) - (-3.0f64).exp()).abs() < 0.15, "{samples:?}");
        assert!(through(&samples, 5.0) < 1e-6, "{samples:?}");
    }

    #[test]
    fn samples_that_see_different_things_share_a_pixel() {
        // Two of four see a drop of a half, all a wall behind it, one of them nearer.
        let mut events = vec![event(0, Kind::Spray, 3.0, 4.0, 0.5), event(1, Kind::Spray, 3.0, 4.0, 0.5)];
        events.extend((0..4).map(|k| event(k, Kind::Solid, 10.0 + 0.001 * k as f32, 10.0 + 0.001 * k as f32, 1.0)));
        let rough = Tolerance { alpha: 1e-3, depth: 1e-3 };
        let samples = deep_samples(&mut events, 4, rough, None);
        // A quarter is stopped by the drop's end, less than an eighth half-way; the four walls are one.
        assert!((through(&samples, 9.0) - 0.75).abs() < 1e-6, "{samples:?}");
        assert!((through(&samples, 3.5) - (1.0 + 0.5f64.sqrt()) / 2.0).abs() < 1e-3, "{samples:?}");
        let (wall, drop) = samples.split_last().unwrap();
        assert!((wall.front, wall.back, wall.alpha) == (10.0, 10.0, 1.0) && drop.iter().all(|s| s.back <= 4.0));
    }

    #[test]
    fn light_of_what_no_sample_stopped_is_not_lost() {
        let mut events = [event(0, Kind::Solid, 5.0, 5.0, 1.0)];
        let samples = deep_samples(&mut events, 1, EXACT, Some([[0.25; 3], [0.0; 3], [0.5; 3]]));
        assert_eq!(samples[0].color, Some([0.75; 3]));
    }

    fn any_event(count: u32) -> impl Strategy<Value = Event> {
        let kind = prop_oneof![Just(Kind::Spray), Just(Kind::Mist), Just(Kind::Solid)];
        (
            0..count,
            kind,
            0.5f32..50.0,
            prop_oneof![Just(0.0f32), 0.01f32..20.0],
            prop_oneof![Just(1.0f32), 0.001f32..0.999],
        )
            .prop_map(|(sample, kind, front, thick, alpha)| event(sample, kind, front, front + thick, alpha))
    }

    #[test]
    fn falls_are_farthest_apart_between_their_ends() {
        for (a, b) in
            [([0.8, 0.3], [0.78, 0.31]), ([1.0, 1e-6], [1.0, 0.5]), ([0.5, 0.5], [0.6, 0.4]), ([0.7, 0.2], [0.7, 0.2])]
        {
            let at = |[from, to]: [f64; 2], part: f64| from * (to / from).powf(part);
            let found = (0..=10_000).map(|k| f64::from(k) / 1e4).map(|part| (at(a, part) - at(b, part)).abs());
            let most = found.fold(0.0, f64::max);
            assert!((apart(a, b) - most).abs() < 1e-6, "{a:?} {b:?}: {} for {most}", apart(a, b));
        }
    }

    proptest! {
        #[test]
        fn what_is_left_at_every_depth_is_what_was_seen(mut events in prop::collection::vec(any_event(4), 0..20)) {
            let light = [[0.4, 0.3, 0.2], [0.1, 0.1, 0.2], [0.7, 0.5, 0.9]];
            let fine = Tolerance { alpha: 1e-3, depth: 0.0 };
            let samples = deep_samples(&mut events, 4, fine, Some(light));
            for pair in samples.windows(2) {
                prop_assert!(pair[0].front <= pair[0].back && pair[0].back <= pair[1].front, "tidy: {samples:?}");
            }
            for k in 0..200 {
                let depth = 0.4 + 0.37 * k as f32;
                let (ours, theirs) = (through(&samples, depth), truth(&events, 4, depth));
                prop_assert!((ours - theirs).abs() < 0.01, "{depth}: {ours} {theirs}");
            }
            // Flattened, it is the flat picture's.
            prop_assert!((through(&samples, 1e9) - truth(&events, 4, 1e9)).abs() < 1e-6);
            if !samples.is_empty() {
                let flat = DeepSample::flatten(&samples);
                for axis in 0..3 {
                    let light: f32 = light.iter().map(|kind| kind[axis]).sum();
                    prop_assert!((flat.1[axis] - light).abs() < 1e-4 * light.max(1.0), "{:?}", flat);
                }
            }
        }

        #[test]
        fn joined_samples_stay_within_the_tolerance(mut events in prop::collection::vec(any_event(1), 0..12)) {
            // One sample's falls are exact, so that what joining does is seen alone.
            let exact = deep_samples(&mut events, 1, EXACT, None);
            let joined = deep_samples(&mut events, 1, Tolerance { alpha: 0.01, depth: 0.0 }, None);
            prop_assert!(joined.len() <= exact.len());
            for sample in &exact {
                let (ours, theirs) = (through(&joined, sample.back), through(&exact, sample.back));
                prop_assert!((ours - theirs).abs() < 0.0101, "{ours} {theirs}");
            }
        }
    }
}
