"""Pictures, folders of them, animations, arrays and films as footage, by suffix."""

import math
import re
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageOps

from megalopta.core import bounded
from megalopta.core.errors import DamagedFileError, UserError, machine_problem
from megalopta.core.files import natural_key
from megalopta.core.pictures import opened_picture, readable
from megalopta.core.progress import working
from megalopta.render.footage import formats, frames
from megalopta.render.footage.film import DEMUXERS, Film

KINDS: Mapping[str, str] = {
    ".png": "PNG",
    **dict.fromkeys((".jpg", ".jpeg"), "JPEG"),
    ".bmp": "BMP",
    **dict.fromkeys((".ppm", ".pgm"), "PPM"),
    ".webp": "WebP",
    ".gif": "GIF",
    ".exr": "EXR",
    ".hdr": "Radiance",
}
"""Kind of picture by the suffix of its file."""

SUFFIXES = (*KINDS, *DEMUXERS, ".npy")
"""Suffixes of supported files."""
_UNITS: Mapping[frames.Depth, tuple[frames.Unit, ...]] = {
    "8 bits": ("srgb",),
    "16 bits": ("srgb", "linear"),
    "light": ("linear", "cd/m2"),
}
"""Possible units of each depth, the default first."""
_ORIENTATION, _EXIF, _GPS = 0x0112, 0x8769, 0x8825
_EXIF_TOLD = {0x829A: "ExposureTime", 0x829D: "FNumber", 0x8827: "ISO", 0xA500: "Gamma"}
_MOST_FRAMES = 10_000
_SHORTEST_S = 0.1
"""Duration that browsers use for a frame with a duration of zero."""


class PictureFiles(frames.Footage):
    """Pictures of equal size and kind, one frame each, or the pages of one.

    Raises UserError for an impossible unit.
    """

    def __init__(
        self, path: Path, files: tuple[Path, ...], unit: frames.Unit | None, header: frames.Header
    ) -> None:
        coding = coding_stated(path, unit, header)
        super().__init__(
            path=path,
            files=files,
            count=len(files) * len(header.pages),
            shape=header.shape,
            coding=coding,
            times_s=None if header.times_s is None else np.array(header.times_s),
            notes=header.notes,
            bands_nm=header.bands_nm,
            last_s=header.last_s,
        )
        self.depth, self.pages = header.depth, header.pages
        # A picture of 8 bits stays open: frames of an animation build on the former ones.
        self._opened = ExitStack()
        self._image: tuple[Path, Image.Image] | None = None

    def close(self) -> None:
        """Close the file."""
        super().close()
        self._opened.close()
        self._image = None

    def _numbers(self, index: int) -> NDArray[Any]:
        file, page = divmod(index, len(self.pages))
        path = self.files[file]
        with readable(path):
            numbers, is_transparent = self._read(path, self.pages[page])
        if numbers.shape[:2] != self.shape:
            raise DamagedFileError(
                f"{path} has another size than before; do not change it meanwhile"
            )
        if is_transparent:
            self._note(frames.TRANSPARENT)
        return self._as_light(numbers, path) if self.depth == "light" else numbers

    def _read(self, path: Path, page: int) -> tuple[NDArray[Any], bool]:
        """Return codes or light, upright, over black; True if any is transparent."""
        kind = picture_kind(path)
        if kind == "EXR":
            return formats.exr_light(path)
        if kind == "Radiance":
            return formats.radiance_light(path)
        if self.depth == "8 bits":
            # Pillow cannot always seek backwards.
            if not self._image or self._image[0] != path or page < self._image[1].tell():
                self._opened.close()
                self._image = path, self._opened.enter_context(opened_picture(path))
            image = self._image[1]
            image.seek(page)
            return over_black(ImageOps.exif_transpose(image))
        return formats.png_numbers(path)


_NAMES: Mapping[frames.Unit, str] = {"srgb": "sRGB", "linear": "linear", "cd/m2": "cd/m²"}


