//! Checkpoints of parts of one picture → the picture: tiles side by side, samples in their order, to the bits of a render
//! that was never divided.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use super::{Checkpoint, CheckpointError};
use crate::output::{Metadata, Picture, Window};
use crate::render::{
    film::{Film, FilmTile},
    shares::tiles_of,
    tiles::tiles,
    wave::is_done,
};

/// The sums of a tile that one part has.
struct Piece<'a> {
    part: usize,
    tile: usize,
    first_sample: u32,
    path: &'a Path,
}

impl Checkpoint {
    /// Joins parts of one picture. What is missing or not finished is an error, unless `partial`: then it is left 0 or as it
    /// is, and the picture says that it is not complete.
    ///
    /// *Errors*: [`CheckpointError::Join`]: parts of different pictures, tiles or samples that two parts have or that none
    /// has; [`CheckpointError::Damaged`].
    pub fn join(parts: &[(PathBuf, Self)], partial: bool) -> Result<Picture, CheckpointError> {
        let refused = |path: &Path, what: String| CheckpointError::Join { path: path.to_owned(), what };
        let Some(((first_path, first), others)) = parts.split_first() else {
            return Err(refused(
                Path::new(""),
                "there is nothing to join; expected at least one checkpoint".to_owned(),
            ));
        };
        for (path, other) in others {
            if let Some(what) = first.stranger(other) {
                return Err(refused(path, format!("{what} (as {} has)", first_path.display())));
            }
        }
        let header = &first.header;
        let whole = header.portion.whole;
        let windows = tiles(whole);
        let place: HashMap<(i32, i32), usize> =
            windows.iter().enumerate().map(|(index, window)| ((window.x, window.y), index)).collect();
        let mut pieces: Vec<Vec<Piece>> = windows.iter().map(|_| Vec::new()).collect();
        for (part, (path, checkpoint)) in parts.iter().enumerate() {
            let own = tiles_of(&checkpoint.header.portion).map_err(|error| refused(path, error.to_string()))?;
            let first_sample = checkpoint.header.plan.range[0];
            for (tile, window) in own.iter().enumerate() {
                pieces[place[&(window.x, window.y)]].push(Piece { part, tile, first_sample, path });
            }
        }
        let mut film = Film::new(whole, &header.groups, header.view.names.mattes());
        let (mut pixels, mut lacking, mut first_lacking) = (Vec::new(), 0, None);
        for (window, pieces) in windows.iter().zip(&mut pieces) {
            pieces.sort_by_key(|piece| piece.first_sample);
            let mut total = FilmTile::default();
            total.reset(*window, header.groups.len());
            let (mut samples, mut has_all) = (0, true);
            for piece in pieces.iter() {
                let (path, checkpoint) = &parts[piece.part];
                let Window { x, y, .. } = *window;
                if piece.first_sample < samples {
                    return Err(refused(
                        piece.path,
                        format!(
                            "another part has the samples from {} on of the tile at {x},{y} as well; expected each once",
                            piece.first_sample
                        ),
                    ));
                }
                has_all &= piece.first_sample == samples;
                samples = checkpoint.header.plan.range[1];
                let Some(blocks) = checkpoint.blocks(path, piece.tile)? else {
                    has_all = false;
                    continue;
                };
                for block in &blocks {
                    total.join(block);
                }
            }
            if !(has_all && is_done(&header.plan, &total)) {
                lacking += 1;
                first_lacking.get_or_insert(*window);
            }
            total.resolve(&header.view, &mut pixels);
            if total.greatest_samples() > 0 {
                film.place(*window, &pixels);
            }
        }
        if let (Some(Window { x, y, .. }), false) = (first_lacking, partial) {
            return Err(refused(
                first_path,
                format!(
                    "{lacking} of {} tiles are missing, or have not all their samples, in this and the other parts, the first \
                     at {x},{y}; expected all (or --partial)",
                    windows.len()
                ),
            ));
        }
        let seconds = parts.iter().map(|(_, part)| part.header.metadata.seconds).sum();
        let metadata = Metadata { seconds, complete: lacking == 0, portion: None, ..header.metadata.clone() };
        let [width, height] = header.size;
        Ok(Picture { display: (width, height), data: whole, channels: film.into_channels(), metadata })
    }

    /// What of another part shows that it is not of the same picture.
    fn stranger(&self, other: &Self) -> Option<String> {
        let (ours, theirs) = (&self.header, &other.header);
        let differ = |what: &str, found: String, expected: String| {
            (found != expected).then(|| format!("{what} {found}; expected {expected}"))
        };
        let plan = |plan| format!("{:?}", super::super::plan::Plan { range: [0, 0], ..plan });
        let whole = |window: Window| format!("{}x{} at {},{}", window.width, window.height, window.x, window.y);
        differ("it is of frame", theirs.frame.to_string(), ours.frame.to_string())
            .or_else(|| differ("its frame has the pixels", format!("{:?}", theirs.size), format!("{:?}", ours.size)))
            .or_else(|| differ("its whole window is", whole(theirs.portion.whole), whole(ours.portion.whole)))
            .or_else(|| differ("it is of the scene", theirs.identity.clone(), ours.identity.clone()))
            .or_else(|| differ("its light groups are", theirs.groups.join(", "), ours.groups.join(", ")))
            .or_else(|| {
                (ours.view.names != theirs.view.names).then(|| "it tells other things apart by mattes".to_owned())
            })
            .or_else(|| differ("its samples are", plan(theirs.plan), plan(ours.plan)))
    }
}
