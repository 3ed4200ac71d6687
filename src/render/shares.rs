//! A frame's tiles shared out: to several renders of one frame, each of which has a run of them.

use super::{RenderError, tiles::tiles};
use crate::output::{Portion, Window};

/// The tiles of a part of a frame, row by row.
///
/// Shares differ by at most one tile, and together have each tile once.
///
/// *Errors*: [`RenderError::EmptyShare`], if there are more shares than tiles; [`RenderError::EmptyWindow`].
pub fn tiles_of(portion: &Portion) -> Result<Vec<Window>, RenderError> {
    let Portion { index, count, whole, .. } = *portion;
    if whole.width == 0 || whole.height == 0 {
        let Window { x, y, width, height } = whole;
        return Err(RenderError::EmptyWindow { x, y, width, height });
    }
    let all = tiles(whole);
    let total = all.len() as u64;
    if index == 0 || index > count || u64::from(count) > total {
        return Err(RenderError::EmptyShare { index, count, tiles: total });
    }
    let end = |index: u32| (total * u64::from(index) / u64::from(count)) as usize;
    Ok(all[end(index - 1)..end(index)].to_vec())
}

/// The least window around some; none around none.
pub fn around(windows: &[Window]) -> Option<Window> {
    let left = windows.iter().map(|window| window.x).min()?;
    let top = windows.iter().map(|window| window.y).min()?;
    let right = windows.iter().map(|window| i64::from(window.x) + i64::from(window.width)).max()?;
    let below = windows.iter().map(|window| i64::from(window.y) + i64::from(window.height)).max()?;
    let side = |from: i32, to: i64| (to - i64::from(from)) as u32;
    Some(Window { x: left, y: top, width: side(left, right), height: side(top, below) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_have_each_tile_once_and_are_alike() {
        let whole = Window { x: -5, y: 30, width: 171, height: 140 };
        let all = tiles(whole);
        for count in [1, 2, 3, 7, all.len() as u32] {
            let shares = (1..=count).map(|index| tiles_of(&Portion { index, count, whole, samples: None }).unwrap());
            let shares: Vec<_> = shares.collect();
            assert_eq!(shares.concat(), all);
            let sizes: Vec<_> = shares.iter().map(Vec::len).collect();
            assert!(sizes.iter().max().unwrap() - sizes.iter().min().unwrap() <= 1, "{sizes:?}");
        }
        let count = all.len() as u32 + 1;
        let error = tiles_of(&Portion { index: 1, count, whole, samples: None }).unwrap_err();
        assert!(error.to_string().contains(&all.len().to_string()), "{error}");
        assert_eq!(around(&all), Some(whole));
        assert_eq!(around(&[]), None);
    }
}
