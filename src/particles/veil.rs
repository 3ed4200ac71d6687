//! Streaks whose neighbours move alike are one sheet of water seen through its strands: how wide each is drawn so that they
//! close up into a veil.
//!
//! Lines through one flow are read as a surface where they lie closer than they are wide (M. Zöckler, D. Stalling, H.-C. Hege,
//! 1996, draw them so dense). Here what is missing of that density is made up by width, and the opacity falls by what the
//! width grows, in `streak`: no light is stopped that was not.

use glam::Vec3;

use super::{
    Spray,
    classes::rise,
    nearest::{MOST, Nearest, nearest},
};

/// A streak's radius by the distance between strands. Soft profiles (1 - x^2)^(3/2) of 0.8 of it, one distance apart, add up to
/// the same within 6 % anywhere; of a half they leave gaps, of the whole they swell in between by 30 %. Strands to both sides
/// count as one half of [`spacing`] apart.
const RADIUS: f32 = 0.4;

/// Spacings by the streak's length over which strands stop being one sheet: what is farther apart than it is long is drops.
const APART: [f32; 2] = [0.5, 1.0];

/// Another streak: how far (m), how much it moves alike (0..1), and how much of it is a streak at all.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Neighbour {
    distance: f32,
    alike: f32,
    share: f32,
}

/// Twice the distance (m) between strands, from neighbours in ascending order, and the part of all neighbours so near that
/// moves alike: the D by which the sum of alike · (1 - distance / D), where that is positive, is 1.
///
/// One on either side makes it twice their distance; a single one, or none that moves alike, makes none. It goes evenly with
/// all that it is made of, whoever is the third or the fourth.
fn spacing(neighbours: &[Neighbour]) -> Option<(f32, f32)> {
    let (mut alike, mut sum) = (0.0, 0.0);
    for (k, neighbour) in neighbours.iter().enumerate() {
        alike += neighbour.alike;
        sum += neighbour.alike * neighbour.distance;
        let spacing = sum / (alike - 1.0);
        let next = neighbours.get(k + 1).map_or(f32::INFINITY, |next| next.distance);
        if alike > 1.0 && spacing <= next {
            let weight = |other: &Neighbour| other.share * (1.0 - other.distance / spacing).max(0.0);
            let all: f32 = neighbours.iter().map(weight).sum();
            return (spacing > 0.0 && spacing.is_finite() && all > 0.0).then(|| (spacing, (1.0 / all).min(1.0)));
        }
    }
    None
}

/// Radius (m) of a streak of so much length (m) among its neighbours, 0 for one that is on its own.
fn radius(neighbours: &[Neighbour], length: f32) -> f32 {
    let Some((spacing, kindred)) = spacing(neighbours) else { return 0.0 };
    // Where as many go another way, streams cross: no sheet.
    let together = (2.0 * kindred - 1.0).max(0.0);
    RADIUS * spacing * together * (1.0 - rise(spacing / length, APART[0], APART[1]))
}

/// Radius (m) that each particle's streak is to be drawn with to close up with its neighbours; 0 where it stays as it is.
///
/// `merging` is the difference of two velocities, by the speed, from which on they have nothing to do with each other; from half
/// of it down they are alike. A streak shows `length(index)` (m) of flight; `share` is how much of each particle is one at all, none
/// for all of each.
pub fn veils(spray: &Spray, share: &[f32], merging: f32, length: impl Fn(usize) -> f32 + Sync) -> Vec<f32> {
    let mut veils = vec![0.0; spray.len()];
    let streaks: Vec<usize> = match share {
        [] => (0..spray.len()).collect(),
        share => (0..spray.len()).filter(|&index| share[index] > 0.0).collect(),
    };
    let places: Vec<Vec3> = streaks.iter().map(|&index| spray.position[index]).collect();
    let judge = |own: usize, near: &Nearest| {
        let velocity = spray.velocity[streaks[own]];
        let mut neighbours = [Neighbour { distance: 0.0, alike: 0.0, share: 0.0 }; MOST];
        let squares = near.squares();
        for (neighbour, &(square, other)) in neighbours.iter_mut().zip(squares) {
            let other = streaks[other as usize];
            let share = share.get(other).copied().unwrap_or(1.0);
            let alike = 1.0 - rise(velocity.distance(spray.velocity[other]) / velocity.length(), 0.5 * merging, merging);
            // What is no number says nothing.
            let alike = if alike > 0.0 { alike * share } else { 0.0 };
            *neighbour = Neighbour { distance: square.sqrt(), alike, share };
        }
        radius(&neighbours[..squares.len()], length(streaks[own]))
    };
    let found = nearest(&places, |own| APART[1] * length(streaks[own]), judge);
    for (index, veil) in streaks.into_iter().zip(found) {
        veils[index] = veil;
    }
    veils
}
