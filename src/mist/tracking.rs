//! Light through mist: how much of it is left, and where it collides.
//!
//! Delta tracking (E. Woodcock et al., 1965) and ratio tracking (J. Novak et al., 2014) by the greatest extinction of each
//! brick, so that what is empty or thin costs little. Where a brick is so dense that this would take more steps than the brick
//! has voxels on the way, the voxels are walked exactly instead: between two corners extinction is a cubic along a ray, whose
//! integral two points give (Gauss and Legendre). So no walk is without an end, however dense the mist.
//!
//! One grid's; what several do together is in `sum`.

use std::ops::ControlFlow;

use glam::Vec3;

use super::{
    bricks::{Ray, SIDE},
    grid::Grid,
};

/// Tentative collisions expected in a brick from which on its voxels are walked: about as much work.
const TENTATIVE: f32 = 2.0 * SIDE as f32;

impl Grid {
    /// Extinction (1/m) at a point of the local frame (m).
    pub(super) fn extinction(&self, point: Vec3) -> f32 {
        let point = self.to_voxels(point);
        self.bricks.find(point).map_or(0.0, |brick| self.bricks.value(brick, point))
    }

    /// Velocity (m/s) of the mist around a point of the local frame (m): the mean of its brick's, each particle's by what it
    /// stops there; 0 where there is none.
    pub(super) fn velocity(&self, point: Vec3) -> Vec3 {
        self.bricks.find(self.to_voxels(point)).map_or(Vec3::ZERO, |brick| self.bricks.velocity(brick))
    }

    /// Greatest extinction (1/m) anywhere.
    pub(super) fn greatest(&self) -> f32 {
        self.bricks.greatest()
    }

    /// Greatest extinction (1/m) of each brick that a ray crosses within `reach` metres, with the distances (m) where it
    /// enters and leaves it, in order, until `visit` breaks. `direction` is a unit vector, `reach` may be infinite.
    pub(super) fn bricks(
        &self,
        origin: Vec3,
        direction: Vec3,
        reach: f32,
        mut visit: impl FnMut(f32, [f32; 2]) -> ControlFlow<()>,
    ) {
        let ray = self.ray(origin, direction);
        let _ = self.bricks.crossed(&ray, reach, &mut |brick, part| visit(self.bricks.most(brick), part));
    }

    /// The voxels that a ray crosses within `reach` metres, each by its brick, with where it enters and leaves it, in order.
    pub(super) fn voxels(&self, ray: &Ray, reach: f32) -> Vec<(u32, [f32; 2])> {
        let mut voxels = Vec::new();
        let _ = self.bricks.crossed(ray, reach, &mut |brick, part| {
            self.bricks.voxels(ray, brick, part, |part| {
                voxels.push((brick, part));
                ControlFlow::Continue(())
            })
        });
        voxels
    }

    /// Optical depth over `reach` metres (infinite as well) along a unit direction, exact for the grid.
    pub(super) fn optical_depth(&self, origin: Vec3, direction: Vec3, reach: f32) -> f32 {
        let ray = self.ray(origin, direction);
        let mut depth = 0.0;
        let _ = self.bricks.crossed(&ray, reach, &mut |brick, part| {
            self.bricks.voxels(&ray, brick, part, |part| {
                depth += self.depth(&ray, brick, part);
                ControlFlow::Continue(())
            })
        });
        depth
    }