class ArrayFrames(frames.Footage):
    """Frames of an array (H, W), (T, H, W), (H, W, 3) or (T, H, W, 3).

    `path` names it in messages. Raises UserError.
    """

    def __init__(self, values: NDArray[Any], unit: frames.Unit, path: Path) -> None:
        self._values = values
        if values.ndim == 2 or (values.ndim == 3 and values.shape[-1] == 3):
            self._values = values[None]
        shape = self._values.shape
        is_gray = len(shape) == 3 and shape[-1] not in (1, 2, 4)
        if 0 in shape or not (is_gray or (len(shape) == 4 and shape[-1] == 3)):
            raise DamagedFileError(
                f"{path} has the shape {shape}; give (H, W), (T, H, W), (H, W, 3) or "
                "(T, H, W, 3), without an alpha channel"
            )
        frames.check_size(path, shape[1:])
        dtype, coding = values.dtype, frames.Coding(_NAMES[unit], unit)
        if dtype.kind != "f":
            if dtype.kind != "u" or dtype.itemsize > 2:
                raise DamagedFileError(
                    f"{path} holds {dtype}; give uint8, uint16 or floating-point numbers"
                )
            codes = 256**dtype.itemsize
            coding = frames.coding_of("sRGB" if unit == "srgb" else "linear", codes)
            if unit == "cd/m2":
                coding = replace(coding, table=np.arange(codes, dtype=np.float32))
            coding = replace(coding, name=_NAMES[unit], unit=unit)
        super().__init__(path=path, files=(path,), count=shape[0], shape=shape[1:3], coding=coding)

    def _numbers(self, index: int) -> NDArray[Any]:
        numbers = np.asarray(self._values[index])
        if self.coding.table is not None:
            return numbers.astype(numbers.dtype.newbyteorder("="))
        if self.coding.unit != "srgb":
            return self._as_light(numbers, self.path)
        if not ((numbers >= 0) & (numbers <= 1)).all():
            raise DamagedFileError(
                f"{self.path} has values that are not between 0 and 1; scale them, or give the "
                "unit linear"
            )
        return self._as_light(frames.light_of("sRGB", numbers.astype(np.float64)), self.path)


def open_picture(path: Path, unit: frames.Unit | None) -> PictureFiles:
    """Return a picture as one frame. Raises UserError."""
    with ExitStack() as opened:
        footage = opened.enter_context(PictureFiles(path, (path,), unit, header_of(path)))
        footage.frame(0)  # reports errors of the file now
        opened.pop_all()
    return footage


def open_folder(path: Path, unit: frames.Unit | None) -> PictureFiles:
    """Return the pictures of a folder, in the order of the numbers in their names.

    Raises UserError if there are none, or they differ in size or kind.
    """
    visible = [item for item in path.iterdir() if not item.name.startswith(".") and item.is_file()]
    files = tuple(sorted((item for item in visible if picture_kind(item)), key=natural_key))
    if not files:
        raise UserError(f"{path} has no picture in it; give a folder of {', '.join(KINDS)} files")
    with working(f"headers of the pictures in {path}"):
        footage = PictureFiles(path, files, unit, _common_header(files))
    omitted = sorted({item.name for item in visible} - {item.name for item in files})
    if omitted:
        left_out = (
            f"{path} holds other files, which are omitted ({bounded.quoted(', '.join(omitted))})"
        )
        footage.notes += (left_out,)
    names, order = [file.name for file in files], ""
    if len(names) > 1 and not all(re.search("[0-9]", name) for name in names):
        order = "not all names have a number, so pictures are in alphabetical order"
    elif names != sorted(names):
        order = "pictures are in order of the numbers in their names, not alphabetical"
    if order:
        footage.notes += (f"{order}: {names[0]} first, {names[-1]} last",)
    footage.frame(0)
    return footage


def picture_kind(path: Path) -> str | None:
    """Return the kind of picture by the suffix; None if it is not one."""
    return KINDS.get(path.suffix.lower())


def over_black(image: Image.Image) -> tuple[NDArray[np.uint8], bool]:
    """Return codes, (H, W) of gray or (H, W, 3), and True if any were transparent."""
    if image.has_transparency_data:
        layers = image.convert("RGBA")
        if np.asarray(layers)[..., 3].min() < 255:
            black = Image.new("RGBA", image.size, (0, 0, 0, 255))
            return np.asarray(Image.alpha_composite(black, layers).convert("RGB")), True
    return np.asarray(image.convert("L" if image.mode in ("1", "L", "LA") else "RGB")), False


