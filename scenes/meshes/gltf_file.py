"""Container of a glTF 2.0 file (Khronos Group): JSON, buffers and the values of accessors.

Buffers may be compressed by meshoptimizer, and meshes by Draco. What they state is checked against
the budget of memory before their libraries decode them, and what these return against the file.
"""

import base64
import struct
from collections.abc import Mapping
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from megalopta.core.bounded import check_decoded, from_json, quoted

_TYPES = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
DRACO = "KHR_draco_mesh_compression"
MESHOPT = "EXT_meshopt_compression", "KHR_meshopt_compression"
PICTURES = "KHR_texture_basisu", "EXT_texture_webp"
EFFECTIVE = "KHR_texture_transform", "KHR_mesh_quantization", *PICTURES, DRACO, *MESHOPT
"""Extensions that always have an effect."""

Json = Mapping[str, Any]


def parts_of(content: bytes) -> tuple[Json, bytes]:
    """Return the JSON and the binary part, perhaps empty, of a file. Raises ValueError."""
    text, binary = content, b""
    if content[:4] == b"glTF":
        length, size = struct.unpack_from("<2I", content, 8)
        if length != len(content):
            raise ValueError(f"it states {length} bytes, and has {len(content)}")
        text, chunk = content[20 : 20 + size], content[20 + size :]
        if chunk[4:8] == b"BIN\0":
            binary = chunk[8 : 8 + int.from_bytes(chunk[:4], "little")]
    elif content.lstrip()[:1] != b"{":
        raise ValueError("it is neither binary glTF nor JSON")
    header = from_json(text.decode("utf-8"))
    version = str(header["asset"]["version"])
    if version.split(".")[0] != "2":
        raise ValueError(f"it has version {quoted(version)} of glTF, not 2")
    for name in header.get("extensionsRequired", ()):
        if name not in EFFECTIVE and not str(name).startswith(("KHR_materials_", "KHR_lights_")):
            raise ValueError(f"it needs the extension {quoted(str(name))}; export it without")
    return dict(header), binary


def extension(entry: Json, *names: str) -> Json:
    """Return the first of some extensions that an entry has; empty without any."""
    extensions = entry.get("extensions", {})
    return next((dict(extensions[name]) for name in names if name in extensions), {})


def image_of(header: Json, texture: Json) -> int:
    """Number of the image of a texture's entry in a material."""
    entry = header["textures"][texture["index"]]
    return int({**extension(entry, *PICTURES), **entry}["source"])


