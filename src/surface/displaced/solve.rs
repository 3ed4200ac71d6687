//! First hit of a ray with a patch whose control points are displaced: two equations in u and v, in double precision.
//!
//! The patch is seen along the ray: of each control point the distances to two planes that meet in the ray (Martin, Cohen,
//! Fish and Shirley 2000) and its place t along the ray. A hit is where both distances vanish. Pieces of the patch are
//! taken nearest first, by the least t of their hulls; one whose hull cannot hold the ray is discarded. So when a root
//! lies before all pieces that are left, it is proven the first.
//!
//! *At tangency* pieces shrink to double precision's resolution and still may hold the ray: `newton` and `bezier-clip`
//! then give up, `reference` calls it a hit.

use glam::DVec3;

use super::clip;
use super::net::Net;

/// Smallest piece along u or v: below it a place in the patch has hardly any digits left.
pub(super) const SMALLEST: f64 = 1.0 / (1u64 << 46) as f64;
/// Room around a piece's border within which a root counts as its own, as a share of the piece: many times what rounding
/// moves a root by, so that none falls between two pieces.
const BORDER: f64 = 1e-9;
/// A piece is proven to hold at most one root where the preconditioned slopes differ from the identity by less than this
/// (any bound under 1 proves it; a smaller one makes Newton's steps sure).
const SURE: f64 = 0.7;
/// Steps of Newton's iteration for one piece: in a sure piece it squares its error.
const STEPS: usize = 20;
/// Pieces under this size are proven whatever the tolerance: much smaller ones have no digits left for the proof.
const PROVABLE: f64 = 1e-6;
/// Pieces after which a ray is given up: a tangent one needs some hundreds. Rays that lie within a ruled patch would
/// go on for ever.
const PIECES: usize = 20_000;

/// Ways to close in on a root.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Method {
    /// Newton's iteration, guessed from the middle of a piece and its slopes there; pieces are halved until it is sure.
    Newton,
    /// Clipping in u and v (Nishita, Sederberg and Kakimoto 1990), until the piece is as short as the tolerance.
    Clip,
    /// Halving to the end.
    Halve,
}

/// What to look for.
#[derive(Clone, Copy, Debug)]
pub(super) struct Question {
    /// Origin, in the patch's own frame (m).
    pub(super) origin: DVec3,
    /// Direction, of any length.
    pub(super) direction: DVec3,
    /// Least and greatest t that count, inclusive.
    pub(super) range: [f64; 2],
    /// Accuracy asked for, in t.
    pub(super) tolerance: f64,
    /// The patch's domain: least and greatest u, then v.
    pub(super) domain: [[f64; 2]; 2],
}

/// A root.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Root {
    pub(super) t: f64,
    pub(super) u: f64,
    pub(super) v: f64,
}

/// What is known of a patch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Answer {
    /// The first root that was found.
    pub(super) root: Option<Root>,
    /// From which t on nothing is decided; +inf where everything is.
    pub(super) doubt: f64,
}

/// A part of the patch, seen along the ray.
#[derive(Clone, Copy)]
pub(super) struct Piece {
    /// Distances to the two planes (m) and t.
    pub(super) net: Net,
    /// Its range of u and of v.
    pub(super) range: [[f64; 2]; 2],
    /// Least t of its hull.
    low: f64,
}

impl Piece {
    fn new(net: Net, range: [[f64; 2]; 2]) -> Self {
        let low = net.iter().fold(f64::INFINITY, |low, p| low.min(p.z));
        Self { net, range, low }
    }

    /// The part over a share of one axis.
    pub(super) fn part(&self, axis: usize, share: [f64; 2]) -> Self {
        let mut range = self.range;
        range[axis] = share.map(|s| self.range[axis][0] + s * (self.range[axis][1] - self.range[axis][0]));
        Self::new(self.net.part(axis, share), range)
    }

    /// Widths in u and v.
    pub(super) fn widths(&self) -> [f64; 2] {
        self.range.map(|[low, high]| high - low)
    }

    fn root(&self, place: [f64; 2], t: f64) -> Root {
        let [u, v] = [0, 1].map(|axis| self.range[axis][0] + place[axis] * self.widths()[axis]);
        Root { t, u, v }
    }
}

/// What a look at a piece says. It lives for one turn, on the stack.
#[allow(clippy::large_enum_variant)]
enum Verdict {
    /// No root in it.
    Nothing,
    /// Exactly one, here.
    One(Root),
    /// Only this part may hold any.
    Less(Piece),
    /// Neither shown nor ruled out.
    Open,
}

