//! The second representation: the same spline, sampled into triangles. Fixed samples per cell, or as many as the screen
//! needs.
//!
//! Neighbouring cells share their vertices, so the mesh has no cracks even where adaptive counts differ: a cell's border
//! takes the finer count of the two cells beside it.

use std::collections::HashMap;

use glam::Vec3;

use super::SplineSurface;

/// Triangles of a surface: positions, unit normals and indices, counter-clockwise seen from above.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SurfaceMesh {
    /// Vertices (m, local frame).
    pub position: Vec<Vec3>,
    /// Unit normals of the spline at the vertices.
    pub normal: Vec<Vec3>,
    /// Vertex indices.
    pub index: Vec<[u32; 3]>,
}

/// Why a mesh cannot be made.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum MeshError {
    /// More vertices than 32-bit indices reach.
    #[error("{vertices} vertices; expected less than 2^31: fewer samples per column, or a coarser screen error")]
    TooManyVertices {
        /// Vertices asked for.
        vertices: u64,
    },
}

/// The surface with `samples` x `samples` quadrilaterals, two triangles each, on every existing patch.
///
/// Cells that the domain cuts in half (orders 2 and 4) keep the samples within it.
///
/// # Errors
/// [`MeshError::TooManyVertices`].
pub fn uniform(surface: &SplineSurface, samples: u32) -> Result<SurfaceMesh, MeshError> {
    let lattice = surface.lattice();
    let [cx, cz] = lattice.cells;
    let n = samples.max(1) as usize;
    let [across, down] = [cx * n + 1, cz * n + 1];
    if across as u64 * down as u64 >= 1 << 31 {
        return Err(MeshError::TooManyVertices { vertices: across as u64 * down as u64 });
    }
    let clamp = |axis: usize, k: usize| (k as f64 / n as f64).clamp(lattice.domain[0][axis], lattice.domain[1][axis]);
    const UNUSED: u32 = u32::MAX;
    let mut number = vec![UNUSED; across * down];
    let mut mesh = SurfaceMesh::default();
    for b in 0..down - 1 {
        for a in 0..across - 1 {
            let (i, j) = (a / n, b / n);
            // Quadrilaterals beyond the domain's edge are folded flat.
            if !lattice.exists(i, j) || clamp(0, a) == clamp(0, a + 1) || clamp(1, b) == clamp(1, b + 1) {
                continue;
            }
            let [p, q, r, s] = [(a, b), (a, b + 1), (a + 1, b + 1), (a + 1, b)].map(|(a, b)| {
                let slot = &mut number[b * across + a];
                if *slot == UNUSED {
                    *slot = mesh.position.len() as u32;
                    let (u, v) = (clamp(0, a) - i as f64, clamp(1, b) - j as f64);
                    let point = surface.patch_point((j * cx + i) as u32, u as f32, v as f32);
                    mesh.position.push(point.position);
                    mesh.normal.push(point.normal);
                }
                *slot
            });
            mesh.index.push([p, q, r]);
            mesh.index.push([p, r, s]);
        }
    }
    Ok(mesh)
}

