#!/usr/bin/env python3
"""Reads a frame in Blender, composites it there, and compares what comes out with the file's own numbers.

    pip install bpy==5.0.1 OpenEXR numpy        # Python 3.11, which that Blender is built for
    python3 scripts/check-in-blender.py FRAME.exr [FRAME.deep.exr] [--pictures FOLDER] [--exposure STOPS] ...

Works on files of both profiles, of one eye or two, of any compression, on the processor alone. Blender's compositor

* gives out every pass as it read it: bit for bit what the file holds;
* adds up the layers of light, and the lights: the beauty, within the rounding of the halfs that they are stored in;
* pulls a matte of every name of the three Cryptomattes: the coverage decoded straight from ids and ranks;
* has other water by `water.path`: what the formula gives;
* puts a lamp in by place, normal and albedo: what the formula gives;
* blurs by motion and depth (Vector Blur): what rests stays, what moves is spread along its motion, not across it;
* puts the frame out of focus (Defocus): more where the lens of the file's attributes says so.

Of a deep file Blender shows the samples flattened; their alpha is compared with the flat frame's. `--pictures` keeps what was
composited as JPEGs. Prints the greatest difference of each; exit code 0 all agrees, 1 something does not, 2 could not run.
"""

import argparse
import os
import sys

LIGHT = "reflection refraction volume caustics spray foam mist terrain sky".split()
HALF_ULP = 2.0**-11  # half an ulp of a half, relative; 2^-25 absolute below its normal numbers
MORE_WATER = (0.6, 0.1, 0.5)  # 1/m, added to the water's absorption
EVENING = {"light_sun": (1.0, 0.45, 0.12), "light_sky": (0.1, 0.15, 0.3)}
LAMP = (6.0, 2.4, 0.6)  # radiance of a white card a metre from a lamp that is put in by `P` and `N`
SHUTTER = 0.5  # of a frame


def refuse(message):
    print(f"check-in-blender: {message}", file=sys.stderr)
    raise SystemExit(2)


try:
    import bpy
    import numpy as np
    from blender_graph import Frame, Graph
except ImportError as missing:
    refuse(f"{missing}; needs `pip install bpy==5.0.1 OpenEXR numpy` with Python 3.11")


# The comparisons ----------------------------------------------------------------------------------------------------------


class Verdict:
    """Prints each comparison and remembers whether all were right."""

    wrong = 0

    def say(self, what, right, figures):
        self.wrong += not right
        print(f"{'ok   ' if right else 'WRONG'} {what}: {figures}")

    def near(self, what, found, wanted, allowed):
        """`allowed` per value: what rounding explains."""
        off = np.abs(found - wanted)
        worst = np.unravel_index(np.argmax(off / allowed), off.shape)
        figures = f"greatest difference {off.max():.3g}; nearest to its bound {off[worst]:.3g} of {np.broadcast_to(allowed, off.shape)[worst]:.3g}"
        self.say(what, bool(np.all(off <= allowed)), figures)


def rounding(colors, beauty):
    """What a sum of halfs may be off from a half: half an ulp of each."""
    return sum(np.maximum(np.abs(c) * HALF_ULP, 2.0**-25) for c in [*colors, beauty]) + 1e-6 * np.abs(beauty)


def sets_of_light(passes):
    yield "layers", [name for name in LIGHT if name in passes]
    yield "lights", [name for name in passes if name.startswith("light_")]


def motion(graph):
    """The motion as Vector Blur wants it: x and y to the frame before, and from the one after."""
    passes = graph.passes
    if "Vector" in passes:
        return passes["Vector"]
    before, after = graph.split(passes["backward"]), graph.split(passes["forward"])
    return graph.gather([before[0], before[1], *(graph.math("MULTIPLY", value, -1.0) for value in after[:2])])