def coding_stated(path: Path, unit: frames.Unit | None, header: frames.Header) -> frames.Coding:
    """Return how a picture's values become light. Raises UserError for an impossible unit."""
    units = _UNITS[header.depth]
    if unit is not None and unit not in units:
        content = header.depth if header.depth != "light" else "light in floating point"
        raise UserError(
            f"{path} holds {content}, whose unit can be {' or '.join(units)}, not {unit}; omit it"
        )
    if header.bands_nm is not None:
        if unit is not None:
            raise UserError(f"{path} states spectral radiance; omit the unit {unit}")
        return frames.Coding("spectral radiance", "linear")
    matrix = None if header.chromaticities is None else frames.to_bt709(header.chromaticities)
    if header.depth == "light":
        unit = unit or header.unit or "linear"
        return frames.Coding("cd/m²" if unit == "cd/m2" else "linear", unit, matrix=matrix)
    codes = 256 if header.depth == "8 bits" else 65536
    transfer = "linear" if unit == "linear" else header.transfer or "sRGB"
    coding = frames.coding_of(transfer, codes)
    return replace(coding, unit=unit or "srgb", matrix=matrix)


def _common_header(files: tuple[Path, ...]) -> frames.Header:
    kinds = {picture_kind(file): file for file in files}
    if len(kinds) > 1:
        first_path, other_path = list(kinds.values())[:2]
        raise UserError(
            f"{first_path} and {other_path.name} differ in kind; give a folder with one kind"
        )
    first, notes = header_of(files[0]), dict[str, str]()
    for path in files:
        header = header_of(path) if path != files[0] else first
        if len(header.pages) > 1:
            raise DamagedFileError(f"{path} holds {len(header.pages)} pictures; give it alone")
        if header.shape != first.shape:
            sizes = ("{1} × {0}".format(*size.shape) for size in (first, header))
            raise UserError(
                f"{files[0]} and {path.name} differ in size ({' and '.join(sizes)} px); "
                "give pictures of one size"
            )
        if header._replace(notes=()) != first._replace(notes=()):
            raise UserError(f"{files[0]} and {path.name} differ in bits or colors; save all alike")
        for note in header.notes:  # those that differ by a number are reported once
            notes.setdefault(re.sub("[0-9.]+", "", note.replace(str(path), "")), note)
    return first._replace(notes=tuple(notes.values()))


def header_of(path: Path) -> frames.Header:
    """Return what a file states.

    Raises DamagedFileError, also if its pixels do not fit into the budget.
    """
    with readable(path):
        bounded.check_file(path)
        if not path.stat().st_size:
            raise DamagedFileError(f"{path} is empty; save the picture again")
        readers = {"EXR": formats.exr_header, "Radiance": formats.radiance_header}
        header = readers.get(str(picture_kind(path)), pillow_header)(path)
    frames.check_size(path, header.shape)
    return header


def pillow_header(path: Path) -> frames.Header:
    """Return what a file states that Pillow reads. Raises DamagedFileError."""
    with opened_picture(path) as image:
        if image.mode in ("CMYK", "LAB"):
            raise DamagedFileError(f"{path} has the colors {image.mode} of prints; save it in sRGB")
        tiles: Any = getattr(image, "tile", [])
        values = tiles[0].args if tiles else ""
        is_deep = image.mode[0] in "IF" or (image.format == "PNG" and ";16" in str(values))
        largest = values[1] if image.format == "PPM" and isinstance(values, tuple) else 255
        if image.format != "PNG" and (is_deep or largest > 255):
            raise DamagedFileError(f"{path} has more than 8 bits; save it as PNG")
        exif, info = image.getexif(), image.info
        orientation = exif.get(_ORIENTATION, 1)
        if is_deep and orientation != 1:
            raise DamagedFileError(f"{path} is turned by Exif; save it upright")
        columns, rows = image.size[:: -1 if orientation in (5, 6, 7, 8) else 1]
        depth: frames.Depth = "16 bits" if is_deep else "8 bits"
        profile, notes = info.get("icc_profile") or b"", list[str]()
        if profile and b"sRGB" not in profile and "sRGB".encode("utf-16-be") not in profile:
            notes.append(f"{path} has a color profile, which is ignored")
        across, down = info.get("dpi") or info.get("aspect") or info.get("jfif_density") or (1, 1)
        notes += frames.not_square(path, down / across if across and down else 1)
        inner = exif.get_ifd(_EXIF)
        stated = {name: inner[tag] for tag, name in _EXIF_TOLD.items() if tag in inner}
        if exif.get_ifd(_GPS):
            stated["GPS"] = "position"
        if inner.get(0xA001, 1) not in (1, 0xFFFF):
            stated["ColorSpace"] = inner[0xA001]
        if image.format == "MPO":
            notes.append(f"{path} holds several pictures; the first is read")
        header = frames.Header((rows, columns), depth)
        if image.format == "PNG":
            header, statements = formats.png_colors(path, header)
            stated |= statements
        if image.format == "GIF" and (aspect := bounded.read_bytes(path, bounded.ARRAY_BYTES)[12]):
            notes += frames.not_square(path, (aspect + 15) / 64)
        if getattr(image, "n_frames", 1) > 1 and image.format in ("GIF", "PNG", "WEBP"):
            if is_deep:
                raise DamagedFileError(f"{path} is an animation of 16 bits; save it with 8 bits")
            header = _animated(path, image, header)
        return header._replace(notes=(*header.notes, *notes, *frames.unused(path, stated)))


