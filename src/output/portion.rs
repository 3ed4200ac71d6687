//! Which part of a frame a picture is: a share of its tiles, a range of its samples. As attributes it is two short texts.
//!
//! Which tiles a share has is the renderer's matter.

use super::Window;

/// A part of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Portion {
    /// Which share of the tiles, from 1.
    pub index: u32,
    /// How many shares there are.
    pub count: u32,
    /// Data window of the whole picture.
    pub whole: Window,
    /// First sample of each pixel, and the one after the last; `None` for all.
    pub samples: Option<[u32; 2]>,
}

impl Portion {
    /// `INDEX/COUNT X0,Y0,X1,Y1`: the share, and the window of the whole (X1, Y1 exclusive), as `--crop` has it.
    pub fn tiles(&self) -> String {
        let Window { x, y, width, height } = self.whole;
        let (right, below) = (i64::from(x) + i64::from(width), i64::from(y) + i64::from(height));
        format!("{}/{} {x},{y},{right},{below}", self.index, self.count)
    }

    /// `FIRST-END` (END exclusive), if it has not all samples.
    pub fn sample_range(&self) -> Option<String> {
        self.samples.map(|[first, end]| format!("{first}-{end}"))
    }

    /// From both texts; `None` if they are not of that form.
    pub fn parse(tiles: &str, sample_range: Option<&str>) -> Option<Self> {
        let (share, corners) = tiles.split_once(' ')?;
        let (index, count) = share.split_once('/')?;
        let (index, count) = (index.parse().ok()?, count.parse().ok()?);
        let corners: Vec<i32> = corners.split(',').map(|number| number.parse().ok()).collect::<Option<_>>()?;
        let &[x, y, right, below] = corners.as_slice() else { return None };
        let side = |from: i32, to: i32| {
            u32::try_from(i64::from(to) - i64::from(from)).ok().filter(|side| (1..1 << 30).contains(side))
        };
        let whole = Window { x, y, width: side(x, right)?, height: side(y, below)? };
        let samples = match sample_range {
            None => None,
            Some(range) => {
                let (first, end) = range.split_once('-')?;
                let range: [u32; 2] = [first.parse().ok()?, end.parse().ok()?];
                if range[0] >= range[1] {
                    return None;
                }
                Some(range)
            }
        };
        Some(Self { index, count, whole, samples }).filter(|portion| (1..=portion.count).contains(&portion.index))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_read_back_and_nonsense_is_refused() {
        let whole = Window { x: -7, y: 3, width: 40, height: 20 };
        let portion = Portion { index: 2, count: 4, whole, samples: Some([16, 32]) };
        assert_eq!(portion.tiles(), "2/4 -7,3,33,23");
        assert_eq!(Portion::parse(&portion.tiles(), portion.sample_range().as_deref()), Some(portion));
        for (tiles, range) in [
            ("5/4 0,0,4,4", None),
            ("0/4 0,0,4,4", None),
            ("1/4 0,0,0,4", None),
            ("1/4 0,0,4", None),
            ("1/4 -2147483648,0,2147483647,4", None),
            ("1/1 0,0,4,4", Some("4-4")),
            ("1/1 0,0,4,4", Some("x")),
        ] {
            assert_eq!(Portion::parse(tiles, range), None, "{tiles} {range:?}");
        }
    }
}
