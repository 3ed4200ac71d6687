//! Finished pictures of parts: whether they belong together, and their tiles copied to their places.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use super::{MergeError, samples};
use crate::output::{self, Channel, Metadata, Picture, Portion, Window};
use crate::render::{tiles, tiles_of};

/// A part as read.
pub(super) struct Part {
    pub(super) path: PathBuf,
    pub(super) picture: Picture,
    pub(super) portion: Portion,
    /// First sample, and the one after the last.
    range: [u32; 2],
}

/// Reads a part.
pub(super) fn read(path: &Path) -> Result<Part, MergeError> {
    let picture = output::read_exr(path)?;
    let metadata = &picture.metadata;
    if metadata.scene_hash.is_empty() {
        return Err(MergeError::Unfit {
            path: path.to_owned(),
            what: "has no attribute `whitewater:scene`; expected a picture that whitewater has rendered".to_owned(),
        });
    }
    let whole = Portion { index: 1, count: 1, whole: picture.data, samples: None };
    let portion = metadata.portion.unwrap_or(whole);
    let range = portion.samples.unwrap_or([0, metadata.samples]);
    Ok(Part { path: path.to_owned(), portion, range, picture })
}

/// Joins parts of one picture.
pub(super) fn join(parts: &[Part], partial: bool) -> Result<Picture, MergeError> {
    let (first, others) = parts.split_first().ok_or(MergeError::Nothing)?;
    for other in others {
        if let Some(what) = stranger(other, first) {
            let what = format!("{what}, as {} has", first.path.display());
            return Err(MergeError::Unfit { path: other.path.clone(), what });
        }
    }
    if let Some(stopped) = parts.iter().find(|part| !part.picture.metadata.complete && !partial) {
        return Err(MergeError::Unfit {
            path: stopped.path.clone(),
            what: "has `whitewater:complete` 0: its render was stopped; expected a whole part, or --partial".to_owned(),
        });
    }
    let whole = first.portion.whole;
    let windows = tiles(whole);
    let place: HashMap<(i32, i32), usize> =
        windows.iter().enumerate().map(|(index, window)| ((window.x, window.y), index)).collect();
    let mut holders: Vec<Vec<&Part>> = windows.iter().map(|_| Vec::new()).collect();
    for part in parts {
        let unfit = |what: String| MergeError::Unfit { path: part.path.clone(), what };
        let own = tiles_of(&part.portion).map_err(|error| unfit(format!("says of itself: {error}")))?;
        let data = part.picture.data;
        if let Some(outside) = own.iter().find(|tile| !is_inside(**tile, data)) {
            return Err(unfit(format!("lacks pixels of its tile at {},{}: it was cut", outside.x, outside.y)));
        }
        own.iter().for_each(|tile| holders[place[&(tile.x, tile.y)]].push(part));
    }
    let blank = |channel: &Channel| Channel { samples: vec![0.0; whole.area()], ..channel.clone() };
    let mut channels: Vec<Channel> = first.picture.channels.iter().map(blank).collect();
    let (mut missing, mut first_missing) = (0, None);
    for (window, holders) in windows.iter().zip(&mut holders) {
        holders.sort_by_key(|part| part.range[0]);
        let mut reached = 0;
        let mut gap = false;
        for part in holders.iter() {
            let [start, end] = part.range;
            if start < reached {
                let Window { x, y, .. } = *window;
                let what = format!(
                    "has the samples {start}-{end} of the tile at {x},{y}, of which another part has those up to {reached}; \
                     expected each once"
                );
                return Err(MergeError::Unfit { path: part.path.clone(), what });
            }
            gap |= start > reached;
            reached = end;
        }
        if gap || reached < first.picture.metadata.samples {
            missing += 1;
            first_missing.get_or_insert((*window, holders.iter().map(|part| part.range).collect::<Vec<_>>()));
        }
        match holders.as_slice() {
            [] => {}
            [part] => copy(part, *window, whole, &mut channels),
            several => samples::join(several, *window, whole, &mut channels)?,
        }
    }
    if let (Some((Window { x, y, .. }, ranges)), false) = (first_missing, partial) {
        let shown: Vec<String> = ranges.iter().map(|[start, end]| format!("{start}-{end}")).collect();
        let samples = match shown.as_slice() {
            [] => String::new(),
            _ => format!(" (of {} samples it has {})", first.picture.metadata.samples, shown.join(", ")),
        };
        return Err(MergeError::Missing { missing, tiles: windows.len(), x, y, samples });
    }
    let seconds = parts.iter().map(|part| part.picture.metadata.seconds).sum();
    let complete = missing == 0 && parts.iter().all(|part| part.picture.metadata.complete);
    let metadata = Metadata { seconds, complete, portion: None, ..first.picture.metadata.clone() };
    Ok(Picture { display: first.picture.display, data: whole, channels, metadata })
}

fn is_inside(window: Window, data: Window) -> bool {
    let right = |window: Window| i64::from(window.x) + i64::from(window.width);
    let below = |window: Window| i64::from(window.y) + i64::from(window.height);
    window.x >= data.x && window.y >= data.y && right(window) <= right(data) && below(window) <= below(data)
}

/// Where a row of a window begins among the samples of a channel over `data`.
pub(super) fn row_start(window: Window, row: u32, data: Window) -> usize {
    let x = (i64::from(window.x) - i64::from(data.x)) as usize;
    let y = (i64::from(window.y) - i64::from(data.y)) as usize + row as usize;
    y * data.width as usize + x
}

fn copy(part: &Part, window: Window, whole: Window, channels: &mut [Channel]) {
    let width = window.width as usize;
    for (to, from) in channels.iter_mut().zip(&part.picture.channels) {
        for row in 0..window.height {
            let (at, source) = (row_start(window, row, whole), row_start(window, row, part.picture.data));
            to.samples[at..at + width].copy_from_slice(&from.samples[source..source + width]);
        }
    }
}

/// What of a part shows that it is of another picture.
fn stranger(part: &Part, first: &Part) -> Option<String> {
    let (metadata, expected) = (&part.picture.metadata, &first.picture.metadata);
    let differ = |what: &str, found: String, expected: String| {
        (found != expected).then(|| format!("has {what} {found}; expected {expected}"))
    };
    let window = |window: Window| format!("{}x{} at {},{}", window.width, window.height, window.x, window.y);
    let layers = |picture: &Picture| {
        let names: Vec<String> = picture.channels.iter().map(|c| format!("{}:{:?}", c.name, c.sample_type)).collect();
        names.join(" ")
    };
    let size = |(width, height): (u32, u32)| format!("{width}x{height}");
    // All that is left, so that nothing which a file says is lost by taking it from the first.
    let rest = |metadata: &Metadata| {
        format!("{:?}", Metadata { seconds: 0.0, complete: true, portion: None, ..metadata.clone() })
    };
    differ("`whitewater:scene`", metadata.scene_hash.clone(), expected.scene_hash.clone())
        .or_else(|| differ("frame", metadata.frame.to_string(), expected.frame.to_string()))
        .or_else(|| differ("a frame of", size(part.picture.display), size(first.picture.display)))
        .or_else(|| differ("the whole window", window(part.portion.whole), window(first.portion.whole)))
        .or_else(|| differ("`whitewater:samples`", metadata.samples.to_string(), expected.samples.to_string()))
        .or_else(|| differ("the channels", layers(&part.picture), layers(&first.picture)))
        .or_else(|| differ("the attributes", rest(metadata), rest(expected)))
}
