"""Single pictures, and pictures in a folder.

8 bits are read with Pillow; 16-bit PNG and TIFF, in full depth, and Radiance with OpenCV; EXR with
OpenEXR.
"""

import logging
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, NamedTuple

import cv2
import numpy as np
import tifffile
from numpy.typing import NDArray
from PIL import Image, ImageOps

from megalopta.core.bounded import ARRAY_BYTES, check_count, check_file, quoted, read_bytes
from megalopta.core.errors import DamagedFileError, UserError
from megalopta.core.pictures import checked_png, opened_picture, readable
from megalopta.core.progress import working
from megalopta.render.exr import read_channels, read_header, size_in
from megalopta.render.footage.frames import Coding, Footage, Unit, check_size, coding_of, turned
from megalopta.render.footage.transfer import to_bt709

KINDS: Mapping[str, str] = {
    **dict.fromkeys((".png",), "PNG"),
    **dict.fromkeys((".jpg", ".jpeg"), "JPEG"),
    **dict.fromkeys((".tif", ".tiff"), "TIFF"),
    **dict.fromkeys((".bmp",), "BMP"),
    **dict.fromkeys((".ppm", ".pgm"), "PPM"),
    **dict.fromkeys((".webp",), "WebP"),
    **dict.fromkeys((".gif",), "GIF"),
    **dict.fromkeys((".exr",), "EXR"),
    **dict.fromkeys((".hdr",), "Radiance"),
}
"""Kind of picture by the suffix of its file."""

Depth = Literal["8 bits", "16 bits", "light"]
_UNITS: Mapping[Depth, tuple[Unit, ...]] = {
    "8 bits": ("srgb",),
    "16 bits": ("srgb", "linear"),
    "light": ("linear", "cd/m2"),
}
"""Possible units of each depth, the default first."""
TRANSPARENT = "transparent parts are shown over black"
_ORIENTATION = 0x0112
_TURNS = {
    2: (False, True, False),
    3: (False, True, True),
    4: (False, False, True),
    5: (True, False, False),
    6: (True, True, False),
    7: (True, True, True),
    8: (True, False, True),
}
"""Arguments of `turned` for an Exif orientation."""
_PNG_CHUNKS = (b"IHDR", b"PLTE", b"tRNS", b"IDAT", b"IEND")
_RADIANCE_SIZE = re.compile(rb"\n\n-Y (\d{1,9}) \+X (\d{1,9})\n")

logging.getLogger("tifffile").addHandler(logging.NullHandler())  # we report errors ourselves


class _Header(NamedTuple):
    """Information in a file's header."""

    shape: tuple[int, int]
    depth: Depth
    orientation: int = 1
    chromaticities: tuple[float, ...] | None = None
    notes: tuple[str, ...] = ()


@dataclass(eq=False, kw_only=True)
class PictureFiles(Footage):
    """Pictures of equal size and kind, one frame each."""

    depth: Depth

    def __len__(self) -> int:
        """Return the number of pictures."""
        return len(self.files)

    def _numbers(self, index: int) -> NDArray[Any]:
        path = self.files[index]
        numbers = self._read(path)
        if numbers.shape[:2] != self.shape:
            raise DamagedFileError(
                f"{path} has another size than before; do not change it meanwhile"
            )
        return numbers

    def _read(self, path: Path) -> NDArray[Any]:
        kind = picture_kind(path)
        if kind == "EXR":
            return self._as_light(_exr_light(path), path)
        if kind == "Radiance" or self.depth != "8 bits":
            return self._deep(path)
        with opened_picture(path) as image:
            codes, is_transparent = over_black(ImageOps.exif_transpose(image))
        return self._told(codes, is_transparent)

    def _deep(self, path: Path) -> NDArray[Any]:
        numbers = _decoded(path)
        if picture_kind(path) == "PNG":  # OpenCV has already turned TIFF
            numbers = turned(numbers, *_TURNS.get(header_of(path).orientation, (False,) * 3))
        is_transparent = numbers.shape[2:] == (4,) and numbers[..., 3].min() < _top(numbers)
        if is_transparent:
            over = numbers[..., :3] * (numbers[..., 3:] / _top(numbers))
            numbers[..., :3] = over if self.depth == "light" else np.rint(over)
        numbers = numbers if numbers.ndim == 2 else numbers[..., 2::-1]
        numbers = self._as_light(numbers, path) if self.depth == "light" else numbers
        return self._told(numbers, is_transparent)

    def _told(self, numbers: NDArray[Any], is_transparent: bool) -> NDArray[Any]:
        if is_transparent:
            self._note(TRANSPARENT)
        return numbers


