//! What must happen before the crate compiles: nothing, but for the features that stand on foreign headers.
//!
//! `oiio` builds the C++ half of the OpenImageIO bridge. `regen` makes Embree's bindings from its headers. Plain builds use the checked-in `ffi/embree/bindings.rs`.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    #[cfg(feature = "regen")]
    embree::regenerate();
    #[cfg(feature = "oiio")]
    build_oiio();
}

#[cfg(feature = "regen")]
mod embree {
    use std::path::PathBuf;

    /// The types and functions of Embree's C interface, all of which begin like this.
    const NAMES: &str = "(rtc|RTC).*";

    /// Makes the bindings in the build folder, where a test compares them with the checked-in file, and, with
    /// `EMBREE_WRITE=1`, writes them over that file.
    ///
    /// Two steps, because a build that rewrote the file by itself would leave the test nothing to find.
    pub(crate) fn regenerate() {
        println!("cargo::rerun-if-env-changed=EMBREE_INCLUDE");
        println!("cargo::rerun-if-env-changed=EMBREE_WRITE");
        let include = std::env::var("EMBREE_INCLUDE").unwrap_or_else(|_| {
            panic!("feature `regen` needs EMBREE_INCLUDE: the folder that holds embree4/rtcore.h (4.3 or newer)")
        });
        let header = PathBuf::from(&include).join("embree4/rtcore.h");
        assert!(header.is_file(), "EMBREE_INCLUDE={include}: there is no {}", header.display());
        let project = PathBuf::from(std::env::var("CARGO_MANIFEST_DIR").expect("cargo sets CARGO_MANIFEST_DIR"));

        let bindings = bindgen::Builder::default()
            .header(header.to_str().expect("EMBREE_INCLUDE is valid UTF-8"))
            .clang_arg(format!("-I{include}"))
            .allowlist_function(NAMES)
            .allowlist_type(NAMES)
            .allowlist_var(NAMES)
            .default_enum_style(bindgen::EnumVariation::NewType { is_bitfield: false, is_global: false })
            .bitfield_enum("RTCSceneFlags|RTCRayQueryFlags|RTCFeatureFlags|RTCCurveFlags")
            .prepend_enum_name(false)
            .dynamic_library_name("Embree")
            .dynamic_link_require_all(true)
            .wrap_unsafe_ops(true)
            .derive_default(true)
            .layout_tests(true)
            .generate_comments(false)
            .rust_edition(bindgen::RustEdition::Edition2024)
            .formatter(bindgen::Formatter::Rustfmt)
            .rustfmt_configuration_file(Some(project.join("rustfmt.toml")))
            .raw_line(
                "// Made by bindgen from Embree's headers (feature `regen`, `make bindings`); not edited by hand.",
            )
            .generate()
            .expect("bindgen reads Embree's headers");

        let made = PathBuf::from(std::env::var("OUT_DIR").expect("cargo sets OUT_DIR")).join("embree_bindings.rs");
        bindings.write_to_file(&made).expect("the build folder can be written");
        if std::env::var("EMBREE_WRITE").is_ok_and(|value| value == "1") {
            std::fs::copy(&made, project.join("ffi/embree/bindings.rs")).expect("ffi/embree can be written");
        }
    }
}

/// What `build_oiio` is made of.
#[cfg(feature = "oiio")]
const BRIDGE: [&str; 6] =
    ["ffi/oiio.rs", "ffi/oiio.cc", "ffi/oiio.hh", "ffi/oiio_texture.rs", "ffi/oiio_texture.cc", "ffi/oiio_texture.hh"];

/// Compiles `ffi/oiio.cc` and `ffi/oiio_texture.cc` against the OpenImageIO that pkg-config knows of.
#[cfg(feature = "oiio")]
fn build_oiio() {
    for file in BRIDGE {
        println!("cargo:rerun-if-changed={file}");
    }
    println!("cargo:rerun-if-env-changed=PKG_CONFIG_PATH");
    let flags = |what: &str| {
        let answer = std::process::Command::new("pkg-config").args([what, "OpenImageIO"]).output();
        match answer {
            Ok(output) if output.status.success() => String::from_utf8_lossy(&output.stdout).into_owned(),
            other => panic!(
                "the feature `oiio` needs OpenImageIO's development files and pkg-config (Debian, Ubuntu: \
                 libopenimageio-dev pkg-config; Fedora: OpenImageIO-devel; Homebrew: openimageio): {other:?}"
            ),
        }
    };
    let mut build = cxx_build::bridges(["ffi/oiio.rs", "ffi/oiio_texture.rs"]);
    build.files(["ffi/oiio.cc", "ffi/oiio_texture.cc"]).std("c++17");
    for flag in flags("--cflags").split_whitespace() {
        match flag.strip_prefix("-I") {
            // Foreign headers: their warnings are not ours.
            Some(folder) => build.flag("-isystem").flag(folder),
            None => build.flag(flag),
        };
    }
    build.compile("whitewater_oiio");
    for flag in flags("--libs").split_whitespace() {
        if let Some(folder) = flag.strip_prefix("-L") {
            println!("cargo:rustc-link-search=native={folder}");
        } else if let Some(library) = flag.strip_prefix("-l") {
            println!("cargo:rustc-link-lib={library}");
        }
    }
}