/// The surface with `samples(i, j)` quadrilaterals a side on cell (i, j): one count, or powers of two, so that the finer
/// of two neighbours has the coarser one's border points among its own.
///
/// # Errors
/// [`MeshError::TooManyVertices`].
pub fn adaptive(surface: &SplineSurface, samples: impl Fn(usize, usize) -> u32) -> Result<SurfaceMesh, MeshError> {
    let lattice = surface.lattice();
    let [cx, cz] = lattice.cells;
    let exists = |i: i64, j: i64| {
        (0..cx as i64).contains(&i) && (0..cz as i64).contains(&j) && lattice.exists(i as usize, j as usize)
    };
    let count = |i: i64, j: i64| if exists(i, j) { samples(i as usize, j as usize).max(1) } else { 0 };
    let mut vertices = 0u64;
    for j in 0..cz as i64 {
        for i in 0..cx as i64 {
            vertices += u64::from(count(i, j)).pow(2);
        }
    }
    if vertices >= 1 << 31 {
        return Err(MeshError::TooManyVertices { vertices });
    }
    let mut mesh = SurfaceMesh::default();
    let mut index = Vec::with_capacity(2 * vertices as usize);
    // A vertex belongs to up to four quadrilaterals, of up to four cells: found again by its exact cell coordinates.
    let mut shared: HashMap<[u64; 2], u32> = HashMap::with_capacity(vertices as usize);
    for j in 0..cz as i64 {
        for i in 0..cx as i64 {
            let own = count(i, j);
            if own == 0 {
                continue;
            }
            // Finer of the two along each border: west, east, north, south.
            let border = [(i - 1, j), (i + 1, j), (i, j - 1), (i, j + 1)].map(|(a, b)| count(a, b).max(own));
            let mut vertex = |u: f64, v: f64, is_shared: bool| {
                let at = [
                    (i as f64 + u).clamp(lattice.domain[0][0], lattice.domain[1][0]),
                    (j as f64 + v).clamp(lattice.domain[0][1], lattice.domain[1][1]),
                ];
                let mut make = || {
                    let point = surface.patch_point(
                        (j as usize * cx + i as usize) as u32,
                        (at[0] - i as f64) as f32,
                        (at[1] - j as f64) as f32,
                    );
                    mesh.position.push(point.position);
                    mesh.normal.push(point.normal);
                    (mesh.position.len() - 1) as u32
                };
                if is_shared { *shared.entry(at.map(f64::to_bits)).or_insert_with(make) } else { make() }
            };
            for b in 0..own {
                for a in 0..own {
                    quadrilateral(&mut index, [a, b], own, border, &mut vertex);
                }
            }
        }
    }
    // What the domain's edge has folded flat.
    index.retain(|[a, b, c]| a != b && b != c && c != a);
    mesh.index = index;
    Ok(mesh)
}

/// One of a cell's own x own quadrilaterals. Where a border of the cell is finer than its grid, a fan around the
/// quadrilateral's middle over all its border points, counter-clockwise seen from above; else two triangles.
fn quadrilateral(
    index: &mut Vec<[u32; 3]>,
    [a, b]: [u32; 2],
    own: u32,
    [west, east, north, south]: [u32; 4],
    vertex: &mut impl FnMut(f64, f64, bool) -> u32,
) {
    let n = f64::from(own);
    let steps = |on_border: bool, count: u32| if on_border { count / own } else { 1 };
    let [west, east, north, south] =
        [steps(a == 0, west), steps(a + 1 == own, east), steps(b == 0, north), steps(b + 1 == own, south)];
    let shares = |count: u32| (0..count).map(move |k| f64::from(k) / f64::from(count));
    let ring: Vec<u32> = shares(west)
        .map(|v| (0.0, v))
        .chain(shares(south).map(|u| (u, 1.0)))
        .chain(shares(east).map(|v| (1.0, 1.0 - v)))
        .chain(shares(north).map(|u| (1.0 - u, 0.0)))
        .map(|(u, v)| vertex((f64::from(a) + u) / n, (f64::from(b) + v) / n, true))
        .collect();
    if let [p, q, r, s] = ring[..] {
        index.push([p, q, r]);
        index.push([p, r, s]);
        return;
    }
    let middle = vertex((f64::from(a) + 0.5) / n, (f64::from(b) + 0.5) / n, false);
    for (k, &from) in ring.iter().enumerate() {
        index.push([middle, from, ring[(k + 1) % ring.len()]]);
    }
}