class GltfFile:
    """JSON of a glTF file, with the values of its accessors."""

    def __init__(self, contents: Mapping[str, bytes]) -> None:
        self.name = next(iter(contents))
        self.header, binary = parts_of(contents[self.name])
        self._contents, self._binary = contents, binary
        entries = self.header.get("buffers", ())
        self._buffers = [b"" if stands_in(entry) else self._bytes(entry) for entry in entries]
        for number, (entry, content) in enumerate(zip(entries, self._buffers, strict=True)):
            if entry["byteLength"] > len(content) and not stands_in(entry):
                raise ValueError(f"buffers.{number} ends early")
        self._decoded: dict[int, Any] = {}
        """Content of compressed views by number, and meshes by the number of theirs."""
        decoded_bytes = 0
        for number, view in enumerate(self.header.get("bufferViews", ())):
            if packed := extension(view, *MESHOPT):
                size, row = view["byteLength"], packed["byteStride"]
                if (size, view.get("byteStride", row)) != (packed["count"] * row, row):
                    raise ValueError(f"bufferViews.{number} and what it unpacks to differ in size")
                decoded_bytes += size
            self._part(packed or view, number)
        check_decoded(self.name, (decoded_bytes,), 3)

    def _bytes(self, entry: Json) -> bytes:
        """Content of a buffer or an image."""
        uri = entry.get("uri")
        if uri is None:
            return self._binary
        if uri.startswith("data:"):
            return base64.b64decode(uri.partition("base64,")[2])
        return self._contents[unquote(uri)]

    def image(self, number: int) -> bytes:
        """Content of an image's file."""
        entry = self.header["images"][number]
        view = entry.get("bufferView")
        return self._bytes(entry) if view is None else bytes(self._view(view))

    def _part(self, entry: Json, number: int) -> memoryview:
        """Part of a buffer that a view names, or the compressed data in its place."""
        start, size = entry.get("byteOffset", 0), entry["byteLength"]
        buffer = memoryview(self._buffers[entry["buffer"]])
        if min(start, size) < 0 or start + size > len(buffer):
            raise ValueError(f"bufferViews.{number} reaches beyond its {len(buffer)} bytes")
        return buffer[start : start + size]

    def _view(self, number: int) -> memoryview:
        entry = self.header["bufferViews"][number]
        packed = extension(entry, *MESHOPT)
        if not packed:
            return self._part(entry, number)
        if number not in self._decoded:
            import meshopt

            rows = meshopt.decode_gltf_buffer(
                bytes(self._part(packed, number)), packed["count"], packed["byteStride"],
                packed["mode"], packed.get("filter"),
            )  # fmt: skip
            self._decoded[number] = np.ascontiguousarray(rows).tobytes()
        return memoryview(self._decoded[number])

    def values(self, number: int) -> NDArray[Any]:
        """Values (n, k) of an accessor: integers, or float64."""
        entry = self.header["accessors"][number]
        shape = entry["count"], _WIDTHS[entry["type"]]
        values = self._read(entry, shape, entry["componentType"])
        if "sparse" in entry:
            sparse = entry["sparse"]
            places, stored = sparse["indices"], sparse["values"]
            at = self._read(places, (sparse["count"], 1), places["componentType"])[:, 0]
            values = values.copy()
            values[at] = self._read(stored, (sparse["count"], shape[1]), entry["componentType"])
        return _numbers(values, entry)

    def _read(self, entry: Json, shape: tuple[int, int], component: int) -> NDArray[Any]:
        kind = np.dtype(_TYPES[component])
        check_decoded(self.name, shape, 24)  # bytes, with copies
        if "bufferView" not in entry:
            return np.zeros(shape, kind)
        step = self.header["bufferViews"][entry["bufferView"]].get("byteStride")
        strides = step or kind.itemsize * shape[1], kind.itemsize
        # numpy refuses an array that would reach beyond the bytes.
        start = entry.get("byteOffset", 0)
        return np.ndarray(shape, kind, self._view(entry["bufferView"]), start, strides)

    def attributes(self, part: Json, *names: str) -> dict[str, NDArray[Any]]:
        """Values (V, k) of some attributes that a primitive has, and indices (n,) if it has any."""
        stated = {name: part["attributes"][name] for name in names if name in part["attributes"]}
        stated |= {"indices": part["indices"]} if "indices" in part else {}
        packed = extension(part, DRACO)
        if not packed:
            return {name: self.values(accessor) for name, accessor in stated.items()}
        entries = {name: self.header["accessors"][number] for name, number in stated.items()}
        mesh, values = self._unpacked(packed["bufferView"], entries["indices"]["count"]), {}
        for name in stated.keys() & {*packed["attributes"], "indices"}:
            data = mesh.faces.reshape(-1, 1)
            if name != "indices":
                data = mesh.get_attribute_by_unique_id(packed["attributes"][name])["data"]
            values[name] = _numbers(data.reshape(len(data), -1), entries[name])
            if values[name].shape != (entries[name]["count"], _WIDTHS[entries[name]["type"]]):
                raise ValueError(f"what Draco decodes of {name} is not what it states")
        return values

    def _unpacked(self, view: int, corners: int) -> Any:
        """Mesh that Draco decodes from a view, once; of a stated number of corners."""
        if view not in self._decoded:
            content = bytes(self._view(view))
            triangles = _draco_triangles(content)
            if triangles != corners / 3:
                raise ValueError(f"Draco's data hold {triangles} triangles, not {corners / 3:g}")
            check_decoded(self.name, (triangles,), 1000)  # bytes of a triangle, with its corners
            import DracoPy

            self._decoded[view] = DracoPy.decode(content)
        return self._decoded[view]


def stands_in(buffer: Json) -> bool:
    """True if a buffer only takes the place of compressed data, for programs that cannot decode."""
    return bool(extension(buffer, *MESHOPT).get("fallback"))


def _numbers(values: NDArray[Any], entry: Json) -> NDArray[Any]:
    if entry.get("normalized") and values.dtype.kind != "f":
        return np.maximum(values / np.iinfo(values.dtype).max, -1.0)
    return values.astype(np.float64) if values.dtype.kind == "f" else values


def _draco_triangles(content: bytes) -> int:
    """Triangles that Draco's data state (Draco bitstream 2.2). Raises ValueError for others."""
    name, version, kind, method, flags = struct.unpack_from("<5sH2BH", content)
    if (name, version, kind, flags) != (b"DRACO", 0x0202, 1, 0) or method > 1:
        raise ValueError("its Draco data are no mesh of version 2.2 without metadata")
    place, number = 11 + method, 0  # a byte tells how connected triangles are traversed
    for _ in range(1 + method):  # if they are, the vertices come first
        number = 0
        for shift in range(0, 35, 7):
            number |= (content[place] & 127) << shift
            place += 1
            if content[place - 1] < 128:
                break
    return number
