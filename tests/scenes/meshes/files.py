"""Mesh files, written by hand or by trimesh."""

import io
import json
import struct

import numpy as np
import trimesh
from PIL import Image

TYPES = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
WIDTHS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
TRIANGLE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)


class Gltf:
    """A glTF file in the making: JSON, and the bytes that its accessors read."""

    def __init__(self):
        self.header = {"asset": {"version": "2.0"}, "bufferViews": [], "accessors": []}
        self.data = b""

    def view(self, content):
        self.header["bufferViews"].append(
            {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(content)}
        )
        self.data += content + b"\0" * (-len(content) % 4)
        return len(self.header["bufferViews"]) - 1

    def accessor(self, values, **more):
        values = np.asarray(values)
        rows = values.reshape(len(values), -1)
        self.header["accessors"].append(
            {
                "bufferView": self.view(np.ascontiguousarray(values).tobytes()),
                "componentType": TYPES[values.dtype.str[1:]],
                "count": len(values),
                "type": WIDTHS[rows.shape[1]],
                **more,
            }
        )
        return len(self.header["accessors"]) - 1

    def triangle(self, vertices=TRIANGLE, material=None, **attributes):
        """A mesh of one primitive."""
        part = {"attributes": {"POSITION": self.accessor(vertices), **attributes}}
        if material is not None:
            part["material"] = material
        meshes = self.header.setdefault("meshes", [])
        meshes.append({"primitives": [part]})
        return len(meshes) - 1

    def glb(self):
        header = {**self.header, "buffers": [{"byteLength": len(self.data)}]}
        header.setdefault("nodes", [{"mesh": 0}])
        text = json.dumps(header).encode()
        text += b" " * (-len(text) % 4)
        parts = struct.pack("<II", len(text), 0x4E4F534A) + text
        parts += struct.pack("<II", len(self.data), 0x004E4942) + self.data
        return struct.pack("<4sII", b"glTF", 2, 12 + len(parts)) + parts


def png(values):
    """PNG file of codes (H, W, 3)."""
    file = io.BytesIO()
    Image.fromarray(np.asarray(values, np.uint8)).save(file, "png")
    return file.getvalue()


def pose(turn_deg=0.0, axis=(0, 1, 0), shift=(0, 0, 0), scale=1.0):
    matrix = trimesh.transformations.rotation_matrix(np.radians(turn_deg), axis)
    matrix[:3, :3] *= scale
    matrix[:3, 3] = shift
    return matrix
