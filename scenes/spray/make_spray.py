"""Makes the fall's frames, the same bytes each time: `python3 make_spray.py` in this folder (needs numpy).

A stream leaves a cliff six metres over a pool, in wind from the west. What it is made of changes as it falls: a sheet of
water where it leaves the lip, drops that draw streaks once air has torn it, mist that the wind takes away, and bubbles
where it goes under. Drops fall with drag (a sphere's, coefficient 0.47) through wind that blows along +x; a drop's time
since it left the lip is its age, and its number is its id, so that each frame has the same drops a 24th of a second
later.
"""

import zipfile

import numpy as np

FPS = 24.0
FRAMES = 2
WIDTH = 0.125  # of a column
COLUMNS = (96, 80)  # x, z
LIP = 3.6  # x of the cliff's edge
CLIFF = 6.0  # height of the plateau's bed over the pool's level
DEPTH = 0.9  # of the pool
HALF = 1.6  # half the stream's width
MIDDLE = 5.0  # its z
SPEED = 2.2  # of the stream at the lip
THICK = 0.09  # of the stream at the lip
WIND = 2.6
GRAVITY = 9.81
AIR, WATER = 1.2, 1000.0


def noise(x, z, size, seed):
    """Smooth noise between -1 and 1: a few waves of random directions, about `size` metres long."""
    random = np.random.default_rng(seed)
    total = np.zeros_like(x)
    for _ in range(12):
        angle, phase, scale = random.uniform(0, 2 * np.pi, 2).tolist() + [random.uniform(0.6, 1.6)]
        k = 2 * np.pi / (size * scale)
        total += np.sin(k * (x * np.cos(angle) + z * np.sin(angle)) + phase)
    return total / 5.0


def ground(x, z):
    aside = np.abs(z - MIDDLE) - HALF
    rough = 0.25 * noise(x, z, 2.4, 1) + 0.10 * noise(x, z, 0.9, 2)
    # The cliff steps back beside the stream, and leans.
    edge = LIP - 0.35 * np.clip(aside, 0.0, 3.0) + 0.25 * noise(x, z, 1.7, 3) * np.clip(aside, 0.0, 1.0)
    rise = np.clip((edge - x) / 0.5, 0.0, 1.0)
    plateau = CLIFF + 0.9 * np.clip(aside / 0.9, 0.0, 1.0) ** 2 + 0.5 * np.clip(aside - 0.5, 0.0, 4.0)
    plateau = plateau + rough * np.clip(aside + 0.3, 0.15, 1.0)
    shore = np.clip(np.hypot((x - 6.6) / 4.4, (z - MIDDLE) / 4.0) - 0.75, 0.0, 1.0)
    floor = -DEPTH + 3.2 * shore + 0.3 * rough
    return floor + (plateau - floor) * rise * rise * (3 - 2 * rise)


def fall(age, start, speed, radius, steps=160):
    """Places and velocities of drops `age` seconds after they left: gravity, and drag by the air that moves past them."""
    place, velocity = start.copy(), speed.copy()
    dt = (age / steps)[:, None]
    strength = (0.375 * 0.47 * AIR / WATER / radius)[:, None]
    for _ in range(steps):
        gust = WIND * np.clip((CLIFF + 0.8 - place[:, 1:2]) / 1.5, 0.0, 1.0)
        past = velocity - gust * np.array([1.0, 0.05, 0.12])
        # Half-implicit, so that the finest drops ride with the wind at any step.
        drag = strength * np.linalg.norm(past, axis=1, keepdims=True)
        wind = velocity - past
        velocity = (velocity + dt * (np.array([0.0, -GRAVITY, 0.0]) + drag * wind)) / (1 + dt * drag)
        place = place + dt * velocity
    return place, velocity