def line(picture, x, y, shares):
    """Each pixel's mean over a line through it, shares of (x, y) to both sides; y up as in the file."""
    height, width = picture.shape[:2]
    rows, columns = np.mgrid[0:height, 0:width]
    total = np.zeros_like(picture)
    for share in shares:
        i = np.clip(np.rint(rows - share * y).astype(int), 0, height - 1)
        j = np.clip(np.rint(columns + share * x).astype(int), 0, width - 1)
        total += picture[i, j]
    return total / len(shares)


def reached(lengths, margin):
    """Whether any pixel within its own length and a margin of a pixel moves: a square around each, which is more than enough."""
    found = np.zeros(lengths.shape, bool)
    for i, j in zip(*np.nonzero(lengths > 0.01)):
        r = int(np.ceil(lengths[i, j])) + margin
        found[max(i - r, 0) : i + r + 1, max(j - r, 0) : j + r + 1] = True
    return found


def check_motion(verdict, frame, view, blurred, sharp):
    held = frame.passes[view]
    if "Vector" in held:
        before, after = ([held["Vector"][c].astype("f8") for c in pair] for pair in ("XY", "ZW"))
    else:
        before, after = ([held[layer][c].astype("f8") for c in "UV"] for layer in ("backward", "forward"))
    x, y = before
    lengths = np.maximum(np.hypot(*before), np.hypot(*after))
    if not np.any(lengths > 1):
        return print("-     vector blur: nothing moves by more than a pixel")
    # The node looks for motion in tiles of 32 pixels and their neighbours, and lets it tell on what rests in them.
    resting = ~reached(lengths, 2 * 32)
    if resting.any():
        off = np.abs(blurred - sharp)[resting] / np.maximum(sharp[resting], 1)
        figures = f"greatest change {off.max():.3g} in the {resting.sum()} pixels that are 64 and more from all motion"
        verdict.say("vector blur, what rests", bool(off.max() <= 1e-5), figures)
    # What moves, against lines that are drawn by hand along its motion, across it, and with y the other way.
    shares = np.linspace(-SHUTTER / 2, SHUTTER / 2, 17)
    along_it = line(sharp, x, y, shares)
    for what, other, where in (
        ("unblurred", sharp, lengths > 2),
        ("across", line(sharp, -y, x, shares), lengths > 2),
        ("y down", line(sharp, x, -y, shares), (np.abs(x) > 2) & (np.abs(y) > 2)),
    ):
        if where.sum() < 500:
            print(f"-     vector blur, {what}: too little moves so")
            continue
        log = lambda picture: np.log(np.maximum(picture.mean(-1), 1e-4))[where]
        near, far = (float(np.mean((log(picture) - log(blurred)) ** 2) ** 0.5) for picture in (along_it, other))
        figures = f"rms of logarithms {near:.3f} from lines along the motion, {far:.3f} from {what}, {where.sum()} pixels"
        verdict.say("vector blur, what moves", near < 0.8 * far, figures)


def check_defocus(verdict, frame, view, blurred, sharp, lens):
    z = frame.passes[view]["Depth"]["Z"].astype("f8")
    length, focus, stop, film = lens
    circle = length**2 / (stop * (focus - length)) * np.abs(z - focus) / z / film * frame.size[0]  # pixels across
    change = np.abs(blurred - sharp).mean(-1) / np.maximum(sharp.mean(-1), 1e-4)
    near, far = circle < 1, circle > 2
    if not (near.any() and far.any()):
        return print("-     defocus: nothing is in focus, or nothing out of it")
    verdict.say(
        "defocus",
        bool(np.isfinite(blurred).all() and change[near].mean() < 0.1 * change[far].mean()),
        f"mean change {change[near].mean():.3g} in focus, {change[far].mean():.3g} where the circle of confusion is over 2 pixels",
    )


