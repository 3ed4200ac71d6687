//! A data window cut into tiles on a grid that is fixed to the full frame, and the threads that work through them.
//!
//! What happens inside a tile is the integrator's matter.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use super::RenderError;
use crate::output::Window;

/// Pixels along a tile's side: 16 samples of a whole tile fill one chunk of rays.
pub const TILE: i32 = 32;

/// The tiles of `data`, row by row. A crop cuts the same tiles that the full frame has.
pub fn tiles(data: Window) -> Vec<Window> {
    // Overscan windows may lie anywhere: 64 bits hold every edge.
    let (x0, y0) = (i64::from(data.x), i64::from(data.y));
    let (x1, y1) = (x0 + i64::from(data.width), y0 + i64::from(data.height));
    let side = i64::from(TILE);
    let mut list = Vec::new();
    let mut y = y0;
    while y < y1 {
        let below = ((y.div_euclid(side) + 1) * side).min(y1);
        let mut x = x0;
        while x < x1 {
            let right = ((x.div_euclid(side) + 1) * side).min(x1);
            list.push(Window { x: x as i32, y: y as i32, width: (right - x) as u32, height: (below - y) as u32 });
            x = right;
        }
        y = below;
    }
    list
}

/// Runs `work` on every item from `threads` threads (0: one per processor), each with a scratch of its own, until `stop`.
///
/// Items are taken in order but finish in any; whatever `work` writes must not depend on that. Returns the scratches.
///
/// *Errors*: [`RenderError::Threads`].
pub(super) fn for_each<T: Sync, S: Send>(
    items: &[T],
    threads: usize,
    stop: &AtomicBool,
    scratch: impl Fn() -> S + Sync,
    work: impl Fn(&T, &mut S) + Sync,
) -> Result<Vec<S>, RenderError> {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .map_err(|error| RenderError::Threads { threads, reason: error.to_string() })?;
    let next = AtomicUsize::new(0);
    Ok(pool.broadcast(|_| {
        let mut own = scratch();
        // Relaxed: the flag carries no data, and a tile more or less does not matter.
        while !stop.load(Ordering::Relaxed) {
            let Some(item) = items.get(next.fetch_add(1, Ordering::Relaxed)) else { break };
            work(item, &mut own);
        }
        own
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_cover_every_pixel_once_and_stay_on_the_grid() {
        let data = Window { x: -5, y: 30, width: 71, height: 40 };
        let mut covered = vec![0; 71 * 40];
        for tile in tiles(data) {
            assert!(tile.width as i32 <= TILE && tile.height as i32 <= TILE);
            assert!(tile.x == data.x || tile.x % TILE == 0);
            assert!(tile.y == data.y || tile.y % TILE == 0);
            for y in tile.y..tile.y + tile.height as i32 {
                for x in tile.x..tile.x + tile.width as i32 {
                    covered[((y - data.y) * 71 + x - data.x) as usize] += 1;
                }
            }
        }
        assert!(covered.iter().all(|&count| count == 1));
    }

    #[test]
    fn stop_leaves_the_rest_undone() {
        let stop = AtomicBool::new(false);
        let items: Vec<u32> = (0..1000).collect();
        let done = for_each(
            &items,
            2,
            &stop,
            || 0,
            |&item, count: &mut u32| {
                *count += 1;
                if item == 10 {
                    stop.store(true, Ordering::Relaxed);
                }
            },
        );
        let done: u32 = done.unwrap().into_iter().sum();
        assert!((11..1000).contains(&done), "{done}");
    }

    #[test]
    fn every_item_is_worked_on_once_by_any_count_of_threads() {
        let items: Vec<u64> = (1..=500).collect();
        for threads in [1, 3] {
            let sums = for_each(&items, threads, &AtomicBool::new(false), || 0, |item, sum| *sum += item).unwrap();
            assert_eq!((sums.len(), sums.into_iter().sum::<u64>()), (threads, 125_250));
        }
    }
}
