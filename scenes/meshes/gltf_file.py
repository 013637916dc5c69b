"""Container of glTF 2.0: the JSON part, its buffers, and what its accessors read from them.

Khronos Group, glTF 2.0 Specification. Everything is read by index from JSON of a stranger: errors
of any kind mean a damaged file.
"""

import base64
import struct
from collections.abc import Mapping
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from megalopta.core.bounded import check_decoded, from_json, quoted

_JSON, _BINARY, _MOST_PARTS = 0x4E4F534A, 0x004E4942, 100
_TYPES = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
_VALUE_BYTES = 24
"""Memory of a value that an accessor reads, with its copies."""
_WEBP = "EXT_texture_webp"
EFFECTIVE = (
    *("KHR_texture_transform", "KHR_mesh_quantization", _WEBP),
    "KHR_materials_pbrSpecularGlossiness",
)
"""Extensions that have an effect."""

Json = Mapping[str, Any]


def parts_of(content: bytes) -> tuple[Json, bytes]:
    """Return the JSON and the binary part, perhaps empty, of a file. Raises ValueError."""
    if content[:4] != b"glTF":
        if content.lstrip()[:1] != b"{":
            raise ValueError("it is neither binary glTF nor JSON")
        return _checked(from_json(content.decode("utf-8"))), b""
    (length,) = struct.unpack_from("<I", content, 8)
    if length != len(content):
        raise ValueError(f"it states {length} bytes, and has {len(content)}")
    parts: dict[int, bytes] = {}
    place = 12
    while place + 8 <= length:
        size, kind = struct.unpack_from("<II", content, place)
        if place + 8 + size > len(content):
            raise ValueError("it ends early")
        if kind in parts or len(parts) == _MOST_PARTS:
            raise ValueError("it has two parts of one kind, or too many")
        parts[kind] = content[place + 8 : place + 8 + size]
        place += 8 + size
    return _checked(from_json(parts[_JSON].decode("utf-8"))), parts.get(_BINARY, b"")


def _checked(header: Any) -> Json:
    version = str(header["asset"]["version"])
    if version.split(".")[0] != "2":
        raise ValueError(f"it has version {quoted(version)} of glTF, not 2")
    for name in header.get("extensionsRequired", ()):
        if name not in EFFECTIVE and not str(name).startswith(("KHR_materials_", "KHR_lights_")):
            raise ValueError(f"it needs the extension {quoted(str(name))}; export it without")
    return dict(header)


def names_in(content: bytes) -> list[str]:
    """Names of the files with buffers and colors that a glTF file names. Raises any exception."""
    header, _ = parts_of(content)
    textures = (color_of(each)[1] for each in header.get("materials", ()))
    images = [header["images"][image_of(header, each)] for each in textures if each is not None]
    uris = [each["uri"] for each in [*header.get("buffers", ()), *images] if "uri" in each]
    return [unquote(uri) for uri in uris if not uri.startswith("data:")]


def color_of(material: Json) -> tuple[list[float], Json | None]:
    """Color factor, in linear sRGB, and entry of the texture, or None, of a material."""
    extensions = material.get("extensions", {})
    if "KHR_materials_pbrSpecularGlossiness" in extensions:
        model = extensions["KHR_materials_pbrSpecularGlossiness"]
        return model.get("diffuseFactor", [1, 1, 1])[:3], model.get("diffuseTexture")
    model = material.get("pbrMetallicRoughness", {})
    return model.get("baseColorFactor", [1, 1, 1])[:3], model.get("baseColorTexture")


def image_of(header: Json, texture: Json) -> int:
    """Number of the image of a texture's entry in a material."""
    entry = header["textures"][texture["index"]]
    return int(entry.get("extensions", {}).get(_WEBP, entry)["source"])


class GltfFile:
    """JSON of a glTF file, with the values of its accessors."""

    def __init__(self, contents: Mapping[str, bytes]) -> None:
        self.header, binary = parts_of(next(iter(contents.values())))
        self._contents, self._binary = contents, binary
        self._buffers = [self._bytes(each) for each in self.header.get("buffers", ())]
        for number, entry in enumerate(self.header.get("buffers", ())):
            if entry["byteLength"] > len(self._buffers[number]):
                raise ValueError(f"buffers.{number} ends early")
        for number in range(len(self.header.get("bufferViews", ()))):
            self._view(number)

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
        return (
            bytes(self._view(entry["bufferView"])) if "bufferView" in entry else self._bytes(entry)
        )

    def _view(self, number: int) -> memoryview:
        entry = self.header["bufferViews"][number]
        start, size = entry.get("byteOffset", 0), entry["byteLength"]
        buffer = memoryview(self._buffers[entry["buffer"]])
        if min(start, size) < 0 or start + size > len(buffer):
            raise ValueError(f"bufferViews.{number} reaches beyond its {len(buffer)} bytes")
        return buffer[start : start + size]

    def values(self, number: int) -> NDArray[Any]:
        """Values (n, k) of an accessor: integers, or float64."""
        entry = self.header["accessors"][number]
        shape = entry["count"], _WIDTHS[entry["type"]]
        kind = np.dtype(_TYPES[entry["componentType"]])
        check_decoded(next(iter(self._contents)), shape, _VALUE_BYTES)
        found = self._array(entry, kind, shape) if "bufferView" in entry else np.zeros(shape, kind)
        if sparse := entry.get("sparse"):
            found, size = found.copy(), (sparse["count"], 1)
            of_place = np.dtype(_TYPES[sparse["indices"]["componentType"]])
            place = self._array(sparse["indices"], of_place, size).ravel()
            found[place] = self._array(sparse["values"], kind, (size[0], shape[1]))
        if entry.get("normalized"):
            return np.maximum(found / np.iinfo(kind).max, -1.0)
        return found.astype(np.float64) if kind.kind == "f" else found

    def _array(self, entry: Json, kind: "np.dtype[Any]", shape: tuple[int, int]) -> NDArray[Any]:
        step = self.header["bufferViews"][entry["bufferView"]].get("byteStride")
        strides = step or kind.itemsize * shape[1], kind.itemsize
        start = entry.get("byteOffset", 0)
        # numpy refuses an array that would reach beyond the bytes.
        return np.ndarray(shape, kind, self._view(entry["bufferView"]), start, strides)
