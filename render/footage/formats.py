"""Pictures in OpenEXR, Radiance and PNG.

EXR: R, G, B, or Y, in the main layer or, without it, in the first that has them; or spectra in the
layout of Fichet, Pacanowski and Wilkie (JCGT 10(3), 2021). Radiance: light is divided by every
EXPOSURE and COLORCORR; pictures are upright, "-Y … +X …" (Ward, Radiance's reference manual).
"""

import re
import struct
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from megalopta.core import bounded
from megalopta.core.errors import DamagedFileError
from megalopta.core.pictures import checked_png, png_parts
from megalopta.render.exr import RADIANCE_UNIT, VALUE_BYTES, read_headers
from megalopta.render.footage import frames
from megalopta.scenes.spectra.color import Bands

_SILENT = (
    *("channels", "chunkCount", "compression", "dataWindow", "displayWindow", "lineOrder", "name"),
    *("pixelAspectRatio", "type", "chromaticities", "whiteLuminance", "view", "multiView", "tiles"),
    *("version", "preview", "generatedBy", "spectralLayoutVersion", "emissiveUnits", "bandEdgesNm"),
    *("comments", "owner", "software", "Software", "dwaCompressionLevel", "zipCompressionLevel"),
    "EV",
)
"""Attributes that are used, or say nothing of place, light and time."""
_USUAL: Mapping[str, Any] = {"screenWindowCenter": [0, 0], "screenWindowWidth": 1}
_SPECTRAL = re.compile(r"(\d+,?\d*)nm")
_UNITS = (RADIANCE_UNIT, "W.m^-2.sr^-1")


class _Picture(NamedTuple):
    """The picture of an EXR file that is read: a layer of a part."""

    part: int
    attributes: Mapping[str, Any]
    names: tuple[str, ...]
    """Channels: R, G, B; Y; or spectral ones"""
    alpha: str | None
    wavelengths_nm: tuple[float, ...]
    others: tuple[str, ...]
    """Channels that are not read"""


def exr_header(path: Path) -> frames.Header:
    """Return what an EXR file states. Raises DamagedFileError."""
    picture = _chosen(path, read_headers(path))
    stated, notes = picture.attributes, []
    (left, top), (right, bottom) = window = np.asarray(stated["dataWindow"]).tolist()
    shape = bottom - top + 1, right - left + 1
    bounded.check_decoded(path, (*shape, len(picture.names)), VALUE_BYTES)
    if window != np.asarray(stated["displayWindow"]).tolist():
        raise DamagedFileError(
            f"{path} has pixels in a part of its displayWindow, or beyond it; save it whole"
        )
    if picture.others:
        notes.append(
            f"{path} holds several pictures or layers: {', '.join(picture.names)} are read, not "
            f"{bounded.quoted(', '.join(picture.others), 400)}"
        )
    notes += frames.not_square(path, float(stated["pixelAspectRatio"]))
    chromaticities, bands_nm = None, None
    if picture.wavelengths_nm:
        bands_nm, units = _bands_nm(path, picture), str(stated.get("emissiveUnits", "no unit"))
        if units != RADIANCE_UNIT:
            notes.append(f"{path} states {units}; its values are taken as {RADIANCE_UNIT}")
    elif "chromaticities" in stated:
        chromaticities, note = frames.converted(path, np.ravel(stated["chromaticities"]).tolist())
        notes += note
    white_cd_m2 = stated.get("whiteLuminance")
    if white_cd_m2 is not None and not 0 < white_cd_m2 < np.inf:
        raise DamagedFileError(f"{path} states a whiteLuminance of {white_cd_m2:g}; remove it")
    plain = {
        name: np.asarray(value).tolist() if isinstance(value, tuple | np.ndarray) else value
        for name, value in stated.items()
        if name not in _SILENT
    }
    notes += frames.unused(path, {k: value for k, value in plain.items() if _USUAL.get(k) != value})
    return frames.Header(
        shape,
        "light",
        chromaticities=chromaticities,
        unit="cd/m2" if white_cd_m2 is not None and bands_nm is None else None,
        bands_nm=bands_nm,
        notes=tuple(notes),
    )


def exr_light(path: Path) -> tuple[NDArray[Any], bool]:
    """Return light (H, W), (H, W, 3) or (H, W, B), and True if any is transparent."""
    import OpenEXR

    with OpenEXR.File(str(path), separate_channels=True) as file:
        picture = _chosen(path, [dict(part.header) for part in file.parts])
        channels, stated = file.parts[picture.part].channels, picture.attributes
        names = (*picture.names, *filter(None, [picture.alpha]))
        planes = [np.asarray(channels[name].pixels, np.float32) for name in names]
    is_transparent = picture.alpha is not None and planes.pop().min() < 1
    light = planes[0] if len(planes) == 1 else np.stack(planes, axis=-1)
    if not picture.wavelengths_nm:
        light = light * np.float32(stated.get("whiteLuminance", 1))
    return light, is_transparent