def open_picture(path: Path, unit: Unit | None) -> PictureFiles:
    """Return a picture as one frame. Raises UserError."""
    footage = _pictures(path, (path,), unit, header_of(path))
    footage.frame(0)  # reports errors of the file now
    return footage


def open_folder(path: Path, unit: Unit | None) -> PictureFiles:
    """Return the pictures of a folder, in the order of the numbers in their names.

    Raises UserError if there are none, or they differ in size or kind.
    """
    visible = [each for each in path.iterdir() if not each.name.startswith(".") and each.is_file()]
    files = tuple(sorted((each for each in visible if picture_kind(each)), key=natural_key))
    if not files:
        raise UserError(f"{path} has no picture in it; give a folder of {', '.join(KINDS)} files")
    with working(f"headers of the pictures in {path}"):
        footage = _pictures(path, files, unit, _common_header(files))
    footage.notes += (*_left_out(path, visible, files), *_order(files))
    footage.frame(0)
    return footage


def picture_kind(path: Path) -> str | None:
    """Return the kind of picture by the suffix; None if it is not one."""
    return KINDS.get(path.suffix.lower())


def natural_key(path: Path) -> list[tuple[int, str]]:
    """Return a sort key by the numbers in names: frame 9 before frame 10."""
    parts = re.split("([0-9]+)", path.name)
    return [(int(part), "") if k % 2 else (-1, part) for k, part in enumerate(parts)] + [
        (-2, path.name)
    ]


def over_black(image: Image.Image) -> tuple[NDArray[np.uint8], bool]:
    """Return codes, (H, W) of gray or (H, W, 3), and True if any were transparent."""
    if image.has_transparency_data:
        layers = image.convert("RGBA")
        if np.asarray(layers)[..., 3].min() < 255:
            black = Image.new("RGBA", image.size, (0, 0, 0, 255))
            return np.asarray(Image.alpha_composite(black, layers).convert("RGB")), True
    return np.asarray(image.convert("L" if image.mode in ("1", "L", "LA") else "RGB")), False


def _pictures(
    path: Path, files: tuple[Path, ...], unit: Unit | None, header: _Header
) -> PictureFiles:
    return PictureFiles(
        path=path,
        files=files,
        shape=header.shape,
        coding=_coding(path, unit, header),
        depth=header.depth,
        notes=header.notes,
    )


def _coding(path: Path, unit: Unit | None, header: _Header) -> Coding:
    units = _UNITS[header.depth]
    if unit is not None and unit not in units:
        what = header.depth if header.depth != "light" else "light in floating point"
        raise UserError(
            f"{path} holds {what}, whose unit can be {' or '.join(units)}, not {unit}; omit it"
        )
    unit = unit or units[0]
    if header.depth == "light":
        matrix = None if header.chromaticities is None else to_bt709(header.chromaticities)
        return Coding("cd/m²" if unit == "cd/m2" else "linear", unit, matrix=matrix)
    codes = 256 if header.depth == "8 bits" else 65536
    return replace(coding_of("sRGB" if unit == "srgb" else "linear", codes), unit=unit)


