#!/usr/bin/env bash
# Puts the pinned Open Image Denoise into third_party/oidn/lib, unless the program would find one without it.
#
# The wheel holds the plain C library for every kind of device; what denoising on the processor needs is kept, and nothing
# is installed anywhere else. It appears under its final name only when its hash is right and it is whole, so an
# interrupted or falsified download leaves nothing behind.
set -euo pipefail

version=2.5.1.0
sha256=32ad13368f8de1ef63001942ad05b02a00cd732d1206d97f352d3a3f606d823e

project=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
parent=$project/third_party/oidn
name=libOpenImageDenoise.so.2
library=$parent/lib/$name

# The places where the program looks (ffi/oidn/loader.rs), in its order.
if [[ -n ${WHITEWATER_OIDN:-} ]]; then
    if [[ -f $WHITEWATER_OIDN || -f $WHITEWATER_OIDN/$name ]]; then
        echo "Open Image Denoise: $WHITEWATER_OIDN (WHITEWATER_OIDN)"
        exit 0
    fi
    echo "Open Image Denoise: WHITEWATER_OIDN=$WHITEWATER_OIDN is neither a library nor a folder that holds $name" >&2
    exit 1
fi
for place in "$project/target/lib/$name" "$library"; do
    if [[ -f $place ]]; then
        echo "Open Image Denoise: $place"
        exit 0
    fi
done
python=$(command -v python3 || true)
# Asking the library itself whether it loads and can work on this processor.
system_version() {
    "$python" - 2>/dev/null <<'PYTHON'
import ctypes
oidn = ctypes.CDLL("libOpenImageDenoise.so.2")
oidn.oidnNewDevice.restype = ctypes.c_void_p
oidn.oidnGetDeviceInt.argtypes = [ctypes.c_void_p, ctypes.c_char_p]
device = oidn.oidnNewDevice(1)
if device:
    print(oidn.oidnGetDeviceInt(device, b"version"))
PYTHON
}
if [[ -n $python ]] && found=$(system_version) && ((found >= 20000 && found < 30000)); then
    echo "Open Image Denoise: the system's $name, version $found"
    exit 0
fi

if [[ $(uname -sm) != "Linux x86_64" ]]; then
    echo "Open Image Denoise: no library for $(uname -sm) is pinned here. Install the system's 2.0 or newer" >&2
    echo "  (Fedora: oidn; Homebrew: open-image-denoise), or name one by WHITEWATER_OIDN." >&2
    exit 1
fi
if [[ -z $python ]] || ! "$python" -m pip --version >/dev/null 2>&1; then
    echo "Open Image Denoise: python3 with pip is needed to fetch it (Debian, Ubuntu, Fedora: python3-pip)" >&2
    exit 1
fi

mkdir -p "$parent"
work=$(mktemp -d "$parent/fetch.XXXXXX")
# A failed fetch also takes back the folders that it made; rmdir keeps those that hold anything.
trap 'rm -rf "$work"; rmdir "$parent" "$project/third_party" 2>/dev/null || true' EXIT
echo "pyoidn==$version --hash=sha256:$sha256" >"$work/requirements.txt"
"$python" -m pip download --quiet --disable-pip-version-check --no-deps --require-hashes --only-binary=:all: \
    --python-version 3.11 --implementation cp --abi cp311 --abi none --platform manylinux2014_x86_64 \
    --dest "$work" --requirement "$work/requirements.txt"
"$python" - "$work" <<'PYTHON'
import glob, os, sys, zipfile

work = sys.argv[1]
(wheel,) = glob.glob(os.path.join(work, "pyoidn-*.whl"))
# The library, its core with the trained weights, the processor's device, and the thread pool that it stands on.
wanted = ("libOpenImageDenoise.so.2", "libOpenImageDenoise_core.so.", "libOpenImageDenoise_device_cpu.so.", "libtbb.so.12")
os.mkdir(os.path.join(work, "lib"))
found = set()
with zipfile.ZipFile(wheel) as archive:
    for path in archive.namelist():
        name = os.path.basename(path)
        for start in wanted:
            # Links are copies in a wheel: of libtbb.so.12 and libtbb.so.12.19, the name that is asked for is enough.
            if path.startswith("pyoidn/oidn/lib/") and (name == start or start.endswith(".") and name.startswith(start)):
                with open(os.path.join(work, "lib", name), "wb") as file:
                    file.write(archive.read(path))
                found.add(start)
missing = sorted(set(wanted) - found)
if missing:
    sys.exit(f"Open Image Denoise: the wheel does not hold {', '.join(missing)}")
PYTHON
rm -rf "$parent/lib"
mv -T "$work/lib" "$parent/lib"
echo "Open Image Denoise: fetched $version into $parent/lib"
