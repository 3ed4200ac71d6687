//! How many samples a pixel gets and in which steps: between them pixels are judged, and sums are joined.
//!
//! Steps decide in which order sums are made, so two plans give the same bits as far as their steps are the same.

use std::ops::Range;

use super::RenderError;

/// Samples that are summed up by themselves before they are joined to the rest: as many as fill a chunk of rays in a whole
/// tile. Ranges of samples that are rendered apart begin and end at its multiples.
pub const BLOCK: u32 = 16;

/// When a pixel has had enough.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub(super) struct Plan {
    /// Samples of the first pass over all pixels.
    pub(super) first: u32,
    /// The samples that every pixel gets before it is judged.
    pub(super) least: u32,
    /// The samples that no pixel goes beyond.
    pub(super) most: u32,
    /// Greatest relative error that is good enough; `None`: all pixels get `least`.
    pub(super) noise: Option<f64>,
    /// Length of a pixel's run of random numbers, as a power of two.
    pub(super) run: u32,
    /// First sample, and the one after the last, of what is rendered here.
    pub(super) range: [u32; 2],
}

impl Plan {
    /// Ranges of samples between which pixels are judged: after each block of the first pass, then up to each power of two
    /// and half way between.
    pub(super) fn steps(&self) -> impl Iterator<Item = Range<u32>> + use<> {
        let [start, end] = self.range;
        self.all_steps().filter(move |step| start <= step.start && step.end <= end)
    }

    fn all_steps(&self) -> impl Iterator<Item = Range<u32>> + use<> {
        let (first, most) = (self.first, self.most);
        let mut end = 0;
        std::iter::from_fn(move || {
            let start: u32 = end;
            end = match start {
                _ if start < first => first.min(start + BLOCK),
                _ if start.is_power_of_two() => start + (start / 2).max(1),
                _ => start.next_power_of_two(),
            }
            .min(most);
            (start < end).then_some(start..end)
        })
    }

    /// Sets the range of samples.
    ///
    /// *Errors*: [`RenderError::SampleRange`].
    pub(super) fn within(self, range: [u32; 2]) -> Result<Self, RenderError> {
        let [start, end] = range;
        let refused = |expected| RenderError::SampleRange { start, end, expected };
        if self.first != self.least || self.noise.is_some() {
            return Err(refused("no --noise and no --seconds: they decide by all samples of a pixel".to_owned()));
        }
        if start >= end || end > self.most {
            return Err(refused(format!("a range within 0-{}, which is render.samples", self.most)));
        }
        if !start.is_multiple_of(BLOCK) || !(end.is_multiple_of(BLOCK) || end == self.most) {
            return Err(refused(format!("multiples of {BLOCK}, or the end of all {} samples", self.most)));
        }
        Ok(Self { range, ..self })
    }