def _animated(path: Path, image: Image.Image, header: frames.Header) -> frames.Header:
    """Return a header with the times of the frames of an animation, which are all decoded."""
    first, count, size = int(bool(image.info.get("default_image"))), image.n_frames, image.size  # type: ignore[attr-defined]
    bounded.check_count(path, "frames", count, _MOST_FRAMES)
    bounded.check_count(path, "pixels in its frames", count * math.prod(size), 10**9)
    lasts_s, notes = list[float](), list(header.notes)
    with working(f"frames of {path}"):
        for page in range(first, count):
            image.seek(page)
            image.load()  # for WebP, sets the duration
            if image.size != size:
                raise ValueError("a frame reaches beyond the picture")
            lasts_s.append(float(image.info.get("duration") or 0) / 1000)
    if first:
        notes.append(f"{path} holds a picture that is no part of its animation, and is not read")
    if 0.0 in lasts_s:
        notes.append(
            f"{path} has frames of no duration; they last {_SHORTEST_S:g} s, as in browsers"
        )
        lasts_s = [last_s or _SHORTEST_S for last_s in lasts_s]
    return header._replace(
        pages=tuple(range(first, count)),
        times_s=tuple(np.cumsum([0.0, *lasts_s[:-1]]).tolist()),
        last_s=lasts_s[-1],
        notes=tuple(notes),
    )


def open_footage(path: Path, unit: frames.Unit | None = None) -> frames.Footage:
    """Return a picture, a folder of pictures, a video, an animation or an array as frames of light.

    `unit` is the unit of the values: required for arrays, and for 16-bit or floating-point pictures
    in an unusual unit. Close the returned footage.

    Raises UserError, in one sentence, for what cannot be read.
    """
    try:
        if path.is_dir():
            return open_folder(path, unit)
        bounded.check_file(path, at_most=2**63 - 1)  # each reader has its own limit
        suffix = path.suffix.lower()
        if suffix not in SUFFIXES:
            raise UserError(
                f"{path}: {suffix or 'no suffix'}, not a supported picture, video or array; give a "
                f"folder of pictures, one of {', '.join(SUFFIXES)}, or of other files, such as "
                "TIFF, their numbers as numpy.save writes them"
            )
        if not path.stat().st_size:
            raise UserError(f"{path} is empty; copy it again")
        if suffix == ".npy":
            if unit is None:
                raise UserError(
                    f"{path}: an array does not state its unit; give the unit srgb (coded as in "
                    "pictures), linear (proportional to light) or cd/m2 (luminance)"
                )
            try:
                values = bounded.mapped_array(path)  # read frame by frame
            except Exception:  # a damaged header can raise anything
                raise DamagedFileError(
                    f"{path} is not a complete array of numbers; write it with numpy.save"
                ) from None
            return ArrayFrames(values, unit, path)
        if suffix in KINDS:
            return open_picture(path, unit)
        if unit not in (None, "srgb"):
            raise UserError(f"{path} states how its codes become light; omit the unit {unit}")
        return Film(path)
    except OSError as problem:
        unreadable = f"{path}: cannot be read ({problem.strerror}); repair it"
        raise UserError(machine_problem(problem) or unreadable) from None


def is_footage(path: Path) -> bool:
    """True for a file with one of `SUFFIXES`, or a folder with a picture."""
    if path.is_dir():
        return any(picture_kind(file) and file.is_file() for file in path.iterdir())
    return path.suffix.lower() in SUFFIXES
