"""Mesh files, written by hand or by trimesh."""

import io
import json
import struct

import DracoPy
import meshopt
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
        self.more_buffers = []

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

    def triangle(self, vertices=TRIANGLE, material=None, faces=None, **attributes):
        """A mesh of one primitive, whose triangles are those of its vertices unless told."""
        part = {"attributes": {"POSITION": self.accessor(vertices), **attributes}}
        if faces is not None:
            part["indices"] = self.accessor(np.ravel(faces).astype(np.uint32))
        if material is not None:
            part["material"] = material
        meshes = self.header.setdefault("meshes", [])
        meshes.append({"primitives": [part]})
        return len(meshes) - 1

    def paint(self, picture, model=None, kind="png", **material):
        """A material whose color is a picture, with other fields of its model and of itself."""
        color = {"baseColorTexture": {"index": 0}, **(model or {})}
        self.header |= {
            "images": [{"bufferView": self.view(picture), "mimeType": f"image/{kind}"}],
            "textures": [{"source": 0}],
            "materials": [{"pbrMetallicRoughness": color, **material}],
        }

    def animate(self, keys, *ways):
        """Move nodes: a way is a node, what of it moves, and the values at the keys."""
        times = self.accessor(np.asarray(keys, np.float32))
        values = [self.accessor(np.asarray(each, np.float32)) for *_, each in ways]
        channels = [
            {"sampler": number, "target": {"node": node, "path": path}}
            for number, (node, path, _) in enumerate(ways)
        ]
        samplers = [{"input": times, "output": output} for output in values]
        self.header["animations"] = [{"samplers": samplers, "channels": channels}]

    def with_draco(self, number=0, **how):
        """Compress the triangles of a mesh, whose accessors keep no data of their own."""
        (part,) = self.header["meshes"][number]["primitives"]
        entries = {name: self.header["accessors"][at] for name, at in part["attributes"].items()}
        values = {name: self.values(entry) for name, entry in entries.items()}
        corners = self.header["accessors"][part["indices"]]
        names = [name for name in values if name != "POSITION"]
        content = DracoPy.encode(
            values["POSITION"], self.values(corners).reshape(-1, 3), quantization_bits=16,
            generic_attributes={at: values[name] for at, name in enumerate(names)} or None, **how,
        )  # fmt: skip
        mesh = DracoPy.decode(content)
        for entry in (*entries.values(), corners):
            del entry["bufferView"]
        for entry in entries.values():
            entry["count"] = len(mesh.points)
        places = {"POSITION": len(names) if names else 0, **{n: at for at, n in enumerate(names)}}
        packed = {"bufferView": self.view(content), "attributes": places}
        part["extensions"] = {"KHR_draco_mesh_compression": packed}
        self.header["extensionsRequired"] = ["KHR_draco_mesh_compression"]

    def with_meshopt(self, number, mode, content=None, filter="NONE"):
        """Compress the data of an accessor, or replace them by rows compressed for a filter."""
        entry = self.header["accessors"][number]
        rows = self.values(entry) if content is None else content
        packed = meshopt.encode_gltf_buffer(np.ascontiguousarray(rows), mode)
        stride = rows.nbytes // len(rows)
        at = self.view(packed)
        how = {"mode": mode, "filter": filter, "count": len(rows), "byteStride": stride}
        here = {**self.header["bufferViews"][at], **how}
        entry["bufferView"] = at
        self.header["bufferViews"][at] = {
            "buffer": 1,
            "byteLength": rows.nbytes,
            "extensions": {"EXT_meshopt_compression": here},
        } | ({"byteStride": stride} if mode == "ATTRIBUTES" else {})
        fallback = {"EXT_meshopt_compression": {"fallback": True}}
        self.more_buffers = [{"byteLength": 10**6, "extensions": fallback}]
        self.header["extensionsRequired"] = ["EXT_meshopt_compression"]

    def values(self, entry):
        """Data of an accessor as written."""
        kind = next(kind for kind, code in TYPES.items() if code == entry["componentType"])
        width = next(width for width, name in WIDTHS.items() if name == entry["type"])
        start = self.header["bufferViews"][entry["bufferView"]]["byteOffset"]
        rows = np.frombuffer(self.data, kind, entry["count"] * width, start)
        return rows.reshape(-1, width)

    def glb(self):
        buffers = [{"byteLength": len(self.data)}, *self.more_buffers]
        header = {**self.header, "buffers": buffers}
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
