//! OpenImageIO: the types and functions that cross into `oiio.cc`, by cxx. Every function that C++ could fail in
//! returns a `Result`. What the rest of the crate sees is in `output::oiio`.

#[allow(unreachable_pub)] // cxx makes the enum and struct public, whatever is written here.
#[cxx::bridge(namespace = "whitewater")]
pub(crate) mod bridge {
    /// One channel of a part.
    struct OiioChannel {
        /// Full name.
        name: String,
        /// Half, or else float.
        half: bool,
    }

    /// What an attribute holds.
    enum OiioKind {
        Text,
        /// Several texts, one a line.
        Texts,
        Integer,
        Float,
        Vector2,
        Matrix,
        Rational,
        TimeCode,
        Chromaticities,
        /// An attribute that OpenImageIO would add by itself and shall not.
        Suppressed,
    }

    /// One attribute, under OpenImageIO's name for it.
    struct OiioAttribute {
        name: String,
        kind: OiioKind,
        text: String,
        integers: Vec<i32>,
        floats: Vec<f32>,
    }

    /// One part (OpenImageIO: subimage) of a file.
    struct OiioPart {
        name: String,
        x: i32,
        y: i32,
        width: u32,
        height: u32,
        display_width: u32,
        display_height: u32,
        channels: Vec<OiioChannel>,
        compression: String,
        attributes: Vec<OiioAttribute>,
    }

    /// A deep file: its one part, how many samples each pixel has, and all of them, channel by channel within each.
    struct OiioDeep {
        part: OiioPart,
        counts: Vec<u32>,
        samples: Vec<f32>,
    }

    unsafe extern "C++" {
        include!("whitewater/ffi/oiio.hh");

        type OiioWriter;
        fn oiio_create(path: &str, parts: &[OiioPart]) -> Result<UniquePtr<OiioWriter>>;
        fn write_rows(self: Pin<&mut OiioWriter>, first: u32, samples: &[f32]) -> Result<()>;
        fn next_part(self: Pin<&mut OiioWriter>) -> Result<()>;
        fn close(self: Pin<&mut OiioWriter>) -> Result<()>;

        type OiioReader;
        fn oiio_open(path: &str) -> Result<UniquePtr<OiioReader>>;
        fn parts(self: &OiioReader) -> Result<u32>;
        fn describe(self: &OiioReader, part: u32) -> Result<OiioPart>;
        fn samples(self: &OiioReader, part: u32) -> Result<Vec<f32>>;

        fn oiio_write_deep(path: &str, part: &OiioPart, counts: &[u32], samples: &[f32]) -> Result<()>;
        fn oiio_read_deep(path: &str) -> Result<OiioDeep>;
    }
}
