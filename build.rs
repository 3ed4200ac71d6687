//! Builds what is not Rust: with the feature `oiio`, the C++ half of the OpenImageIO bridge.

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    #[cfg(feature = "oiio")]
    build_oiio();
}

/// Compiles `ffi/oiio.cc` against the OpenImageIO that pkg-config knows of.
#[cfg(feature = "oiio")]
fn build_oiio() {
    for file in ["ffi/oiio.rs", "ffi/oiio.cc", "ffi/oiio.hh"] {
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
    let mut build = cxx_build::bridge("ffi/oiio.rs");
    build.file("ffi/oiio.cc").std("c++17");
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