/// The first root of a patch.
pub(super) fn first_root(patch: &Net, question: &Question, method: Method, steps: &mut u64) -> Answer {
    let seen = seen_along(patch, question.origin, question.direction);
    let per_t = 1.0 / question.direction.length();
    let farthest = patch.iter().fold(0.0f64, |far, point| far.max((point - question.origin).length()));
    // Sums of a few products each, again at each cut: some tens of units in the last place of the largest term.
    let rounding = DVec3::new(1.0, 1.0, per_t) * (64.0 * f64::EPSILON * farthest);
    let whole = Piece::new(seen, [[0.0, 1.0]; 2]);
    let whole = (0..2).fold(whole, |piece, axis| piece.part(axis, question.domain[axis]));
    let [near, far] = question.range;
    // Nobody can have more than rounding leaves.
    let tolerance = question.tolerance.max(rounding.z);
    let mut open = vec![whole];
    let mut answer = Answer { root: None, doubt: f64::INFINITY };
    for _ in 0..PIECES {
        let nearest = (0..open.len()).min_by(|&a, &b| open[a].low.total_cmp(&open[b].low));
        let Some(nearest) = nearest else { return answer };
        let piece = open.swap_remove(nearest);
        if piece.low > answer.root.map_or(far, |root| root.t).min(answer.doubt) + rounding.z {
            // All that is left lies behind.
            return answer;
        }
        *steps += 1;
        let [low, high] = piece.net.hull();
        let beside = |low: f64, high: f64, rounding: f64| low > rounding || high < -rounding;
        if beside(low.x, high.x, rounding.x) || beside(low.y, high.y, rounding.y) || high.z < near - rounding.z {
            continue;
        }
        let [width_u, width_v] = piece.widths();
        if width_u.max(width_v) <= SMALLEST {
            let [point, ..] = piece.net.value(0.5, 0.5);
            let here = point.z.clamp(near, far);
            match method {
                Method::Halve if (point.z - here).abs() <= rounding.z => {
                    keep(&mut answer, piece.root([0.5; 2], here), question);
                }
                Method::Halve => {}
                Method::Newton | Method::Clip => answer.doubt = answer.doubt.min(here),
            }
            continue;
        }
        let verdict = match method {
            Method::Newton => certify(&piece, rounding, tolerance),
            Method::Clip => clip_or_certify(&piece, rounding, tolerance),
            Method::Halve if beside_askew(&piece, rounding) => Verdict::Nothing,
            Method::Halve => Verdict::Open,
        };
        match verdict {
            Verdict::Nothing => {}
            Verdict::One(root) => keep(&mut answer, root, question),
            Verdict::Less(piece) => open.push(piece),
            Verdict::Open => {
                let axis = usize::from(width_v > width_u);
                open.push(piece.part(axis, [0.0, 0.5]));
                open.push(piece.part(axis, [0.5, 1.0]));
            }
        }
    }
    let left = open.iter().fold(f64::INFINITY, |low, piece| low.min(piece.low));
    answer.doubt = answer.doubt.min(left.max(near));
    answer
}

/// The patch by its distances to two planes through the ray, and along it.
///
/// One plane is upright, the other as level as the ray lets it: a surface that is nearly level is then thin in one of
/// them, and the hulls of grazing rays part soon.
fn seen_along(patch: &Net, origin: DVec3, direction: DVec3) -> Net {
    let along = direction.normalize();
    let across = if direction.x == 0.0 && direction.z == 0.0 { DVec3::X } else { along.cross(DVec3::Y).normalize() };
    let upward = across.cross(along);
    let per_t = 1.0 / direction.length();
    patch.map(|point| {
        let from = point - origin;
        DVec3::new(from.dot(across), from.dot(upward), from.dot(along) * per_t)
    })
}

/// Keeps a root that counts and is the nearest so far.
fn keep(answer: &mut Answer, root: Root, question: &Question) {
    let [near, far] = question.range;
    if (near..=far).contains(&root.t) && answer.root.is_none_or(|other| root.t < other.t) {
        answer.root = Some(root);
    }
}

/// Whether a piece's hull leaves the ray aside in the directions that the piece itself runs in: where both distances change
/// together, along a grazing ray, the hull is long and thin and its upright box says little.
fn beside_askew(piece: &Piece, rounding: DVec3) -> bool {
    let [_, slope_u, slope_v] = piece.net.value(0.5, 0.5);
    let Some(inverse) = inverse(slope_u, slope_v) else { return false };
    inverse.iter().any(|row| {
        let blur = row[0].abs() * rounding.x + row[1].abs() * rounding.y;
        let along = |p: DVec3| row[0] * p.x + row[1] * p.y;
        piece.net.iter().all(|p| along(p) > blur) || piece.net.iter().all(|p| along(p) < -blur)
    })
}