def _chosen(path: Path, headers: Sequence[Mapping[str, Any]]) -> _Picture:
    """Return the picture to read: spectra, else the main layer's colors, else another layer's."""
    kinds = [str(header["type"]).rpartition(".")[2] for header in headers]
    channels = [
        (part, str(channel.name))
        for part, header in enumerate(headers)
        if not kinds[part].startswith("deep")
        for channel in header["channels"]
    ]
    candidates: list[tuple[Any, ...]] = []
    for part, layer in dict.fromkeys((part, name.rpartition(".")[0]) for part, name in channels):
        prefix = f"{layer}." if layer else ""
        names = [name for number, name in channels if number == part]
        if layer.rpartition(".")[2] == "S0":
            ends = {name: _SPECTRAL.fullmatch(name.removeprefix(prefix)) for name in names}
            known = [(float(end[1].replace(",", ".")), name) for name, end in ends.items() if end]
            if known:
                wavelengths_nm, spectral = zip(*sorted(known), strict=True)
                candidates.append((0, part, spectral, None, wavelengths_nm))
        alpha = f"{prefix}A" if f"{prefix}A" in names else None
        for rank, colors in enumerate(("RGB", "Y"), 1 + 2 * bool(layer)):
            used = tuple(prefix + color for color in colors)
            if set(used) <= set(names):
                candidates.append((rank, part, used, alpha, ()))
                break
    if not candidates:
        if not channels:
            raise DamagedFileError(f"{path} holds deep data; flatten it, and save it again")
        listed = ", ".join(name for _, name in channels)
        raise DamagedFileError(
            f"{path} has the channels {bounded.quoted(listed)}; give one with R, G, B, or Y, or "
            "spectra S0.<wavelength>nm"
        )
    _, part, used, alpha, wavelengths_nm = min(candidates, key=lambda candidate: candidate[:2])
    known_names = *used, alpha, *("RGB" if wavelengths_nm else "")  # the picture of the spectra
    unread = [name for number, name in channels if number != part or name not in known_names]
    unread += ["deep data"] * any(kind.startswith("deep") for kind in kinds)
    return _Picture(part, headers[part], used, alpha, wavelengths_nm, tuple(unread))


def _bands_nm(path: Path, picture: _Picture) -> Bands:
    """Return the edges of spectral channels: as a file of ours states, else midway to the next."""
    units = picture.attributes.get("emissiveUnits")
    centers = np.array(picture.wavelengths_nm)
    if units not in (None, *_UNITS) or len(centers) < 2 or not (np.diff(centers) > 0).all():
        raise DamagedFileError(
            f"{path} has {len(centers)} spectral channels in {units or 'no unit'}; give two or "
            f"more of different wavelengths, in {RADIANCE_UNIT}"
        )
    if "bandEdgesNm" in picture.attributes:
        stated = str(picture.attributes["bandEdgesNm"]).split()
        edges = [band.split("-") for band in stated]
        return sorted(((float(lower), float(upper)) for lower, upper in edges), key=sum)
    steps = np.diff(centers)
    lower = centers - np.append(steps[0], steps) / 2
    upper = centers + np.append(steps, steps[-1]) / 2
    return tuple(zip(lower.round(6).tolist(), upper.round(6).tolist(), strict=True))


_RESOLUTION = re.compile(rb"\n\n-Y (\d{1,9}) \+X (\d{1,9})\n")
_HEADER_BYTES = 65536


def _radiance(
    path: Path, content: bytes
) -> tuple[tuple[int, int], NDArray[np.float32], dict[str, str], int]:
    """Return rows and columns, product of exposures (3,), other statements, bytes of the header."""
    size = _RESOLUTION.search(content[:_HEADER_BYTES])
    if not (content.startswith(b"#?") and size):
        raise DamagedFileError(f"{path} is no Radiance picture (-Y … +X …); save it again")
    stated, divisor = dict[str, str](), np.ones(3)
    for line in content[: size.start()].decode("latin-1").splitlines()[1:]:
        name, is_stated, value = (part.strip() for part in line.partition("="))
        if name in ("EXPOSURE", "COLORCORR"):
            divisor = divisor * np.array(value.split(), np.float64)
        elif is_stated and not line.startswith("#"):
            stated[name] = value
    if not ((divisor > 0) & (divisor < np.inf)).all():
        raise DamagedFileError(f"{path} states an exposure that is not positive; correct it")
    return (int(size[1]), int(size[2])), divisor.astype("f4"), stated, size.end()