def drops(time):
    """Every particle of the frame at `time`: id, place, velocity, radius, age."""
    parts = []

    def emit(name, rate, life, radius, start, speed):
        """Drops that leave `rate` times a second and last for `life` seconds; each by its number alone."""
        first, last = int(np.ceil((time - life) * rate)), int(np.floor(time * rate))
        number = np.arange(first, last + 1)
        # Numbers of its own for each drop, whenever it is looked at.
        draws = np.empty((len(number), 8))
        block = 1 << 16
        offset = 1 << 20
        for chunk in np.unique((number + offset) // block):
            inside = (number + offset) // block == chunk
            stream = np.random.Generator(np.random.Philox(key=[name, int(chunk)])).random((block, 8))
            draws[inside] = stream[(number[inside] + offset) % block]
        age = time - number / rate
        sizes = radius(draws)
        place, velocity = fall(age, start(draws), speed(draws), sizes)
        parts.append((number + offset + (name << 40), place, velocity, sizes, age, name))

    normal = lambda draws, a, b: np.sqrt(-2 * np.log(1 - draws[:, a])) * np.cos(2 * np.pi * draws[:, b])
    lip = lambda draws: np.stack(
        [np.full(len(draws), LIP + 0.05), CLIFF + 0.01 + THICK * draws[:, 1], MIDDLE + HALF * (2 * draws[:, 0] - 1)], 1
    )
    # A drop's speed along z depends on where it stands alone: neighbours stay together.
    fan = lambda draws: 0.25 * (2 * draws[:, 0] - 1)

    def steady(spread):
        return lambda draws: np.stack(
            [
                SPEED + 0.5 * draws[:, 1] + spread * normal(draws, 2, 3),
                0.25 * spread * normal(draws, 4, 5),
                fan(draws) + 0.6 * spread * normal(draws, 6, 7),
            ],
            1,
        )

    # The sheet itself, whole for a third of a second and thinner than water from then on.
    emit(1, 70_000, 0.40, lambda d: np.full(len(d), 0.012), lip, steady(0.02))
    # Strands and drops that air has torn off it.
    emit(2, 40_000, 1.25, lambda d: 0.005 * np.exp(0.4 * normal(d, 2, 3)).clip(0.45, 2.2), lip, steady(0.22))
    # What is too fine to be seen as drops: it goes with the wind.
    fine = lambda d: 0.0006 * np.exp(0.25 * normal(d, 2, 3)).clip(0.6, 1.6)
    emit(3, 12_000, 1.9, fine, lip, steady(0.8))
    # Splashes at the foot: up and out again.
    foot = lambda d: np.stack(
        [LIP + 2.75 + 0.5 * normal(d, 2, 3), np.full(len(d), 0.02), MIDDLE + 1.15 * HALF * (2 * d[:, 0] - 1)], 1
    )
    up = lambda d: np.stack([0.5 + 1.2 * normal(d, 4, 5), 1.2 + 2.2 * d[:, 1], 0.9 * normal(d, 6, 7)], 1)
    emit(4, 14_000, 0.75, lambda d: 0.004 * np.exp(0.4 * normal(d, 2, 4)).clip(0.4, 2.5), foot, up)
    emit(5, 14_000, 1.6, fine, foot, lambda d: 1.3 * up(d))
    number, place, velocity, radius, age, kind = (
        np.concatenate([np.broadcast_to(part[k], (len(part[0]),) + np.shape(part[k])[1:]) for part in parts])
        for k in range(6)
    )
    # Whatever has come down into the pool is gone; and the sheet is drops by its end.
    alive = (place[:, 1] > 0.0) | (place[:, 0] < LIP)
    return number[alive], place[alive], velocity[alive], radius[alive], age[alive]


def bubbles(time):
    """Bubbles under the foot: each rises for a second or two, on its own way."""
    random = np.random.default_rng(9)
    count = 9_000
    u = random.random((count, 6))
    life = 0.8 + 1.6 * u[:, 0]
    age = (time + 10.0 * u[:, 1]) % life
    x = LIP + 2.7 + 0.45 * random.standard_normal(count) + 0.25 * age
    z = MIDDLE + 1.15 * HALF * (2 * u[:, 2] - 1)
    rise = 0.25 + 0.1 * u[:, 3]
    y = -0.02 - np.minimum(rise * (life - age), 0.6)
    place = np.stack([x + 0.02 * np.sin(9 * age + 6 * u[:, 4]), y, z], 1)
    velocity = np.stack([np.full(count, 0.25), rise, np.zeros(count)], 1)
    radius = 0.0025 * np.exp(0.4 * random.standard_normal(count)).clip(0.4, 2.5)
    # A bubble that begins anew is another one.
    number = np.arange(count) + count * np.floor((time + 10.0 * u[:, 1]) / life).astype(np.int64) + (7 << 40)
    return number, place, velocity, radius, age


def pool(x, z, time):
    """The pool's surface: rings from the foot of the fall, lower the farther."""
    foot = LIP + 2.75
    nearest = np.clip(z, MIDDLE - HALF, MIDDLE + HALF)
    r = np.hypot(x - foot, z - nearest)
    height = np.zeros_like(x)
    for length, amplitude, phase in [(0.9, 0.030, 0.0), (0.62, 0.018, 2.0), (1.5, 0.018, 4.0)]:
        k = 2 * np.pi / length
        omega = np.sqrt(GRAVITY * k * np.tanh(k * DEPTH))
        height += amplitude * np.cos(k * r - omega * time + phase + 2.0 * noise(x, z, 2.0, 5)) / (1 + r)
    return height + 0.02 * noise(x, z, 0.55, 6) * np.exp(-((r / 1.2) ** 2))


def frame(number):
    time = number / FPS
    nx, nz = COLUMNS
    x, z = np.meshgrid(WIDTH * np.arange(nx), WIDTH * np.arange(nz))
    base = ground(x, z)
    level = pool(x, z, time)
    # The stream ends where its bed goes over the edge; from there on its water is particles.
    stream = (x < LIP + 0.1) & (np.abs(z - MIDDLE) < HALF) & (base > CLIFF - 0.35) & (base < CLIFF + THICK)
    surface = CLIFF + THICK + 0.015 * noise(x, z, 0.7, 7)
    top = np.where((base < level) & (x > LIP - 0.5), level, base)
    top = np.where(stream, np.maximum(surface - 1.2 * np.clip(CLIFF - base, 0.0, 1.0), base + 0.02), top)
    flow = np.zeros((nz, nx, 2))
    flow[stream] = (SPEED, 0.0)
    foot = np.hypot(x - (LIP + 2.75), z - np.clip(z, MIDDLE - HALF, MIDDLE + HALF))
    flow[~stream & (top > base), 0] = (0.8 * np.exp(-foot / 2.0))[~stream & (top > base)]
    every = [np.concatenate(pair) for pair in zip(drops(time), bubbles(time))]
    ids, place, velocity, radius, age = every
    arrays = {
        "time": np.array(time),
        "origin": np.zeros(2),
        "width": np.array([WIDTH, WIDTH]),
        "base": np.round(base, 4).astype("f4"),
        "top": np.round(np.maximum(top, base), 4).astype("f4"),
        "flow": np.round(flow, 3).astype("f4"),
        # To a millimetre and a thirtieth of a metre a second: they compress well.
        "position": np.round(place * 1024).astype("f4") / np.float32(1024),
        "velocity": np.round(velocity * 32).astype("f4") / np.float32(32),
        "mass": (4 / 3 * np.pi * WATER * np.round(radius, 5) ** 3).astype("f4"),
        "age": np.round(age, 3).astype("f4"),
        "id": ids.astype("u8"),
    }
    # numpy.savez_compressed writes today's date; this writes the same bytes every day.
    with zipfile.ZipFile(f"time{number:03}.npz", "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name, array in arrays.items():
            entry = zipfile.ZipInfo(name + ".npy", (1980, 1, 1, 0, 0, 0))
            entry.compress_type = zipfile.ZIP_DEFLATED
            with archive.open(entry, "w") as file:
                np.lib.format.write_array(file, np.asarray(array, order="C"))


for number in range(FRAMES):
    frame(number)
