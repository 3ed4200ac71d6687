"""What a whitewater EXR holds, read by OpenEXR (`Frame`), and node trees of Blender's compositor over it (`Graph`).

Nothing is compared here: check-in-blender.py does.
"""

import json
import os
import struct
import tempfile

import bpy
import numpy as np
import OpenEXR

# What the file holds ------------------------------------------------------------------------------------------------------


class Frame:
    """An EXR's passes by the names that Blender gives them, each a dict of channels, read by OpenEXR."""

    def __init__(self, path):
        parts = OpenEXR.File(path, separate_channels=True).parts
        self.header = parts[0].header
        self.lossy = self.header["compression"] in (OpenEXR.DWAA_COMPRESSION, OpenEXR.DWAB_COMPRESSION)
        self.views = list(self.header.get("multiView", []))
        self.passes = {view: {} for view in self.views or [""]}
        for part in parts:
            for name, channel in part.channels.items():
                self._place(name.split("."), channel.pixels)
        low, high = self.header["dataWindow"]
        self.size = int(high[0] - low[0]) + 1, int(high[1] - low[1]) + 1

    def _place(self, words, pixels):
        view = next((word for word in words[:-1] if word in self.views), (self.views or [""])[0])
        words = [word for word in words if word not in self.views and word != "ViewLayer"]
        if len(words) == 1:  # no layer's: the beauty, the depth, or a pass by itself
            layer = "Combined" if words[0] in "RGBA" else "Depth" if words[0] == "Z" else words[0]
        else:
            layer = ".".join(words[:-1])
        self.passes[view].setdefault(layer, {})[words[-1].upper()] = pixels

    def expected(self, view, layer):
        """A pass's channels in Blender's order: red to alpha, x to w, or as they are sorted."""
        held = self.passes[view][layer]
        order = next((o for o in ("RGBA", "XYZW") if len(held) > 2 and set(held) <= set(o)), None)
        return [held[c] for c in (order or sorted(held)) if c in held]

    def color(self, view, layer):
        return np.stack([self.passes[view][layer][c].astype("f8") for c in "RGB"], -1)

    def mattes(self):
        """(name of the Cryptomatte, its manifest) of each in the header."""
        for key, name in self.header.items():
            if key.startswith("cryptomatte/") and key.endswith("/name"):
                yield name, json.loads(self.header[key[: -len("name")] + "manifest"])

    def coverage(self, view, matte, identity):
        """Coverage of an id, straight from the ranks."""
        wanted = np.frombuffer(struct.pack("<I", int(identity, 16)), "f4")[0]
        total = np.zeros(self.size[::-1])
        for rank in range(6):
            channels = self.passes[view][f"{matte.rsplit('.', 1)[-1]}{rank // 2:02}"]
            identities, shares = ("R", "G") if rank % 2 == 0 else ("B", "A")
            total += np.where(channels[identities] == wanted, channels[shares], 0)
        return total


# What Blender makes of it -------------------------------------------------------------------------------------------------


class Graph:
    """A compositor's nodes over one view of an image; `keep` names a result, `run` makes them all."""

    def __init__(self, image, frame, view):
        bpy.context.scene.compositing_node_group = tree = bpy.data.node_groups.new("check", "CompositorNodeTree")
        self.tree, self.image, self.view = tree, image, view
        self.output = self.node("OutputFile")
        self.output.format.media_type = "MULTI_LAYER_IMAGE"
        self.output.format.color_depth = "32"
        render = bpy.context.scene.render
        render.resolution_x, render.resolution_y = frame.size
        render.resolution_percentage = 100
        render.compositor_device, render.compositor_precision = "CPU", "FULL"
        self.passes = {}
        source = self.node("Image", image=image)
        layers = choices(source, "layer") if source.has_layers else []
        for layer in layers if len(layers) > 1 else [None]:
            source = self.node("Image", image=image)
            if layer:  # of a file with two eyes, Blender 5.0 loses passes when it is told the layer that it has anyway
                source.layer = layer
            if source.has_views:
                source.view = view
            self.passes.update({socket.name: socket for socket in source.outputs if socket.enabled})

    def node(self, kind, **settings):
        node = self.tree.nodes.new(kind if kind.startswith("Shader") else "CompositorNode" + kind)
        for key, value in settings.items():
            setattr(node, key, value)
        return node

    def join(self, value, socket):
        if isinstance(value, bpy.types.NodeSocket):
            self.tree.links.new(value, socket)
        else:
            socket.default_value = value

    def mix(self, blend, a, b):
        node = self.node("ShaderNodeMix", data_type="RGBA", blend_type=blend)
        a, b = ((*x, 1.0) if isinstance(x, tuple) else x for x in (a, b))
        for value, index in ((1.0, 0), (a, 6), (b, 7)):
            self.join(value, node.inputs[index])
        return node.outputs[2]

    def math(self, operation, *values):
        node = self.node("ShaderNodeMath", operation=operation)
        for value, socket in zip(values, node.inputs):
            self.join(value, socket)
        return node.outputs[0]

    def split(self, socket):
        node = self.node("ShaderNodeSeparateXYZ")
        self.join(socket, node.inputs[0])
        return list(node.outputs)

    def gather(self, values):
        """Up to four values as one colour, which a vector of four takes as well."""
        node = self.node("CombineColor")
        for value, socket in zip(values, node.inputs):
            self.join(value, socket)
        return node.outputs[0]

    def add(self, layers):
        total = layers[0]
        for layer in layers[1:]:
            total = self.mix("ADD", total, layer)
        return total

    def keep(self, name, socket, dimensions=3):
        item = self.output.file_output_items.new({"VALUE": "FLOAT"}.get(socket.type, socket.type), name)
        if socket.type == "VECTOR":
            item.vector_socket_dimensions = dimensions
        self.join(socket, self.output.inputs[name])

    def run(self):
        """name -> (height, width, channels) of all that was kept."""
        with tempfile.TemporaryDirectory() as folder:
            self.output.directory, self.output.file_name = folder, "kept"
            bpy.ops.render.render()
            parts = OpenEXR.File(os.path.join(folder, "kept.exr"), separate_channels=True).parts
            order = "RGBAXYZWV"
            return {
                part.name(): np.stack(
                    [c.pixels for _, c in sorted(part.channels.items(), key=lambda it: order.index(it[0][-1].upper()))], -1
                )
                for part in parts
            }


def choices(node, name):
    """The items of an enum that Blender makes up as it goes: Python is told them only by giving a wrong one."""
    try:
        setattr(node, name, "\0")
    except TypeError as told:
        found = eval(str(told).rsplit("not found in ", 1)[1])  # a tuple of strings, or one in brackets
        return [found] if isinstance(found, str) else list(found)
    return []