    /// Calls `place` with the distance (m) at which each of some optical depths, in rising order, is reached within `reach`
    /// metres.
    pub(super) fn places(&self, origin: Vec3, direction: Vec3, reach: f32, depths: &[f32], mut place: impl FnMut(f32)) {
        let ray = self.ray(origin, direction);
        let (mut depth, mut rest) = (0.0, depths.iter());
        let mut next = rest.next();
        let _ = self.bricks.crossed(&ray, reach, &mut |brick, part| {
            self.bricks.voxels(&ray, brick, part, |part| {
                let own = self.depth(&ray, brick, part);
                while let Some(wanted) = next.filter(|wanted| **wanted < depth + own) {
                    place(self.solve(&ray, brick, part, wanted - depth));
                    next = rest.next();
                }
                depth += own;
                if next.is_some() { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
            })
        });
    }

    /// Draws where light collides within `reach` metres (infinite as well) along a unit direction; `None` if it passes.
    /// `random` gives uniform numbers in 0..1.
    pub(super) fn collide(
        &self,
        origin: Vec3,
        direction: Vec3,
        reach: f32,
        random: &mut impl FnMut() -> f32,
    ) -> Option<f32> {
        let ray = self.ray(origin, direction);
        // Optical depth to the next collision, tentative or not: what is left of it at a border is as good as new.
        let mut left = -(-random()).ln_1p();
        let mut found = None;
        let _ = self.bricks.crossed(&ray, reach, &mut |brick, part| {
            let [mut t, end] = part;
            let most = self.bricks.most(brick);
            if most * (end - t) > TENTATIVE {
                return self.bricks.voxels(&ray, brick, part, |part| {
                    let own = self.depth(&ray, brick, part);
                    if left < own {
                        found = Some(self.solve(&ray, brick, part, left));
                        return ControlFlow::Break(());
                    }
                    left -= own;
                    ControlFlow::Continue(())
                });
            }
            loop {
                let own = most * (end - t);
                if left >= own {
                    left -= own;
                    return ControlFlow::Continue(());
                }
                t += left / most;
                if random() * most < self.bricks.value_on(&ray, brick, t) {
                    found = Some(t);
                    return ControlFlow::Break(());
                }
                left = -(-random()).ln_1p();
            }
        });
        found
    }

    /// Estimates the share of light that is left after `reach` metres (infinite as well) along a unit direction: its mean is the
    /// transmittance, each estimate lies in 0 to 1. `random` gives uniform numbers in 0..1.
    pub(super) fn transmittance(
        &self,
        origin: Vec3,
        direction: Vec3,
        reach: f32,
        random: &mut impl FnMut() -> f32,
    ) -> f32 {
        let ray = self.ray(origin, direction);
        let mut share = 1.0f32;
        let _ = self.bricks.crossed(&ray, reach, &mut |brick, part| {
            let [mut t, end] = part;
            let most = self.bricks.most(brick);
            if most * (end - t) > TENTATIVE {
                let mut depth = 0.0;
                let _ = self.bricks.voxels(&ray, brick, part, |part| {
                    depth += self.depth(&ray, brick, part);
                    ControlFlow::Continue(())
                });
                share *= (-depth).exp();
            } else if most > 0.0 {
                loop {
                    t -= (-random()).ln_1p() / most;
                    if t >= end {
                        break;
                    }
                    share *= 1.0 - self.bricks.value_on(&ray, brick, t) / most;
                }
            }
            if share > 0.0 { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
        });
        share
    }

    /// Optical depth of a part of a ray within one voxel.
    #[inline]
    fn depth(&self, ray: &Ray, brick: u32, part: [f32; 2]) -> f32 {
        integral(part, |t| self.bricks.value_on(ray, brick, t))
    }

    /// Where, within one voxel, a ray has an optical depth since it came in.
    fn solve(&self, ray: &Ray, brick: u32, part: [f32; 2], depth: f32) -> f32 {
        reached(part, depth, |t| self.bricks.value_on(ray, brick, t))
    }
}

/// Integral of a cubic.
#[inline]
pub(super) fn integral([start, end]: [f32; 2], value: impl Fn(f32) -> f32) -> f32 {
    let (middle, half) = (0.5 * (start + end), 0.5 * (end - start));
    // Gauss-Legendre's two points, at +-1 / sqrt(3).
    let aside = half * 0.577_350_3;
    half * (value(middle - aside) + value(middle + aside))
}

/// Where the integral of a cubic that is nowhere negative reaches a `depth` under the whole one's.
pub(super) fn reached([start, end]: [f32; 2], depth: f32, value: impl Fn(f32) -> f32) -> f32 {
    let (mut low, mut high) = (start, end);
    let mut t = 0.5 * (start + end);
    // Newton's steps, or halves where they leave the bracket: single precision has 24 bits, and halves alone find them.
    for _ in 0..24 {
        let over = integral([start, t], &value) - depth;
        // The sum of two products of rounded values is no better than this.
        if over.abs() <= 4.0 * f32::EPSILON * depth {
            break;
        }
        if over > 0.0 {
            high = t;
        } else {
            low = t;
        }
        let newton = t - over / value(t);
        let next = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
        if next == t {
            break;
        }
        t = next;
    }
    t
}
