"""Meshes of a file in one form, whatever the format: pieces of one object and one material."""

import io
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from megalopta.assets_gen import cross, lengths
from megalopta.core.arrays import Floats, Ints
from megalopta.core.bounded import check_decoded
from megalopta.core.pictures import decoded, readable
from megalopta.scenes.material import ColorTexture, Material
from megalopta.scenes.meshes.animation import FigureMotion, NodeMotion
from megalopta.scenes.spectra import color as colors
from megalopta.scenes.spectra.spectrum import Spectrum, flat

_FARTHEST = 1e12
"""Largest coordinate of a map, as of a camera."""
Unused = tuple[str, str]
"""Property in a file that has no effect, and the name of its owner, perhaps empty."""


@dataclass(frozen=True)
class Paint:
    """Surface of a piece."""

    name: str | None = None
    """Name of its material; None: it has none."""
    material: Material | None = None
    """None: the file tells no color, or a surface that is not rendered."""
    refused: str = ""
    """Description of a surface that is not rendered, unless its reflectance is given."""
    radiance: Spectrum | None = None
    """Radiance of a lamp, W·m⁻²·sr⁻¹·nm⁻¹."""


def colored(color: ArrayLike, picture: NDArray[np.float32] | None = None) -> Material:
    """Return the surface of a color (3,), times that of a picture (H, W, 3), in linear sRGB."""
    if picture is None:
        return Material(colors.reflectance_of_color(color), known_nm=colors.KNOWN_NM)
    if (np.asarray(color) != 1).any():
        picture = picture * np.asarray(color, np.float32)
    texture = ColorTexture(picture, (colors.RED, colors.GREEN, colors.BLUE))
    return Material(flat(0.0), texture, known_nm=colors.KNOWN_NM)


@dataclass(frozen=True)
class Piece:
    """Triangles of one object and one material, in the axes and units of the file."""

    number: int
    """Number of the object in the file."""
    name: str
    """Name of the object."""
    vertices: Floats
    """(V, 3)."""
    faces: Ints
    """(F, 3): vertex indices."""
    paint: Paint = Paint()
    normals: Floats | None = None
    """(V, 3): normals of a smooth surface, of any length; None: flat faces."""
    uv: Floats | None = None
    """(V, 2): coordinates of the picture."""
    motion: NodeMotion | FigureMotion | None = None
    """Motion with the object's node; None: at rest."""

    @property
    def material(self) -> str:
        """Name of the material, or of the object without one."""
        return self.name if self.paint.name is None else self.paint.name

    def __post_init__(self) -> None:
        """Reject triangles of vertices that are not there, or not at a place."""
        if not np.isfinite(self.vertices).all():
            raise ValueError(f"object {self.name!r} has vertices that are not finite")
        if len(self.faces) and not 0 <= self.faces.min() <= self.faces.max() < len(self.vertices):
            raise ValueError(f"object {self.name!r} has triangles of vertices that are not there")

    def moved(self, matrix: Floats) -> "Piece":
        """Return the piece after a linear map (4, 4), which may mirror."""
        linear = matrix[:3, :3]
        vertices = self.vertices @ linear.T + matrix[:3, 3]
        x, y, z = linear
        # Cofactors: the inverse transpose up to sign and length, if there is one.
        turn = np.stack([np.cross(y, z), np.cross(z, x), np.cross(x, y)])
        normals = None if self.normals is None else self.normals @ turn.T
        faces = self.faces[:, ::-1] if np.linalg.det(linear) < 0 else self.faces
        moved = replace(self, vertices=vertices, faces=faces, normals=normals)
        return replace(moved, motion=self.motion.moved(matrix)) if self.motion else moved

    def sound(self) -> "Piece":
        """Return the piece without faces of no area, and with normals on the side of its faces."""
        a, b, c = (self.vertices[corner] for corner in self.faces.T)
        facing = cross(b - a, c - a)
        solid = lengths(facing) > 0
        faces, facing = self.faces[solid], facing[solid]
        normals = self.normals
        if normals is not None:
            corners, of_corner = faces.ravel(), np.repeat(facing, 3, axis=0)
            sums = [np.bincount(corners, axis, len(self.vertices)) for axis in of_corner.T]
            beside = np.stack(sums, axis=1)
            size = np.linalg.norm(normals, axis=1)
            known = np.isfinite(size) & (size > 0)
            normals = np.where(known[:, None], normals, beside)
            is_turned = (normals * beside).sum(axis=1)[:, None] < 0
            normals = np.where(is_turned, -normals, normals)
            size = np.linalg.norm(normals, axis=1, keepdims=True)
            normals = np.where(size > 0, normals / np.where(size > 0, size, 1), [0.0, 0.0, 1.0])
        return replace(self, faces=faces, normals=normals)