def check_view(verdict, frame, image, view, options):
    graph, held = Graph(image, frame, view), frame.passes[view]
    passes = graph.passes
    print(f"--    {view + ': ' if view else ''}{len(passes)} passes")
    absent = sorted(set(held) - set(passes))
    verdict.say("every layer is found", not absent, ", ".join(absent) + " missing" if absent else f"{len(held)} of {len(held)}")
    for name in passes:
        graph.keep("pass " + name, passes[name], len(held.get(name, "")) if name == "Vector" else 3)

    beauty = "Noisy Image" if "Noisy Image" in held else "noisy" if "noisy" in held else "Combined"
    for what, names in sets_of_light(held):
        if all(name in passes for name in names) and names:
            graph.keep("sum of " + what, graph.add([passes[name] for name in names]))
    if all(name in passes for name in EVENING):
        lights = [passes[n] if n not in EVENING else graph.mix("MULTIPLY", passes[n], EVENING[n]) for n in held if n.startswith("light_")]
        graph.keep("relit", graph.add(lights))
    if "caustics" in passes:
        graph.keep("no-caustics", graph.add([passes[name] for name in LIGHT if name in passes and name != "caustics"]))

    path = passes.get("water_path") or ("water" in passes and graph.split(passes["water"])[1])
    if path and all(name in passes for name in LIGHT):
        stay = graph.gather([graph.math("EXPONENT", graph.math("MULTIPLY", path, -more)) for more in MORE_WATER])
        inside = graph.mix("MULTIPLY", graph.add([passes[n] for n in ("refraction", "caustics", "volume")]), stay)
        graph.keep("other-water", graph.add([inside, *(passes[n] for n in LIGHT if n not in ("refraction", "caustics", "volume"))]))

    lamp = put_lamp(graph, frame, view)
    mattes = []
    for matte, manifest in frame.mattes():
        for name, identity in manifest.items():
            wanted = frame.coverage(view, matte, identity)
            node = graph.node("CryptomatteV2", source="IMAGE", image=image)
            if node.has_views:
                node.view = view
            node.layer_name, node.matte_id = matte, name
            # Of a file with two eyes, Blender 5.0 adds the chosen eye up once for each.
            pulled = graph.math("DIVIDE", node.outputs["Matte"], float(max(len(frame.views), 1)))
            key = f"matte {matte.rsplit('.', 1)[-1]} {name}"
            graph.keep(key, pulled)
            mattes.append((key, wanted))

    moves = "Vector" in passes or {"backward", "forward"} <= set(passes)
    if moves and "Depth" in passes:
        node = graph.node("VecBlur")
        for value, socket in ((passes["Combined"], "Image"), (motion(graph), "Speed"), (passes["Depth"], "Z"), (64, "Samples"), (SHUTTER, "Shutter")):
            graph.join(value, node.inputs[socket])
        graph.keep("vector-blur", node.outputs[0])
    lens = None
    if "Depth" in passes and "pinholeFocalLength" in frame.header:
        lens = place_lens(frame, view, options)
        node = graph.node("Defocus", scene=bpy.context.scene, use_zbuffer=True, f_stop=options.f_number, blur_max=32.0)
        graph.join(passes["Combined"], node.inputs["Image"])
        graph.join(passes["Depth"], node.inputs["Z"])
        graph.keep("defocus", node.outputs[0])

    made = graph.run()

    differing, compared = [], 0
    for name in sorted(set(passes) & set(held)):
        wanted = frame.expected(view, name)
        compared += len(wanted)
        found = made["pass " + name]
        same = all(np.array_equal(found[..., i].astype("f4").view("u4"), w.astype("f4").view("u4")) for i, w in enumerate(wanted))
        differing += [] if same else [name]
    verdict.say("passes bit for bit", not differing, f"{compared} channels" + (f"; not {', '.join(differing)}" if differing else ""))

    whole = frame.color(view, beauty)
    unclipped = np.where(whole < 65504, 1.0, np.inf)  # what exceeded half was cut off in the beauty
    for what, names in sets_of_light(held):
        if "sum of " + what in made:
            each, found = [frame.color(view, n) for n in names], made["sum of " + what][..., :3]
            verdict.near(f"sum of {len(names)} {what}", found, sum(each), 1e-6 * sum(np.abs(c) for c in each) + 1e-9)
            if frame.lossy:
                print(f"-     the beauty from {what}: off by {np.abs(found - whole).max():.3g}, by what its compression loses")
            else:
                verdict.near(f"the beauty from {what}", found, whole, rounding(each, whole) * unclipped)
    if "other-water" in made:
        length = held["water_path"]["X"] if "water_path" in held else held["water"]["PATH"]
        inside = sum(frame.color(view, n) for n in ("refraction", "caustics", "volume"))
        outside = sum(frame.color(view, n) for n in LIGHT if n not in ("refraction", "caustics", "volume"))
        wanted = outside + inside * np.exp(-length.astype("f8")[..., None] * np.array(MORE_WATER))
        verdict.near("other water", made["other-water"][..., :3], wanted, 1e-5 * np.abs(wanted) + 1e-7)
    if lamp is not None:
        verdict.near("a lamp by place and normal", made["lamp"][..., :3], lamp, 1e-4 * np.abs(lamp) + 1e-6)
    for matte in sorted({key.split()[1] for key, _ in mattes}):
        mine = [(key, wanted) for key, wanted in mattes if key.split()[1] == matte]
        off = {key: np.abs(made[key][..., 0] - wanted).max() for key, wanted in mine}
        seen = [f"{key.split()[2]} {wanted.mean():.1%}" for key, wanted in mine if wanted.any()]
        verdict.say(matte, max(off.values()) <= 1e-6, f"greatest difference {max(off.values()):.3g}; {', '.join(seen) or 'nothing seen'}")
    sharp = frame.color(view, "Combined")
    if "vector-blur" in made:
        check_motion(verdict, frame, view, made["vector-blur"][..., :3].astype("f8"), sharp)
    if "defocus" in made:
        check_defocus(verdict, frame, view, made["defocus"][..., :3].astype("f8"), sharp, lens)

    if options.pictures:
        names = ["relit", "no-caustics", "other-water", "lamp", "vector-blur", "defocus"] + [key for key, wanted in mattes if wanted.any()]
        made["beauty"] = made["pass Combined"]
        for name in ["beauty", *names]:
            if name in made:
                keep_picture(made[name], "-".join(filter(None, [view, *name.split()])), options)


