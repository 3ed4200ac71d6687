//! What light does in all grids of a mist together: media that share a place add their extinctions.
//!
//! Most mists have one grid, and it answers alone. Of several, collisions are the nearest of each one's (what is left of an
//! exponential is one), transmittances multiply, and optical depths add up.

use std::ops::ControlFlow;

use glam::Vec3;

use super::{
    Mist,
    bricks::Ray,
    tracking::{integral, reached},
};

impl Mist {
    /// Extinction (1/m) at a point of the local frame (m).
    pub fn extinction(&self, point: Vec3) -> f32 {
        self.grids.iter().map(|grid| grid.extinction(point)).sum()
    }

    /// Velocity (m/s) of the mist around a point of the local frame (m): the mean of its brick's, each particle's by what it
    /// stops there; 0 where there is none.
    pub fn velocity(&self, point: Vec3) -> Vec3 {
        if let [grid] = self.grids.as_slice() {
            return grid.velocity(point);
        }
        let (mut momentum, mut amount) = (Vec3::ZERO, 0.0);
        for grid in &self.grids {
            let extinction = grid.extinction(point);
            momentum += extinction * grid.velocity(point);
            amount += extinction;
        }
        if amount > 0.0 { momentum / amount } else { Vec3::ZERO }
    }

    /// Greatest extinction (1/m) anywhere: no point has more.
    pub fn greatest(&self) -> f32 {
        self.grids.iter().map(|grid| grid.greatest()).sum()
    }

    /// Greatest extinction (1/m) of each brick that a ray crosses within `reach` metres, with the distances (m) where it
    /// enters and leaves it, in order, until `visit` breaks; where bricks of several grids overlap, of each part that is in
    /// the same ones. `direction` is a unit vector, `reach` may be infinite.
    pub fn bricks(
        &self,
        origin: Vec3,
        direction: Vec3,
        reach: f32,
        mut visit: impl FnMut(f32, [f32; 2]) -> ControlFlow<()>,
    ) {
        if let [grid] = self.grids.as_slice() {
            return grid.bricks(origin, direction, reach, visit);
        }
        let crossed = |grid: &super::Grid| {
            let mut all = Vec::new();
            grid.bricks(origin, direction, reach, |most, part| {
                all.push((most, part));
                ControlFlow::Continue(())
            });
            all
        };
        let lists: Vec<_> = self.grids.iter().map(crossed).collect();
        let _ = overlaid(&lists, |here, part| visit(here.iter().flatten().sum(), part));
    }

    /// Optical depth over `reach` metres (infinite as well) along a unit direction, exact for the grids.
    pub fn optical_depth(&self, origin: Vec3, direction: Vec3, reach: f32) -> f32 {
        self.grids.iter().map(|grid| grid.optical_depth(origin, direction, reach)).sum()
    }

    /// Calls `place` with the distance (m) at which each of some optical depths, in rising order, is reached within `reach`
    /// metres.
    pub fn places(&self, origin: Vec3, direction: Vec3, reach: f32, depths: &[f32], mut place: impl FnMut(f32)) {
        if let [grid] = self.grids.as_slice() {
            return grid.places(origin, direction, reach, depths, place);
        }
        let rays: Vec<Ray> = self.grids.iter().map(|grid| grid.ray(origin, direction)).collect();
        let lists: Vec<_> = self.grids.iter().zip(&rays).map(|(grid, ray)| grid.voxels(ray, reach)).collect();
        let (mut depth, mut rest) = (0.0, depths.iter());
        let mut next = rest.next();
        let _ = overlaid(&lists, |here, part| {
            // In one voxel of each grid, extinction is a sum of cubics.
            let value = |t: f32| -> f32 {
                let each = self.grids.iter().zip(&rays).zip(here);
                each.filter_map(|((grid, ray), brick)| Some(grid.bricks.value_on(ray, (*brick)?, t))).sum()
            };
            let own = integral(part, value);
            while let Some(wanted) = next.filter(|wanted| **wanted < depth + own) {
                place(reached(part, wanted - depth, value));
                next = rest.next();
            }
            depth += own;
            if next.is_some() { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
        });
    }

    /// Draws where light collides within `reach` metres (infinite as well) along a unit direction; `None` if it passes.
    /// `random` gives uniform numbers in 0..1.
    pub fn collide(&self, origin: Vec3, direction: Vec3, reach: f32, random: &mut impl FnMut() -> f32) -> Option<f32> {
        let mut found = None;
        for grid in &self.grids {
            // Behind another's collision none is looked for.
            let reach = found.unwrap_or(reach);
            found = grid.collide(origin, direction, reach, random).or(found);
        }
        found
    }

    /// Estimates the share of light that is left after `reach` metres (infinite as well) along a unit direction: its mean is the
    /// transmittance, each estimate lies in 0 to 1. `random` gives uniform numbers in 0..1.
    pub fn transmittance(&self, origin: Vec3, direction: Vec3, reach: f32, random: &mut impl FnMut() -> f32) -> f32 {
        let mut share = 1.0;
        for grid in &self.grids {
            if share > 0.0 {
                share *= grid.transmittance(origin, direction, reach, random);
            }
        }
        share
    }
}

/// Calls `visit` with each stretch of a ray on which the same part of each list is under way, in order, until it breaks. The
/// parts of a list follow each other.
fn overlaid<T: Copy>(
    lists: &[Vec<(T, [f32; 2])>],
    mut visit: impl FnMut(&[Option<T>], [f32; 2]) -> ControlFlow<()>,
) -> ControlFlow<()> {
    let mut at = vec![0; lists.len()];
    let mut here = vec![None; lists.len()];
    let mut begin = f32::NEG_INFINITY;
    loop {
        // What is over is left behind: of what remains, every part ends after `begin`.
        for (at, list) in at.iter_mut().zip(lists) {
            while list.get(*at).is_some_and(|(_, [_, to])| *to <= begin) {
                *at += 1;
            }
        }
        let under_way = || at.iter().zip(lists).map(|(&at, list)| list.get(at));
        begin = under_way().flatten().map(|(_, [from, _])| from.max(begin)).fold(f32::INFINITY, f32::min);
        let mut end = f32::INFINITY;
        for (here, part) in here.iter_mut().zip(under_way()) {
            *here = None;
            let Some((value, [from, to])) = part else { continue };
            if *from <= begin {
                *here = Some(*value);
                end = end.min(*to);
            } else {
                end = end.min(*from);
            }
        }
        if here.iter().all(Option::is_none) {
            return ControlFlow::Continue(());
        }
        visit(&here, [begin, end])?;
        begin = end;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stretches_are_cut_where_any_part_begins_or_ends() {
        let one = vec![('a', [0.0, 1.0]), ('b', [1.0, 3.0]), ('c', [5.0, 6.0])];
        let other = vec![('x', [0.5, 2.0]), ('y', [4.0, f32::INFINITY])];
        let mut all = Vec::new();
        let _ = overlaid(&[one, other, Vec::new()], |here, part| {
            all.push((here.iter().flatten().collect::<String>(), part));
            ControlFlow::Continue(())
        });
        let expected = [
            ("a", [0.0, 0.5]),
            ("ax", [0.5, 1.0]),
            ("bx", [1.0, 2.0]),
            ("b", [2.0, 3.0]),
            ("y", [4.0, 5.0]),
            ("cy", [5.0, 6.0]),
            ("y", [6.0, f32::INFINITY]),
        ];
        assert_eq!(all, expected.map(|(names, part)| (names.to_owned(), part)));
    }
}