def _common_header(files: tuple[Path, ...]) -> _Header:
    kinds = {picture_kind(each): each for each in files}
    if len(kinds) > 1:
        one, other = list(kinds.values())[:2]
        raise UserError(f"{one} and {other.name} differ in kind; give a folder with one kind")
    first = header_of(files[0])
    for path in files[1:]:
        header = header_of(path)
        if header.shape != first.shape:
            sizes = ("{1} × {0}".format(*each.shape) for each in (first, header))
            raise UserError(
                f"{files[0]} and {path.name} differ in size ({' and '.join(sizes)} px); "
                "give pictures of one size"
            )
        if (header.depth, header.chromaticities) != (first.depth, first.chromaticities):
            raise UserError(f"{files[0]} and {path.name} differ in bits or colors; save all alike")
    return first


def _left_out(path: Path, visible: list[Path], files: tuple[Path, ...]) -> Iterator[str]:
    others = sorted({each.name for each in visible} - {each.name for each in files})
    if others:
        yield f"{path} holds other files, which are omitted ({quoted(', '.join(others))})"


def _order(files: tuple[Path, ...]) -> Iterator[str]:
    names = [each.name for each in files]
    ends = f"{names[0]} first, {names[-1]} last"
    if len(names) > 1 and not all(re.search("[0-9]", each) for each in names):
        yield f"not all names have a number, so pictures are in alphabetical order: {ends}"
    elif names != sorted(names):
        yield f"pictures are in order of the numbers in their names, not alphabetical: {ends}"


def header_of(path: Path) -> _Header:
    """Return the information in a file's header.

    Raises DamagedFileError, also if its pixels do not fit into the budget.
    """
    with readable(path):
        check_file(path)
        if not path.stat().st_size:
            raise DamagedFileError(f"{path} is empty; save the picture again")
        readers = {"EXR": _exr_header, "Radiance": _radiance_header, "TIFF": _tiff_header}
        header = readers.get(str(picture_kind(path)), _pillow_header)(path)
    check_size(path, header.shape)
    return header


def _pillow_header(path: Path) -> _Header:
    with opened_picture(path) as image:
        if frames_in(image) > 1:
            raise DamagedFileError(f"{path} is animated; give it alone, not a folder")
        _check_colors(path, image.mode)
        tiles = getattr(image, "tile", [])
        numbers = str(tiles[0].args) if tiles else ""
        is_deep = image.mode[0] in "IF" or ";16" in numbers
        if image.format != "PNG" and (is_deep or re.search(r", (?!255\b)\d{3,}", numbers)):
            raise DamagedFileError(f"{path} has more than 8 bits; save it as PNG or TIFF")
        orientation = image.getexif().get(_ORIENTATION, 1)
        columns, rows = image.size[:: -1 if orientation >= 5 else 1]
        notes = _colors_left_out(path, image.info.get("icc_profile") or b"")
        return _Header(
            (rows, columns), "16 bits" if is_deep else "8 bits", orientation, None, notes
        )


def frames_in(image: Image.Image) -> int:
    """Return the number of frames of a possibly animated picture; otherwise 1."""
    return getattr(image, "n_frames", 1) if image.format in ("GIF", "PNG", "WEBP") else 1


def _check_colors(path: Path, mode: str) -> None:
    if mode in ("CMYK", "LAB"):
        raise DamagedFileError(f"{path} has the colors {mode} of prints; save it in sRGB")


def _colors_left_out(path: Path, profile: bytes) -> tuple[str, ...]:
    if not profile or b"sRGB" in profile or "sRGB".encode("utf-16-be") in profile:
        return ()
    return (f"{path} has a color profile, which is ignored; its colors are treated as sRGB",)


def _tiff_header(path: Path) -> _Header:
    with tifffile.TiffFile(path) as file:
        with suppress(IndexError):
            file.pages[1]  # the number of pages would be counted one by one
            raise DamagedFileError(
                f"{path} has several pages; save each as a picture, or all as .npy"
            )
        page = file.pages.first
        check_count(path, "samples of a pixel", page.samplesperpixel, 4)
        _check_colors(path, "CMYK" if page.photometric == tifffile.PHOTOMETRIC.SEPARATED else "")
        depth = _tiff_depth(path, page)
        tag = page.tags.get(_ORIENTATION)
        orientation = int(tag.value) if tag else 1
        rows, columns = page.imagelength, page.imagewidth
        shape = (columns, rows) if orientation >= 5 else (rows, columns)
        return _Header(shape, depth, orientation)


