//! One sparse grid of extinction and where its voxels lie in the local frame.
//!
//! The voxels of particles are cubes along the axes; those of a file lie as the file says, turned and stretched, so that no
//! value is resampled. What light does in them is in `tracking`.

use std::sync::Arc;

use glam::{DMat3, DVec3, Mat3, Vec3};

use super::bricks::{Bricks, Ray};

/// Where voxels lie.
#[derive(Clone, Copy, Debug)]
enum Placing {
    /// Cubes of a width (m), one corner at the local frame's zero.
    Even(f32),
    /// Voxels = axes * metres + start.
    Affine { axes: Mat3, start: Vec3 },
}

/// A sparse grid of extinction. Copies share its values.
#[derive(Clone, Debug)]
pub struct Grid {
    placing: Placing,
    pub(super) bricks: Arc<Bricks>,
}

impl Grid {
    /// A grid of cubes of `voxel` metres along the axes.
    pub(super) fn even(voxel: f32, bricks: Bricks) -> Self {
        Self { placing: Placing::Even(voxel), bricks: Arc::new(bricks) }
    }

    /// A grid of which a point (m, local frame) lies at `axes` * point + `start` voxels.
    pub(super) fn affine(axes: DMat3, start: DVec3, bricks: Arc<Bricks>) -> Self {
        Self { placing: Placing::Affine { axes: axes.as_mat3(), start: start.as_vec3() }, bricks }
    }

    /// Bytes held, with those that copies share.
    pub fn bytes(&self) -> u64 {
        self.bricks.bytes()
    }

    /// Width of a voxel (m); of one that is no cube, the least.
    pub(super) fn voxel(&self) -> f32 {
        match self.placing {
            Placing::Even(voxel) => voxel,
            Placing::Affine { axes, .. } => {
                let axes = axes.inverse();
                axes.x_axis.length().min(axes.y_axis.length()).min(axes.z_axis.length())
            }
        }
    }

    /// A point (m) in voxels.
    #[inline]
    pub(super) fn to_voxels(&self, point: Vec3) -> Vec3 {
        match self.placing {
            Placing::Even(voxel) => point / voxel,
            Placing::Affine { axes, start } => axes * point + start,
        }
    }

    /// A ray in voxels, whose distances stay metres.
    #[inline]
    pub(super) fn ray(&self, origin: Vec3, direction: Vec3) -> Ray {
        match self.placing {
            Placing::Even(voxel) => Ray::in_voxels(origin / voxel, direction / voxel),
            Placing::Affine { axes, start } => Ray::in_voxels(axes * origin + start, axes * direction),
        }
    }
}
