#!/usr/bin/env bash
# Puts the pinned Embree library into third_party/embree/lib, unless the program would find one without it.
#
# The wheel holds the plain C library; nothing of it is installed anywhere else. It appears under its final name only
# when its hash is right and it is whole, so an interrupted or falsified download leaves nothing behind.
set -euo pipefail

version=4.4.0.post1
sha256=2cd0f7d5c6342e6247e31f700761689cae7829454d8c6de0c41e62124a023e1f

project=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
parent=$project/third_party/embree
library=$parent/lib/libembree4.so.4

# The places where the program looks (ffi/embree/loader.rs), in its order.
if [[ -n ${WHITEWATER_EMBREE:-} ]]; then
    if [[ -f $WHITEWATER_EMBREE || -f $WHITEWATER_EMBREE/libembree4.so.4 ]]; then
        echo "Embree: $WHITEWATER_EMBREE (WHITEWATER_EMBREE)"
        exit 0
    fi
    echo "Embree: WHITEWATER_EMBREE=$WHITEWATER_EMBREE is neither a library nor a folder that holds libembree4.so.4" >&2
    exit 1
fi
for place in "$project/target/lib/libembree4.so.4" "$library"; do
    if [[ -f $place ]]; then
        echo "Embree: $place"
        exit 0
    fi
done
python=$(command -v python3 || true)
# Asking the library itself: a system may still carry 4.0 to 4.2, whose structures differ, and the program refuses those.
system_version() {
    "$python" - 2>/dev/null <<'PYTHON'
import ctypes
embree = ctypes.CDLL("libembree4.so.4")
embree.rtcNewDevice.restype = ctypes.c_void_p
embree.rtcGetDeviceProperty.argtypes = [ctypes.c_void_p, ctypes.c_int]
embree.rtcGetDeviceProperty.restype = ctypes.c_ssize_t
print(embree.rtcGetDeviceProperty(embree.rtcNewDevice(None), 0))
PYTHON
}
if [[ -n $python ]] && found=$(system_version) && ((found >= 40300 && found < 50000)); then
    echo "Embree: the system's libembree4.so.4, version $found"
    exit 0
fi

if [[ $(uname -sm) != "Linux x86_64" ]]; then
    echo "Embree: no library for $(uname -sm) is pinned here. Install the system's Embree 4.3 or newer" >&2
    echo "  (Debian, Ubuntu: libembree4-4; Fedora: embree; Homebrew: embree), or name one by WHITEWATER_EMBREE." >&2
    exit 1
fi
if [[ -z $python ]] || ! "$python" -m pip --version >/dev/null 2>&1; then
    echo "Embree: python3 with pip is needed to fetch it (Debian, Ubuntu: python3-pip; Fedora: python3-pip)" >&2
    exit 1
fi

mkdir -p "$parent"
work=$(mktemp -d "$parent/fetch.XXXXXX")
# A failed fetch also takes back the folders that it made; rmdir keeps those that hold anything.
trap 'rm -rf "$work"; rmdir "$parent" "$project/third_party" 2>/dev/null || true' EXIT
echo "embreex==$version --hash=sha256:$sha256" >"$work/requirements.txt"
"$python" -m pip download --quiet --disable-pip-version-check --no-deps --require-hashes --only-binary=:all: \
    --python-version 3.11 --implementation cp --abi cp311 --platform manylinux_2_28_x86_64 \
    --dest "$work" --requirement "$work/requirements.txt"
"$python" - "$work" <<'PYTHON'
import glob, os, sys, zipfile

work = sys.argv[1]
(wheel,) = glob.glob(os.path.join(work, "embreex-*.whl"))
os.mkdir(os.path.join(work, "lib"))
with zipfile.ZipFile(wheel) as archive:
    for name in archive.namelist():
        if name.startswith("embreex.libs/") and not name.endswith("/"):
            with open(os.path.join(work, "lib", os.path.basename(name)), "wb") as file:
                file.write(archive.read(name))
PYTHON
embree=("$work"/lib/libembree4-*.so.4)
if [[ ! -f ${embree[0]} ]]; then
    echo "Embree: the wheel holds no libembree4-*.so.4" >&2
    exit 1
fi
ln -s "$(basename "${embree[0]}")" "$work/lib/libembree4.so.4"
rm -rf "$parent/lib"
mv -T "$work/lib" "$parent/lib"
echo "Embree: fetched $version into $parent/lib"