    /// Why sums made by `old` are not those that this plan would have made so far; `None` if they are.
    pub(super) fn breaks(&self, old: &Self) -> Option<String> {
        if self == old {
            return None;
        }
        if self.run != old.run {
            let counts = |plan: &Self| format!("{} samples", plan.most);
            return Some(format!(
                "it was made for at most {}, which share out random numbers otherwise than {}; expected more than {} and at \
                 most {}",
                counts(old),
                counts(self),
                (1 << old.run) / 2,
                1 << old.run
            ));
        }
        if self.range[0] != old.range[0] || (old.range != self.range && old.range[1] != old.most) {
            let [[a, b], [c, d]] = [old.range, self.range];
            return Some(format!("it has the samples {a}-{b} of each pixel; expected {c}-{d}"));
        }
        let coarser = match (self.noise, old.noise) {
            (Some(new), Some(old)) => new > old,
            // Under a time limit alone all pixels go on alike; by their noise some would have ended before.
            (Some(_), None) => old.least != old.most,
            (None, Some(_)) => self.least != self.most,
            (None, None) => false,
        };
        if coarser {
            let shown = |noise: Option<f64>| noise.map_or_else(|| "none".to_owned(), |noise| noise.to_string());
            return Some(format!(
                "it was made for a noise of {}; expected that or less, not {}",
                shown(old.noise),
                shown(self.noise)
            ));
        }
        // A pixel that has stopped or was left at a step of the old plan must stand at a step of the new one.
        let ends: Vec<u32> = self.all_steps().map(|step| step.end).collect();
        let fewer = self.most < old.most || self.least < old.least;
        if fewer || self.first != old.first && self.first.min(old.first) == 1 {
            return Some(format!(
                "it was made with {} to {} samples for each pixel; expected at most {} to {}",
                old.least, old.most, self.least, self.most
            ));
        }
        old.all_steps().find(|step| !ends.contains(&step.end)).map(|step| {
            format!(
                "its pixels may stand at {} of {} samples, where a render with {} to {} does not; expected one of {ends:?}",
                step.end, old.most, self.least, self.most
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan(samples: u32, most: u32, noise: Option<f64>) -> Plan {
        let run = most.next_power_of_two().trailing_zeros();
        Plan { first: samples, least: samples, most, noise, run, range: [0, most] }
    }

    fn ends(plan: Plan) -> Vec<u32> {
        plan.steps().map(|step| step.end).collect()
    }

    #[test]
    fn steps_are_blocks_then_powers_of_two_and_half_way_between() {
        assert_eq!(ends(plan(4, 4, None)), [4]);
        assert_eq!(ends(plan(40, 40, None)), [16, 32, 40]);
        assert_eq!(ends(plan(16, 100, Some(0.1))), [16, 24, 32, 48, 64, 96, 100]);
        assert_eq!(ends(Plan { first: 1, ..plan(4, 10, None) }), [1, 2, 3, 4, 6, 8, 10]);
        assert_eq!(ends(plan(64, 64, None).within([16, 48]).unwrap()), [32, 48]);
        let all: Vec<_> = plan(70, 300, None).steps().collect();
        assert!(all.windows(2).all(|pair| pair[0].end == pair[1].start) && all[0].start == 0);
    }

    #[test]
    fn ranges_lie_on_blocks() {
        let fixed = plan(40, 40, None);
        assert_eq!(fixed.within([32, 40]).unwrap().range, [32, 40]);
        for range in [[0, 8], [8, 16], [16, 16], [32, 48], [16, 4]] {
            assert!(fixed.within(range).is_err(), "{range:?}");
        }
        assert!(plan(16, 32, Some(0.1)).within([0, 16]).is_err());
    }

    #[test]
    fn only_plans_that_would_have_made_the_same_sums_go_on() {
        let old = plan(16, 1024, Some(0.1));
        assert_eq!(old.breaks(&old), None);
        assert_eq!(plan(16, 1024, Some(0.05)).breaks(&old), None);
        for (bad, reason) in [
            (plan(16, 1024, Some(0.2)), "noise"),
            (plan(16, 2048, Some(0.1)), "random numbers"),
            (plan(16, 1000, Some(0.1)), "samples"),
            (plan(8, 1024, Some(0.1)), "samples"),
            // A pixel may stand at 24.
            (plan(32, 1024, Some(0.1)), "24"),
        ] {
            let said = bad.breaks(&old).unwrap_or_else(|| panic!("{bad:?}"));
            assert!(said.contains(reason), "{said}");
        }
        // More samples within one power of two, where the old ones ended at a block.
        assert_eq!(plan(64, 64, None).breaks(&plan(48, 48, None)), None);
        assert!(plan(64, 64, None).breaks(&plan(40, 40, None)).is_some_and(|said| said.contains("40")));
        assert!(plan(64, 64, None).breaks(&plan(32, 32, None)).is_some());
        // All got 64 and some may get more by their noise, but not in another sequence.
        assert!(plan(64, 1024, Some(0.1)).breaks(&plan(64, 64, None)).is_some());
        let timed = Plan { first: 1, ..plan(16, 1024, None) };
        assert_eq!(timed.breaks(&timed), None);
        assert!(Plan { noise: Some(0.1), ..timed }.breaks(&timed).is_some());
        assert!(plan(16, 1024, None).breaks(&timed).is_some());
    }
}