def radiance_header(path: Path) -> frames.Header:
    """Return what a Radiance file states. Raises DamagedFileError."""
    with path.open("rb") as file:
        shape, divisor, stated, _ = _radiance(path, file.read(_HEADER_BYTES))
    notes = list[str]()
    layout = stated.pop("FORMAT", "32-bit_rle_rgbe")
    if layout not in ("32-bit_rle_rgbe", "32-bit_rle_xyze"):
        raise DamagedFileError(f"{path} is of {bounded.quoted(layout)}; save it as 32-bit_rle_rgbe")
    xy = tuple(map(float, stated.pop("PRIMARIES", "").split()))
    xy = frames.XYZ_XY if layout == "32-bit_rle_xyze" else xy
    chromaticities, note = frames.converted(path, xy) if xy else (None, ())
    if not (divisor == 1).all():
        factors = ", ".join(f"{value:.4g}" for value in dict.fromkeys(divisor.tolist()))
        notes.append(f"{path} states exposures; its values are divided by {factors}")
    notes += (*note, *frames.not_square(path, 1 / float(stated.pop("PIXASPECT", 1))))
    stated.pop("SOFTWARE", None)
    notes += frames.unused(path, stated)
    return frames.Header(shape, "light", chromaticities=chromaticities, notes=tuple(notes))


def radiance_light(path: Path) -> tuple[NDArray[Any], bool]:
    """Return light (H, W, 3), upright, and False: nothing is transparent."""
    content = bounded.read_bytes(path, bounded.ARRAY_BYTES)
    shape, divisor, _, end = _radiance(path, content)
    # OpenCV reads files only, and only this header.
    plain = "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {} +X {}\n".format(*shape)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "plain.hdr"
        file.write_bytes(plain.encode() + content[end:])
        with frames.without_log():
            numbers = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
    if numbers is None:
        raise ValueError("damaged")
    return numbers[..., ::-1] / divisor, False


_PNG_PIXELS = (b"IHDR", b"PLTE", b"tRNS", b"IDAT", b"IEND")
_SRGB = bytes([1, 13, 0, 1])
_PNG_TOLD = (b"oFFs", b"pCAL", b"sCAL", b"sTER", b"mDCV", b"cLLI", b"cLLi", b"mDCv")
"""Chunks on place and light without effect."""


def png_colors(path: Path, header: frames.Header) -> tuple[frames.Header, dict[str, str]]:
    """Return a header with the colors that a PNG states, and what has no effect."""
    chunks: dict[bytes, bytes] = {}
    for name, chunk in png_parts(bounded.read_bytes(path, bounded.ARRAY_BYTES)):
        if name not in (b"IDAT", b"fdAT"):
            chunks[name] = chunk[8:-4]
    statements = {name.decode(): chunks[name].hex() for name in _PNG_TOLD if name in chunks}
    if chunks.get(b"cICP", _SRGB) != _SRGB:
        raise DamagedFileError(
            f"{path} states colors of ITU-T H.273 other than sRGB; save it in sRGB"
        )
    if chunks.keys() & {b"cICP", b"iCCP", b"sRGB"}:
        return header, statements
    if b"gAMA" in chunks:
        (gamma,) = struct.unpack(">I", chunks[b"gAMA"])
        if not gamma:
            raise DamagedFileError(f"{path} states a gamma of 0; save it again")
        transfer = "linear" if gamma == 100_000 else f"gamma {100_000 / gamma:.6g}"
        header = header._replace(transfer=transfer)
    if b"cHRM" in chunks:
        white_x, white_y, *colors = (
            number / 100_000 for number in struct.unpack(">8I", chunks[b"cHRM"])
        )
        xy, notes = frames.converted(path, (*colors, white_x, white_y))
        header = header._replace(chromaticities=xy, notes=notes)
    return header, statements


def png_numbers(path: Path) -> tuple[NDArray[Any], bool]:
    """Return codes (H, W) or (H, W, 3) of a 16-bit PNG, and True if any is transparent."""
    # libpng may complain about other parts
    plain = checked_png(bounded.read_bytes(path, bounded.ARRAY_BYTES), _PNG_PIXELS)
    with frames.without_log():
        numbers = cv2.imdecode(np.frombuffer(plain, np.uint8), cv2.IMREAD_UNCHANGED)
    if numbers is None:
        raise ValueError("damaged")
    if numbers.ndim == 2:
        return numbers, False
    colors = numbers[..., 2::-1]
    if numbers.shape[-1] == 3 or numbers[..., 3].min() == 65535:
        return colors, False
    return np.rint(colors * (numbers[..., 3:] / 65535)).astype(np.uint16), True