def put_lamp(graph, frame, view):
    """Adds the light of a lamp a metre over what the frame's middle sees; gives what it should come to."""
    names = next((n for n in (("P", "N", "albedo"), ("Position", "Normal", "Denoising Albedo")) if set(n) <= set(graph.passes)), None)
    if not names:
        return None
    place, normal, albedo = (np.stack(frame.expected(view, name), -1).astype("f8") for name in names)
    lamp = place[place.shape[0] // 2, place.shape[1] // 2] + (0, 1, 0)

    def vector(operation, *values):
        node = graph.node("ShaderNodeVectorMath", operation=operation)
        for value, socket in zip(values, node.inputs):
            graph.join(value, socket)
        return node.outputs["Value" if operation in ("LENGTH", "DOT_PRODUCT") else "Vector"]

    toward = vector("SUBTRACT", tuple(lamp), graph.passes[names[0]])
    facing = graph.math("MAXIMUM", vector("DOT_PRODUCT", toward, graph.passes[names[1]]), 0.0)
    light = graph.math("DIVIDE", facing, graph.math("POWER", vector("LENGTH", toward), 3.0))
    lit = graph.mix("MULTIPLY", graph.passes[names[2]], graph.gather([graph.math("MULTIPLY", light, c) for c in LAMP]))
    graph.keep("lamp", graph.add([graph.passes["Combined"], lit]))
    toward = lamp - place
    light = np.maximum((toward * normal).sum(-1), 0) / np.linalg.norm(toward, axis=-1) ** 3
    return frame.color(view, "Combined") + albedo[..., :3] * light[..., None] * LAMP


def place_lens(frame, view, options):
    """A camera with the film and lens that the file tells of; (focal length, focus, f-number, film's width) in metres."""
    length = float(frame.header["pinholeFocalLength"]) / 1000
    film = float(frame.header["sensorOverallDimensions"][0]) / 1000
    z = frame.passes[view]["Depth"]["Z"]
    focus = options.focus or float(np.median(z[z < 1e9]))
    camera = bpy.data.cameras.new("lens")
    camera.lens, camera.sensor_width, camera.sensor_fit = length * 1000, film * 1000, "HORIZONTAL"
    camera.dof.focus_distance = focus
    bpy.context.scene.camera = bpy.data.objects.new("lens", camera)
    bpy.context.scene.collection.objects.link(bpy.context.scene.camera)
    return length, focus, options.f_number, film


def keep_picture(pixels, name, options):
    """Through Blender's view transform into a JPEG."""
    height, width = pixels.shape[:2]
    if pixels.shape[-1] == 1:
        pixels = np.repeat(pixels, 3, -1)
    full = np.ones((height, width, 4), "f4")
    full[..., :3] = pixels[::-1, :, :3]
    scene = bpy.context.scene
    matte = name.split("-")[0] == "matte" or "-matte-" in name
    scene.view_settings.view_transform = "Raw" if matte else options.view
    scene.view_settings.exposure = 0 if matte else options.exposure
    scene.render.image_settings.file_format = "JPEG"
    scene.render.image_settings.quality = 88
    image = bpy.data.images.new(name, width, height, float_buffer=True)
    image.pixels.foreach_set(full.ravel())
    image.save_render(os.path.join(options.pictures, name + ".jpg"), scene=scene)


def check_deep(verdict, frame, path):
    image = bpy.data.images.load(os.path.abspath(path))
    flat = np.array(image.pixels[:]).reshape(image.size[1], image.size[0], -1)[::-1]
    alpha = next(iter(frame.passes.values()))["Combined"]["A"].astype("f8")
    if flat.shape[:2] != alpha.shape:
        return verdict.say("deep", False, f"{flat.shape[1]}x{flat.shape[0]} pixels, the frame has {alpha.shape[1]}x{alpha.shape[0]}")
    verdict.near("deep, flattened as Blender reads it, alpha", flat[..., 3], alpha, 0.002 + alpha * HALF_ULP)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("frame", help="an EXR of `whitewater render`")
    parser.add_argument("deep", nargs="?", help="its deep EXR")
    parser.add_argument("--pictures", metavar="FOLDER", help="keep what was composited")
    parser.add_argument("--exposure", type=float, default=0.0, help="of the pictures, in stops")
    parser.add_argument("--view", default="Filmic", help="view transform of the pictures: Standard, Filmic, AgX")
    parser.add_argument("--focus", type=float, help="of Defocus (m) [default: the median depth]")
    parser.add_argument("--f-number", type=float, default=0.05, help="of Defocus [default: 0.05; a scene of metres on a film of 24 mm is blurred little by less]")
    options = parser.parse_args()
    for path in filter(None, (options.frame, options.deep)):
        if not os.path.isfile(path):
            refuse(f"{path}: no such file")
    if options.pictures:
        os.makedirs(options.pictures, exist_ok=True)
    try:
        frame = Frame(options.frame)
    except Exception as problem:
        refuse(f"{options.frame}: {problem}")
    bpy.ops.wm.read_factory_settings(use_empty=True)
    image = bpy.data.images.load(os.path.abspath(options.frame))
    space = image.colorspace_settings.name
    print(f"--    Blender {bpy.app.version_string}: {image.type.lower()}, {frame.size[0]}x{frame.size[1]}, {space}")
    # Blender would turn any other primaries into its own as it reads, the ids of Cryptomatte too. Numbers are compared as they are.
    image.colorspace_settings.name = "Linear Rec.709"
    verdict = Verdict()
    for view in frame.views or [""]:
        check_view(verdict, frame, image, view, options)
    if options.deep:
        check_deep(verdict, frame, options.deep)
    raise SystemExit(1 if verdict.wrong else 0)


if __name__ == "__main__":
    main()