/// Samples per cell that keep the mesh within `pixels` of the spline on screen.
///
/// A chord over a cell split n times strays from the curve by |second derivative| / (8 n^2) (de Boor 1978, XII), along
/// u and along v, and the diagonal by half of that again for the twist: 3/8 of the greatest bend over n^2.
/// `metres_per_pixel(x, z)` is the size of a pixel at that place of the local frame.
pub fn screen_samples(
    surface: &SplineSurface,
    pixels: f64,
    most: u32,
    metres_per_pixel: impl Fn(f64, f64, f64) -> f64,
) -> impl Fn(usize, usize) -> u32 {
    let lattice = surface.lattice();
    let [cx, cz] = lattice.cells;
    let order = lattice.order;
    let counts: Vec<u32> = (0..cx * cz)
        .map(|cell| {
            let (i, j) = (cell % cx, cell / cx);
            let window = lattice.window(i, j);
            let mut bend = 0.0f64;
            for b in 0..order {
                for a in 0..order {
                    if a + 2 < order {
                        bend = bend.max((window[b][a] - 2.0 * window[b][a + 1] + window[b][a + 2]).abs());
                        bend = bend.max((window[a][b] - 2.0 * window[a + 1][b] + window[a + 2][b]).abs());
                    }
                    if a + 1 < order && b + 1 < order {
                        // The twist of the patch bends its diagonals.
                        let twist = window[b][a] - window[b][a + 1] - window[b + 1][a] + window[b + 1][a + 1];
                        bend = bend.max(2.0 * twist.abs());
                    }
                }
            }
            let [x, z] = lattice.from_cell([i as f64 + 0.5, j as f64 + 0.5]);
            let allowed = (pixels * metres_per_pixel(x, window[order / 2][order / 2], z)).max(f64::MIN_POSITIVE);
            ((3.0 * bend / (8.0 * allowed)).sqrt().ceil().max(1.0)).min(f64::from(most)) as u32
        })
        .collect();
    // Powers of two, so that a border's finer points include its coarser ones.
    move |i, j| counts[j * cx + i].next_power_of_two()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::SolverKind;
    use crate::simd::SimdLevel;
    use crate::surface::Lattice;

    fn bumps(order: u32, n: usize) -> SplineSurface {
        let heights: Vec<f64> =
            (0..n * n).map(|k| ((k % n) as f64 * 0.9).sin() + ((k / n) as f64 * 0.6).cos()).collect();
        let lattice = Lattice::new(order, [n, n], [0.0; 2], [1.0; 2], &heights, |_| true).unwrap();
        SplineSurface::new(lattice, SolverKind::Univariate, SimdLevel::Portable)
    }

    /// Every edge but the outline's is shared by exactly two triangles: no crack, no overlap.
    fn assert_watertight(mesh: &SurfaceMesh) {
        let mut edges: HashMap<(u32, u32), i32> = HashMap::new();
        for t in &mesh.index {
            for (a, b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
                *edges.entry((a.min(b), a.max(b))).or_default() += if a < b { 1 } else { -1 };
            }
            let [p, q, r] = t.map(|k| mesh.position[k as usize]);
            assert!((q - p).cross(r - p).y > 0.0, "triangles face up");
        }
        let area: f32 = mesh
            .index
            .iter()
            .map(|t| {
                let [p, q, r] = t.map(|k| mesh.position[k as usize]);
                0.5 * (q - p).cross(r - p).y
            })
            .sum();
        let open = edges.values().filter(|&&count| count != 0).count();
        assert!(open > 0 && open < mesh.index.len(), "only the outline is open: {open}");
        assert!((area - 144.0).abs() < 1e-2, "the footprint is covered once: {area}");
    }

    #[test]
    fn vertices_lie_on_the_spline_and_cover_the_domain() {
        for order in 2..=4 {
            let surface = bumps(order, 12);
            let mesh = uniform(&surface, 4).unwrap();
            assert_watertight(&mesh);
            for p in &mesh.position {
                let (height, _) = surface.point(f64::from(p.x), f64::from(p.z)).unwrap();
                assert!((height - f64::from(p.y)).abs() < 1e-5);
            }
        }
    }

    #[test]
    fn adaptive_counts_leave_no_crack() {
        let mesh = adaptive(&bumps(3, 12), |i, j| 1 << ((i * 3 + j) % 4)).unwrap();
        assert_watertight(&mesh);
    }

    #[test]
    fn screen_samples_bring_the_error_under_the_bound() {
        let surface = bumps(3, 12);
        let error = |pixels: f64| {
            let samples = screen_samples(&surface, pixels, 64, |_, _, _| 0.01);
            let mesh = adaptive(&surface, samples).unwrap();
            let mut worst = 0.0f64;
            for t in &mesh.index {
                let middle = t.iter().map(|&k| mesh.position[k as usize].as_dvec3()).sum::<glam::DVec3>() / 3.0;
                let (height, _) = surface.point(middle.x, middle.z).unwrap();
                worst = worst.max((height - middle.y).abs());
            }
            worst
        };
        assert!(error(1.0) <= 0.02 && error(0.25) <= 0.005, "{} {}", error(1.0), error(0.25));
    }

    #[test]
    fn a_mesh_past_32_bit_indices_is_refused() {
        assert!(matches!(uniform(&bumps(3, 12), 10_000), Err(MeshError::TooManyVertices { .. })));
    }
}