def check_map(matrix: Floats, where: str, may_flatten: bool = False) -> None:
    """Refuse a map (4, 4) of a file that takes shapes to no place, or off space.

    Raises ValueError that begins with `where`.
    """
    if not (np.abs(matrix) <= _FARTHEST).all():
        raise ValueError(f"{where} is not finite, or beyond {_FARTHEST:g}")
    if (matrix[3] != [0, 0, 0, 1]).any():
        raise ValueError(f"{where} is a perspective map")
    if not may_flatten and np.linalg.cond(matrix[:3, :3]) > 1e12:  # ratio of scales
        raise ValueError(f"{where} leaves no volume")


_GRAY, _KTX2 = ("1", "L", "LA"), b"\xabKTX 20\xbb"
TEXEL_BYTES = 40
"""Memory of a pixel of a picture, decoded and loaded (bytes, measured)."""


def check_pictures(owner: str, pictures: Iterable[NDArray[np.float32]]) -> None:
    """Raise TooLargeError if pictures (H, W, C), each counted once, do not fit into the budget."""
    values = {id(picture): picture.size for picture in pictures}
    check_decoded(f"{owner} with its pictures", (sum(values.values()),), TEXEL_BYTES / 3)


def weights_of(materials: Iterable[Material | None]) -> Iterator[NDArray[np.float32]]:
    """Yield the pictures of materials."""
    for material in filter(None, materials):
        if material.texture:
            yield material.texture.weight
        for plug_in in material.finish.tree() if material.finish else ():
            if isinstance(picture := plug_in.parts.get("bitmap"), np.ndarray):
                yield picture.astype(np.float32, copy=False)


def linear_picture(content: bytes, material: str) -> NDArray[np.float32]:
    """Return colors (H, W, 3) in linear sRGB of a material's picture; row 0 is at v = 0, below.

    Raises DamagedFileError.
    """
    texels = texels_of(content, material)[::-1]
    return np.ascontiguousarray(texels if texels.shape[2] > 1 else texels.repeat(3, axis=-1))


def texels_of(content: bytes, material: str, is_coded: bool = True) -> NDArray[np.float32]:
    """Return texels (H, W, 1 or 3) of a material's picture, decoded from sRGB; row 0 is on top.

    Raises DamagedFileError.
    """
    codes = codes_of(content, material)
    levels = 2 ** (8 * codes.itemsize)
    shares = np.arange(levels) / (levels - 1)
    table = (colors.linear_of_srgb(shares) if is_coded else shares).astype(np.float32)
    return np.asarray(table[codes[..., :3]])


def codes_of(content: bytes, material: str) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """Return codes (H, W, 1), or with alpha (H, W, 4), of a material's picture; errors as above."""
    name = f"the picture of material {material!r}"
    if content.startswith(_KTX2):
        import opengl_basisu

        with readable(name):
            packed = opengl_basisu.open(content)
            check_decoded(name, (packed.height, packed.width), TEXEL_BYTES)
            return np.asarray(packed.transcode("rgba8").data)
    with decoded(io.BytesIO(content), name, TEXEL_BYTES) as image:
        is_deep, is_gray = image.mode.startswith("I;16"), image.mode in _GRAY
        codes = np.asarray(image if is_deep else image.convert("L" if is_gray else "RGBA"))
    return codes.reshape(*codes.shape[:2], -1)


MOST_OBJECTS = 10_000
"""Most objects, materials, nodes or pictures of a file."""
TRIANGLE_BYTES, TEXT_BYTES = 300, 16
"""Memory of a triangle, or of two vertices, in a scene, and of a byte of text (measured)."""


def check_triangles(name: str, count: int) -> None:
    """Raise TooLargeError if so many triangles do not fit into the budget."""
    check_decoded(name, (count,), TRIANGLE_BYTES)
