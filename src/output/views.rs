//! Two eyes' pictures in one file of one part, by OpenEXR's convention for several views: the attribute `multiView` lists them, and
//! a channel's view stands before its last word. How the eyes stand is the camera's matter.

use super::{Channel, Picture};

/// The views of a stereo pair, the default one first.
pub const EYES: [&str; 2] = ["left", "right"];

/// A channel's name in a view: `R` is the default view's, `right.R` the other's; whatever has a layer is `layer.left.R` and
/// `layer.right.R`.
///
/// *Source*: `insertViewName` in OpenEXR's `ImfMultiView.cpp`. A layer's channel without a view would belong to none.
pub(super) fn insert(name: &str, view: &str) -> String {
    match name.rsplit_once('.') {
        None if view == EYES[0] => name.to_owned(),
        None => format!("{view}.{name}"),
        Some((layer, last)) => format!("{layer}.{view}.{last}"),
    }
}

/// A name without its view, and that view; `None` in a picture of one view.
pub(super) fn split(name: &str, stereo: bool) -> (String, Option<&'static str>) {
    if !stereo {
        return (name.to_owned(), None);
    }
    let mut words: Vec<&str> = name.split('.').collect();
    let at = words.len().wrapping_sub(2);
    let view = words.get(at).and_then(|word| EYES.into_iter().find(|view| view == word));
    if view.is_some() {
        words.remove(at);
    }
    (words.join("."), Some(view.unwrap_or(EYES[0])))
}

/// One picture of two: what the left eye sees and what the right eye sees of the same window.
///
/// Attributes are the left eye's; where the right eye was stands beside them.
pub fn pair(left: Picture, right: Picture) -> Picture {
    debug_assert_eq!((left.display, left.data), (right.display, right.data));
    let named = |picture: Vec<Channel>, view: &'static str| {
        picture.into_iter().map(move |channel| Channel { name: insert(&channel.name, view), ..channel })
    };
    let Picture { display, data, channels, mut metadata } = left;
    let channels = named(channels, EYES[0]).chain(named(right.channels, EYES[1])).collect();
    let eye = right.metadata;
    metadata.seconds += eye.seconds;
    metadata.complete &= eye.complete;
    metadata.right_eye = Some([eye.world_to_camera, eye.world_to_ndc, eye.camera_to_world]);
    Picture { display, data, channels, metadata }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_carry_their_view_as_openexr_puts_it() {
        for (name, left, right) in [
            ("R", "R", "right.R"),
            ("sampleCount", "sampleCount", "right.sampleCount"),
            ("reflection.R", "reflection.left.R", "reflection.right.R"),
            ("ViewLayer.Combined.R", "ViewLayer.Combined.left.R", "ViewLayer.Combined.right.R"),
        ] {
            assert_eq!([insert(name, "left"), insert(name, "right")], [left, right]);
            assert_eq!(split(left, true), (name.to_owned(), Some("left")));
            assert_eq!(split(right, true), (name.to_owned(), Some("right")));
            assert_eq!(split(right, false), (right.to_owned(), None));
        }
    }
}