/// Clips a piece in u and in v; one that is as short as the tolerance must be proven to hold a root.
fn clip_or_certify(piece: &Piece, rounding: DVec3, tolerance: f64) -> Verdict {
    let [low, high] = piece.net.hull();
    let [width_u, width_v] = piece.widths();
    if high.z - low.z <= tolerance || width_u.max(width_v) <= PROVABLE {
        // As short as asked: what is left is to prove that there is one root. The proof's own root is as good.
        match certify(piece, rounding, tolerance) {
            Verdict::Less(_) | Verdict::Open => {}
            proven => return proven,
        }
    }
    let Some(clipped) = clip::both(piece, rounding.x.max(rounding.y)) else { return Verdict::Nothing };
    let kept = [0, 1].map(|axis| clipped.widths()[axis] / piece.widths()[axis]);
    // Both axes keep nearly all: several roots may be in it.
    if kept[0].min(kept[1]) > clip::KEEPS { Verdict::Open } else { Verdict::Less(clipped) }
}

/// Whether a piece holds exactly one root, or none (Krawczyk 1969): its slopes, multiplied by the inverse of the middle
/// ones, differ from the identity by less than 1 in the row-sum norm, so that no two of its points are seen as one.
fn certify(piece: &Piece, rounding: DVec3, tolerance: f64) -> Verdict {
    let net = &piece.net;
    let [middle, slope_u, slope_v] = net.value(0.5, 0.5);
    let Some(inverse) = inverse(slope_u, slope_v) else { return Verdict::Open };
    let apply = |p: DVec3| [inverse[0][0] * p.x + inverse[0][1] * p.y, inverse[1][0] * p.x + inverse[1][1] * p.y];
    let mut rows = [0.0f64; 2];
    for axis in 0..2 {
        let mut most = [0.0f64; 2];
        for slope in net.slopes(axis) {
            let mut differs = apply(slope);
            differs[axis] -= 1.0;
            most = [0, 1].map(|row| most[row].max(differs[row].abs()));
        }
        rows = [0, 1].map(|row| rows[row] + most[row]);
    }
    let differs = rows[0].max(rows[1]);
    if differs.is_nan() || differs >= SURE {
        return Verdict::Open;
    }
    // Where a root can lie: within this box around Newton's first step.
    let step = apply(middle);
    let mut part = [[0.0; 2]; 2];
    for axis in 0..2 {
        let blur = inverse[axis][0].abs() * rounding.x + inverse[axis][1].abs() * rounding.y;
        let (center, reach) = (0.5 - step[axis], 0.5 * rows[axis] + blur + BORDER);
        part[axis] = [(center - reach).max(0.0), (center + reach).min(1.0)];
        if part[axis][0] > part[axis][1] {
            return Verdict::Nothing;
        }
    }
    if let Some((place, t)) = newton(net, [0, 1].map(|axis| (0.5 - step[axis]).clamp(0.0, 1.0)), tolerance)
        && place.iter().all(|p| (-BORDER..=1.0 + BORDER).contains(p))
    {
        return Verdict::One(piece.root(place, t));
    }
    // Newton's root, if any, lies outside; only rounding could leave one inside. What is left shrinks at each turn.
    let wider = [0, 1].map(|axis| part[axis][1] - part[axis][0]);
    if wider[0].min(wider[1]) > clip::KEEPS {
        Verdict::Open
    } else {
        Verdict::Less(piece.part(0, part[0]).part(1, part[1]))
    }
}

/// Newton's iteration from a place in a piece: the place and t of the root that it settles on.
fn newton(net: &Net, from: [f64; 2], tolerance: f64) -> Option<([f64; 2], f64)> {
    let mut place = from;
    for _ in 0..STEPS {
        let [point, slope_u, slope_v] = net.value(place[0], place[1]);
        let inverse = inverse(slope_u, slope_v)?;
        let step = inverse.map(|row| row[0] * point.x + row[1] * point.y);
        place = [place[0] - step[0], place[1] - step[1]];
        if !place.iter().all(|p| (-1.0..=2.0).contains(p)) {
            return None;
        }
        let size = step[0].abs().max(step[1].abs());
        let along = (step[0] * slope_u.z + step[1] * slope_v.z).abs();
        // Errors are squared from step to step: one of 1e-4 leaves normals right to single precision's digits.
        if size <= 8.0 * f64::EPSILON || (along <= 0.1 * tolerance && size <= 1e-4) {
            return Some((place, net.value(place[0], place[1])[0].z));
        }
    }
    None
}

/// Inverse of the slopes of the two distances; `None` where they are singular to rounding: the ray lies in the tangent
/// plane.
fn inverse(slope_u: DVec3, slope_v: DVec3) -> Option<[[f64; 2]; 2]> {
    let determinant = slope_u.x * slope_v.y - slope_v.x * slope_u.y;
    let size = slope_u.truncate().length() * slope_v.truncate().length();
    let sound = determinant.abs() > 8.0 * f64::EPSILON * size;
    sound.then(|| {
        [[slope_v.y / determinant, -slope_v.x / determinant], [-slope_u.y / determinant, slope_u.x / determinant]]
    })
}
