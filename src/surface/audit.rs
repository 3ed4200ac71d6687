//! Answers of a tracer held against the referee's: lost, false, wrong, and what is only tangent.
//!
//! *Lost*: the referee hits, the tracer does not. *False*: the reverse. *Wrong*: both hit, but |dt| is over 1e-4 of a
//! column over max(|cos|, 0.02), cos between ray and normal at the hit. *Tangent*: one of these, but the surface stays
//! within 1e-4 of a column of the ray between the two answers; counted apart.

use glam::DVec3;

use super::lattice::Lattice;
use super::referee::{self, RefereeHit};

/// Counts over the rays checked.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Audit {
    /// Rays checked.
    pub rays: u64,
    /// Rays that the referee hits.
    pub hits: u64,
    /// Hits not found.
    pub lost: u64,
    /// Hits invented.
    #[serde(rename = "false")]
    pub false_hits: u64,
    /// Hits misplaced.
    pub wrong: u64,
    /// Any of these, at tangency.
    pub tangent: u64,
}

impl std::ops::AddAssign for Audit {
    fn add_assign(&mut self, other: Self) {
        self.rays += other.rays;
        self.hits += other.hits;
        self.lost += other.lost;
        self.false_hits += other.false_hits;
        self.wrong += other.wrong;
        self.tangent += other.tangent;
    }
}

impl Audit {
    /// Checks one answer (t, or none) to a ray with t in the closed `range`.
    ///
    /// *Frame:* the lattice's local frame (m); t in lengths of `direction`.
    pub fn check(&mut self, lattice: &Lattice, origin: DVec3, direction: DVec3, range: [f64; 2], answer: Option<f64>) {
        let exact = referee::first_hit(lattice, origin, direction, range);
        self.check_against(exact, lattice, origin, direction, range, answer);
    }

    /// As [`Self::check`], where the referee's answer `exact` to the same ray is known already: it takes longer than any
    /// tracer, and many may be held against one answer.
    pub fn check_against(
        &mut self,
        exact: Option<RefereeHit>,
        lattice: &Lattice,
        origin: DVec3,
        direction: DVec3,
        range: [f64; 2],
        answer: Option<f64>,
    ) {
        self.rays += 1;
        let column = lattice.width[0].min(lattice.width[1]);
        self.hits += u64::from(exact.is_some());
        let per_metre = 1.0 / direction.length();
        let near = |from: f64, to: f64, slack: f64| {
            let slack = slack * column * per_metre;
            [(from.min(to) - slack).max(range[0]), (from.max(to) + slack).min(range[1])]
        };
        let stays = |from, to| referee::stays_within(lattice, origin, direction, near(from, to, 1e-3), 1e-4 * column);
        let grazes = |t| referee::closest_approach(lattice, origin, direction, near(t, t, 0.05)).abs() < 1e-5 * column;
        let kind = match (exact, answer) {
            (None, None) => return,
            (Some(exact), None) if exact.touch || stays(exact.t, exact.t) => &mut self.tangent,
            // Two crossings so close that the surface stays within reach between them.
            (Some(exact), None) if dips_back(lattice, origin, direction, range, exact.t, column) => &mut self.tangent,
            (Some(_), None) => &mut self.lost,
            (None, Some(t)) if grazes(t) => &mut self.tangent,
            (None, Some(_)) => &mut self.false_hits,
            (Some(exact), Some(t)) => {
                let cell = [exact.patch as usize % lattice.cells[0], exact.patch as usize / lattice.cells[0]];
                let (_, slope) = lattice.evaluate(cell[0], cell[1], exact.uv[0], exact.uv[1]);
                let normal = DVec3::new(-slope[0], 1.0, -slope[1]).normalize();
                let cosine = (normal.dot(direction) * per_metre).abs().max(0.02);
                if (t - exact.t).abs() / per_metre <= 1e-4 * column / cosine {
                    return;
                }
                // Before the first crossing there is none: an answer there on the surface is a touch.
                let touches = t < exact.t && grazes(t);
                if touches || stays(exact.t, t) || dips_back(lattice, origin, direction, range, exact.t.min(t), column)
                {
                    &mut self.tangent
                } else {
                    &mut self.wrong
                }
            }
        };
        *kind += 1;
    }

    /// Checks a yes or no.
    pub fn check_any(&mut self, lattice: &Lattice, origin: DVec3, direction: DVec3, range: [f64; 2], answer: bool) {
        let exact = referee::first_hit(lattice, origin, direction, range);
        self.check_any_against(exact, lattice, origin, direction, range, answer);
    }

    /// As [`Self::check_any`], where the referee's answer is known already.
    pub fn check_any_against(
        &mut self,
        exact: Option<RefereeHit>,
        lattice: &Lattice,
        origin: DVec3,
        direction: DVec3,
        range: [f64; 2],
        answer: bool,
    ) {
        if answer && exact.is_none() {
            // A yes does not say where: a touch may be anywhere along the ray.
            self.rays += 1;
            let column = lattice.width[0].min(lattice.width[1]);
            let touches = referee::closest_approach(lattice, origin, direction, range) < 1e-5 * column;
            *(if touches { &mut self.tangent } else { &mut self.false_hits }) += 1;
            return;
        }
        let answer = exact.filter(|_| answer).map(|hit| hit.t);
        self.check_against(exact, lattice, origin, direction, range, answer);
    }
}

/// Whether the ray, after crossing at `t`, comes back through the surface with no more than 1e-4 of a column between:
/// the two crossings of a near-double root.
fn dips_back(lattice: &Lattice, origin: DVec3, direction: DVec3, range: [f64; 2], t: f64, column: f64) -> bool {
    let step = 1e-9 * (t.abs() + column / direction.length());
    let Some(back) = referee::first_hit(lattice, origin, direction, [t + step, range[1]]) else { return false };
    referee::stays_within(lattice, origin, direction, [t, back.t], 1e-4 * column)
}