def _tiff_depth(path: Path, page: tifffile.TiffPage) -> Depth:
    bits, kind = page.bitspersample, np.dtype(page.dtype).kind
    if bits <= 8 and kind in "ub":
        return "8 bits"
    is_gray_or_rgb = page.photometric in (tifffile.PHOTOMETRIC.MINISBLACK, tifffile.PHOTOMETRIC.RGB)
    if not is_gray_or_rgb or (kind, bits) not in (("u", 16), ("f", 32), ("f", 64)):
        raise DamagedFileError(
            f"{path} has {bits} bits of {kind} in a layout that is not read; save it as gray or "
            "RGB, of 8 or 16 bits or in float32"
        )
    return "16 bits" if kind == "u" else "light"


def _radiance_header(path: Path) -> _Header:
    with path.open("rb") as file:
        found = _RADIANCE_SIZE.search(file.read(65536))
    if found is None:
        raise DamagedFileError(f"{path} is no Radiance picture (-Y … +X …); save it again")
    return _Header((int(found[1]), int(found[2])), "light")


def _exr_header(path: Path) -> _Header:
    header = read_header(path)
    names = [str(each.name) for each in header["channels"]]
    if any(name.startswith("S0.") for name in names):
        raise DamagedFileError(f"{path} holds spectral radiance; give its dataset")
    if not ({"R", "G", "B"} <= set(names) or names in (["Y"], ["A", "Y"])):
        raise DamagedFileError(
            f"{path} has the channels {quoted(', '.join(names))}; give one with R, G, B, or Y alone"
        )
    return _of_primaries(path, size_in(header), header.get("chromaticities"))


def _of_primaries(path: Path, shape: tuple[int, int], chromaticities: Any) -> _Header:
    if chromaticities is None:
        return _Header(shape, "light")
    given = tuple(np.ravel(chromaticities).tolist())
    if np.allclose(to_bt709(given), np.eye(3), atol=1e-3):
        return _Header(shape, "light")
    note = f"{path} states its primaries; its light is converted to those of sRGB"
    return _Header(shape, "light", 1, given, (note,))


def _exr_light(path: Path) -> NDArray[Any]:
    with readable(path):
        _, channels = read_channels(path)
        names = "RGB" if "R" in channels else "Y"
        planes = [np.asarray(channels[name], np.float32) for name in names]
        return np.stack(planes, axis=-1) if len(planes) == 3 else planes[0]


@contextmanager
def _without_log() -> Iterator[None]:
    log = cv2.utils.logging
    level = log.getLogLevel()
    log.setLogLevel(log.LOG_LEVEL_SILENT)
    try:
        yield
    finally:
        log.setLogLevel(level)


def _decoded(path: Path) -> NDArray[Any]:
    """Return numbers (H, W), (H, W, 3) or (H, W, 4) as OpenCV decodes them, blue first."""
    with readable(path), _without_log():
        if picture_kind(path) == "Radiance":  # OpenCV decodes it from files only
            check_file(path)
            numbers = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        else:  # not from the file: OpenCV 5 cannot turn a TIFF from there
            content = read_bytes(path, ARRAY_BYTES)
            plain = checked_png(content, _PNG_CHUNKS) if picture_kind(path) == "PNG" else content
            numbers = cv2.imdecode(np.frombuffer(plain, np.uint8), cv2.IMREAD_UNCHANGED)
        if numbers is None or numbers.shape[2:] not in ((), (3,), (4,)):
            raise ValueError(path)
        return np.asarray(numbers)


def _top(numbers: NDArray[Any]) -> float:
    return float(np.iinfo(numbers.dtype).max) if numbers.dtype.kind == "u" else 1.0
