"""Makes the pool's frames and tiles, the same bytes each time: `python3 make_pool.py` in this folder (needs numpy).

A pool of 6 x 4 m, 2 m deep, in a deck 25 cm over the water. Columns of 6.25 cm. The water is a sum of deep-water wave
trains and of a ring that runs outward from a drop, a few centimetres high: steep enough to focus the sun near the
floor, gentle enough for a spline of order 3.
"""

import struct
import zipfile

import numpy as np

WIDTH = 0.0625  # of a column
HALF = (3.0, 2.0)  # of the pool, x and z
DECK = 0.75  # beyond it, to the domain's edge
DEPTH = 2.0
RIM = 0.25  # of the deck over the still water
FPS = 24.0
FRAMES = 3

# Height (m), length (m), direction (degrees from x), phase.
TRAINS = [
    (0.014, 1.70, 20, 0.0),
    (0.009, 0.95, -35, 1.3),
    (0.007, 0.66, 75, 2.1),
    (0.0045, 0.50, -80, 4.0),
    (0.003, 0.41, 140, 0.7),
]
RING = (0.009, 0.45, (0.9, -0.4), 1.2)  # height, length, centre, seconds since the drop at frame 0


def omega(k):
    return np.sqrt(9.81 * k * np.tanh(k * DEPTH))


def water(x, z, time):
    height = np.zeros_like(x)
    for amplitude, length, angle, phase in TRAINS:
        k = 2 * np.pi / length
        along = x * np.cos(np.radians(angle)) + z * np.sin(np.radians(angle))
        height += amplitude * np.sin(k * along - omega(k) * time + phase)
    amplitude, length, centre, since = RING
    k = 2 * np.pi / length
    r = np.hypot(x - centre[0], z - centre[1])
    # The crests run at the phase speed, their envelope at half of it, as in deep water.
    front = 0.5 * omega(k) / k * (time + since)
    height += amplitude * np.cos(k * r - omega(k) * (time + since)) * np.exp(-(((r - front) / 0.45) ** 2))
    return height


def frame(number):
    size = [round(2 * (half + DECK) / WIDTH) for half in HALF]
    first = [-(half + DECK) + 0.5 * WIDTH for half in HALF]
    x, z = np.meshgrid(first[0] + WIDTH * np.arange(size[0]), first[1] + WIDTH * np.arange(size[1]))
    # The floor goes on for two columns behind the tiled walls, so that the bed's own slope is out of sight.
    inside = (np.abs(x) < HALF[0] + 2 * WIDTH) & (np.abs(z) < HALF[1] + 2 * WIDTH)
    base = np.where(inside, -DEPTH, RIM - 0.01).astype("f4")
    time = number / FPS
    # To a hundredth of a millimetre: that compresses well and no caustic shows it.
    top = np.where(inside, np.round(water(x, z, time), 5), base).astype("f4")
    arrays = {
        "time": np.array(time),
        "origin": np.array(first),
        "width": np.array([WIDTH, WIDTH]),
        "base": base,
        "top": top,
    }
    # numpy.savez_compressed writes today's date; this writes the same bytes every day.
    with zipfile.ZipFile(f"time{number:03}.npz", "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name, array in arrays.items():
            entry = zipfile.ZipInfo(name + ".npy", (1980, 1, 1, 0, 0, 0))
            entry.compress_type = zipfile.ZIP_DEFLATED
            with archive.open(entry, "w") as file:
                np.lib.format.write_array(file, np.asarray(array, order="C"))


class Mesh:
    """Quads with a colour each (sRGB bytes), corners counter-clockwise seen from outside."""

    def __init__(self):
        self.vertices = []
        self.faces = []

    def quad(self, corner, along, up, colour):
        corner, along, up = (np.array(v, dtype=float) for v in (corner, along, up))
        first = len(self.vertices)
        for place in (corner, corner + along, corner + along + up, corner + up):
            self.vertices.append((*place, *colour))
        self.faces.append((first, first + 1, first + 2, first + 3))

    def tiles(self, corner, along, up, size, joint, lift, colours, grout):
        """A tiled rectangle: grout, and tiles `lift` before it; along x up points to who looks at it."""
        corner, along, up = (np.array(v, dtype=float) for v in (corner, along, up))
        lengths = [np.linalg.norm(along), np.linalg.norm(up)]
        a, b = along / lengths[0], up / lengths[1]
        self.quad(corner, along, up, grout)
        out = np.cross(a, b) * lift
        for j in range(round(lengths[1] / size)):
            for i in range(round(lengths[0] / size)):
                start = corner + out + a * (i * size + joint / 2) + b * (j * size + joint / 2)
                self.quad(start, a * (size - joint), b * (size - joint), colours(i, j))

    def write(self, path):
        with open(path, "wb") as file:
            file.write(
                (
                    "ply\nformat binary_little_endian 1.0\n"
                    f"element vertex {len(self.vertices)}\n"
                    "property float x\nproperty float y\nproperty float z\n"
                    "property uchar red\nproperty uchar green\nproperty uchar blue\n"
                    f"element face {len(self.faces)}\nproperty list uchar uint vertex_indices\nend_header\n"
                ).encode()
            )
            for vertex in self.vertices:
                file.write(struct.pack("<3f3B", *vertex))
            for face in self.faces:
                file.write(struct.pack("<B4I", 4, *face))


def shade(colour, i, j):
    """A few per cent lighter or darker from tile to tile."""
    change = 1.0 + 0.05 * (((i * 7919 + j * 104729 + 31) % 17) / 8 - 1)
    return tuple(min(255, int(c * change)) for c in colour)


def tiles():
    white, blue, grout = (222, 232, 232), (120, 178, 200), (70, 88, 96)
    band, stone, seam = (40, 96, 140), (196, 184, 164), (120, 112, 100)
    mesh = Mesh()
    x, z = HALF
    # The floor, a millimetre over the bed.
    checker = lambda i, j: shade(white if (i + j) % 2 else blue, i, j)
    mesh.tiles((-x, -DEPTH + 0.001, z), (2 * x, 0, 0), (0, 0, -2 * z), 0.25, 0.012, 0.001, checker, grout)
    # Walls: pale, with a dark band at the water's line.
    wall = lambda i, j: shade(band if j >= 8 else white, i, j)
    height = DEPTH + RIM
    for corner, along in [
        ((-x, -DEPTH, -z), (2 * x, 0, 0)),
        ((x, -DEPTH, z), (-2 * x, 0, 0)),
        ((-x, -DEPTH, z), (0, 0, -2 * z)),
        ((x, -DEPTH, -z), (0, 0, 2 * z)),
    ]:
        mesh.tiles(corner, along, (0, height, 0), 0.25, 0.012, 0.001, wall, grout)
    # The deck: four strips of flags.
    flags = lambda i, j: shade(stone, i, j)
    for corner, along, across in [
        ((-x - DECK, RIM, z + DECK), (2 * (x + DECK), 0, 0), (0, 0, -DECK)),
        ((-x - DECK, RIM, -z), (2 * (x + DECK), 0, 0), (0, 0, -DECK)),
        ((-x - DECK, RIM, z), (DECK, 0, 0), (0, 0, -2 * z)),
        ((x, RIM, z), (DECK, 0, 0), (0, 0, -2 * z)),
    ]:
        mesh.tiles(corner, along, across, 0.375 if along[0] > 1 else 0.25, 0.01, 0.001, flags, seam)
    mesh.write("tiles.ply")


if __name__ == "__main__":
    for number in range(FRAMES):
        frame(number)
    tiles()
