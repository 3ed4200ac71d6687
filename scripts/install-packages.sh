#!/usr/bin/env bash
# Installs what the feature `oiio` needs (OpenImageIO's headers, library and oiiotool, a C++ compiler) where apt-get is
# there and we may use it; otherwise names the packages and goes on: if they are really missing, the build says so next.
set -euo pipefail

# valgrind counts instructions for `make count`; nothing is built with it.
packages=(g++ pkg-config libopenimageio-dev openimageio-tools valgrind)

missing=()
if command -v dpkg-query >/dev/null; then
    for package in "${packages[@]}"; do
        status=$(dpkg-query --show --showformat='${db:Status-Status}' "$package" 2>/dev/null || true)
        [[ $status == installed ]] || missing+=("$package")
    done
    if ((${#missing[@]} == 0)); then
        echo "Packages: ${packages[*]} (installed)"
        exit 0
    fi
fi

install=()
if command -v apt-get >/dev/null; then
    if ((EUID == 0)); then
        install=(env DEBIAN_FRONTEND=noninteractive apt-get)
    elif command -v sudo >/dev/null && sudo -n true 2>/dev/null; then
        install=(sudo -n env DEBIAN_FRONTEND=noninteractive apt-get)
    fi
fi
if ((${#install[@]})); then
    echo "Packages: installing ${missing[*]}"
    # Lists may be absent (fresh containers) or stale; without recommended packages, since nothing here needs them.
    "${install[@]}" update -qq || true
    "${install[@]}" install -y -qq --no-install-recommends "${missing[@]}" >/dev/null
    exit 0
fi

echo "Packages: OpenImageIO is needed for this build. Not installing it by myself; please install" >&2
echo "  Debian, Ubuntu: sudo apt-get install ${packages[*]}" >&2
echo "  Fedora:         sudo dnf install gcc-c++ pkgconf OpenImageIO-devel OpenImageIO-utils valgrind" >&2
echo "  Homebrew:       brew install pkgconf openimageio" >&2
echo "Going on in case it is already there." >&2
