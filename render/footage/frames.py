"""Frames of linear light, and how codes of pictures and videos become it, by their standards.

Codes are numbers from 0 to 1. sRGB: IEC 61966-2-1. BT.709: the inverse of its camera curve (ITU-R
BT.709-6), also for BT.601 and BT.2020. PQ and HLG: ITU-R BT.2100-2; PQ gives light of the display
relative to the white of ITU-R BT.2408. Numbers are those of ITU-T H.273.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from threading import Lock
from typing import Any, BinaryIO, Literal, NamedTuple, Self

import cv2
import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats
from megalopta.core.bounded import check_decoded, quoted
from megalopta.core.errors import DamagedFileError
from megalopta.core.pictures import PIXEL_BYTES
from megalopta.scenes.spectra.color import LUMINANCE_SHARES, Bands, linear_of_srgb, luminances
from megalopta.scenes.stimuli.pictures import Unit as Unit

PQ_WHITE_CD_M2 = 203.0
"""Luminance with a value of 1 in PQ light (ITU-R BT.2408)."""
_PQ_TOP_CD_M2 = 10000.0
_M1, _M2 = 2610 / 16384, 2523 / 32
_C1, _C2, _C3 = 3424 / 4096, 2413 / 128, 2392 / 128
_A, _B, _C = 0.17883277, 0.28466892, 0.55991073


def _pq(code: Floats) -> Floats:
    root = code ** (1 / _M2)
    share = (np.maximum(root - _C1, 0) / (_C2 - _C3 * root)) ** (1 / _M1)
    return np.asarray(share * (_PQ_TOP_CD_M2 / PQ_WHITE_CD_M2))


_CURVES: Mapping[str, Callable[[Floats], Floats]] = {
    "sRGB": linear_of_srgb,
    "BT.709": lambda code: np.where(
        code < 0.081, code / 4.5, ((code + 0.099) / 1.099) ** (1 / 0.45)
    ),
    "HLG": lambda code: np.where(code <= 0.5, code**2 / 3, (np.exp((code - _C) / _A) + _B) / 12),
    "PQ": _pq,
    "linear": lambda code: code,
}
TRANSFERS = {
    **dict.fromkeys((1, 2, 6, 14, 15), "BT.709"),
    4: "gamma 2.2",
    5: "gamma 2.8",
    8: "linear",
    13: "sRGB",
    16: "PQ",
    18: "HLG",
}
"""Transfer functions by their number; 2 is an unstated one of a video."""
UNSTATED = 2
HDR_NOTES = {
    "PQ": f"HDR (PQ): 1 is {PQ_WHITE_CD_M2:g} cd/m², the white of BT.2408; highlights are above 1",
    "HLG": "HDR (HLG): light of the scene, whose brightest is 1; the white of BT.2408 is 0.26",
}


def light_of(transfer: str, codes: Floats) -> Floats:
    """Return the light of codes from 0 to 1, by the name of the transfer function.

    Raises KeyError for a name without a formula.
    """
    if transfer.startswith("gamma "):
        return np.asarray(codes ** float(transfer.removeprefix("gamma ")))
    return _CURVES[transfer](codes)


_D65_XY = (0.3127, 0.3290)
_BT709_XY = (0.640, 0.330, 0.300, 0.600, 0.150, 0.060, *_D65_XY)
_BT601_XY = (0.630, 0.340, 0.310, 0.595, 0.155, 0.070, *_D65_XY)
XYZ_XY = (1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1 / 3, 1 / 3)
PRIMARIES: Mapping[int, tuple[str, tuple[float, ...]]] = {
    1: ("BT.709", _BT709_XY),
    5: ("BT.601, 625 lines", (0.640, 0.330, 0.290, 0.600, 0.150, 0.060, *_D65_XY)),
    6: ("BT.601, 525 lines", _BT601_XY),
    7: ("SMPTE 240M", _BT601_XY),
    9: ("BT.2020", (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, *_D65_XY)),
    10: ("CIE XYZ", XYZ_XY),
    11: ("DCI P3", (0.680, 0.320, 0.265, 0.690, 0.150, 0.060, 0.314, 0.351)),
    12: ("Display P3", (0.680, 0.320, 0.265, 0.690, 0.150, 0.060, *_D65_XY)),
}
"""Names, and chromaticities x, y of red, green, blue and white, by their number."""


def to_bt709(chromaticities: Sequence[float]) -> Floats | None:
    """Return the matrix (3, 3) from light in some primaries to that in BT.709; white stays white.

    `chromaticities` are x and y of red, green, blue and white. None if they are nearly those of
    BT.709. Raises ValueError if light in them has no color: primaries on a line, or white not
    between them.
    """
    matrix = np.linalg.solve(to_xyz(_BT709_XY), to_xyz(chromaticities))
    matrix /= matrix.sum(axis=1, keepdims=True)
    return None if np.allclose(matrix, np.eye(3), atol=1e-3) else np.asarray(matrix)


def to_xyz(chromaticities: Sequence[float]) -> Floats:
    """Return the matrix (3, 3) from light in some primaries to CIE XYZ; white has Y = 1.

    Raises ValueError as `to_bt709`.
    """
    x, y = np.reshape(np.asarray(chromaticities, np.float64), (4, 2)).T
    colors = np.stack([x, y, 1 - x - y])
    if not np.isfinite(colors).all() or abs(np.linalg.det(colors[:, :3])) < 1e-6 or y[3] <= 0:
        raise ValueError("they are on a line, or white has no luminance")
    shares = np.linalg.solve(colors[:, :3], colors[:, 3] / y[3])
    if not (shares > 0).all():
        raise ValueError("white is not between them")
    return np.asarray(colors[:, :3] * shares)


_MOST_NEGATIVE = 0.01
"""Largest share of the light that values below 0 may sum to."""


Depth = Literal["8 bits", "16 bits", "light"]
TRANSPARENT = "transparent parts are shown over black"


class Header(NamedTuple):
    """What a picture's file states of its pixels."""

    shape: tuple[int, int]
    """Rows and columns, as the picture is viewed"""
    depth: Depth
    pages: tuple[int, ...] = (0,)
    """Numbers of the pages of the file that are frames"""
    times_s: tuple[float, ...] | None = None
    """Time of every frame, the first 0"""
    last_s: float | None = None
    """Duration of the last frame"""
    transfer: str | None = None
    """Transfer function of codes"""
    chromaticities: tuple[float, ...] | None = None
    """x and y of red, green, blue and white, if they are not those of BT.709"""
    unit: Unit | None = None
    """Unit of light"""
    bands_nm: Bands | None = None
    """Edges of each channel of spectral radiance, W·m⁻²·sr⁻¹·nm⁻¹; None: red, green and blue"""
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Coding:
    """Conversion of the values of frames to light."""

    name: str
    """Name for readers: the transfer function, or the unit."""
    unit: Unit = "srgb"
    table: NDArray[np.float32] | None = None
    """Light of every code; None if values are light."""
    white: int = 0
    """Code of white; channels at or above it are saturated."""
    matrix: Floats | None = None
    """Matrix from the primaries of the file to those of BT.709; None if these are equal."""

    def light(self, numbers: NDArray[Any]) -> NDArray[np.float32]:
        """Return light (H, W, 3) of codes or light, (H, W) or (H, W, 3)."""
        light = numbers if self.table is None else cv2.LUT(numbers, self.table)
        if light.ndim == 2:
            light = cv2.merge([light] * 3)
        if self.matrix is not None:
            light = np.maximum(cv2.transform(light, self.matrix), 0)
        return np.ascontiguousarray(light, np.float32)


def coding_of(transfer: str, codes: int, black: int = 0, white: int = 0) -> Coding:
    """Return the coding of `codes` codes by a transfer function; 1 from `white` on (default: last).

    Raises KeyError for a transfer function without a formula.
    """
    white = white or codes - 1
    shares = np.clip((np.arange(codes) - black) / (white - black), 0, 1)
    return Coding(transfer, "srgb", light_of(transfer, shares).astype(np.float32), white)


@dataclass(eq=False, kw_only=True)
class Footage(ABC):
    """Frames of linear light, from one file or from the pictures of a folder.

    Access is fast for increasing indices. The last frames are cached, as many as fit `_KEPT_BYTES`.
    """

    path: Path
    files: tuple[Path, ...]
    """The file, or those of the folder in order."""
    count: int
    """Number of frames."""
    shape: tuple[int, int]
    """Rows and columns, as the picture is viewed."""
    coding: Coding
    times_s: Floats | None = None
    """Time of every frame, the first 0; None if the file does not state it."""
    notes: tuple[str, ...] = ()
    """Notes for the user on assumptions, changes and statements without effect."""
    bands_nm: Bands | None = None
    """Edges of each channel of spectral radiance, W·m⁻²·sr⁻¹·nm⁻¹; None: red, green and blue."""
    last_s: float | None = None
    """Duration of the last frame; None if the file does not state it."""
    _kept: dict[int, NDArray[Any]] = field(default_factory=dict, init=False, repr=False)
    _decoding: Lock = field(default_factory=Lock, init=False, repr=False)

    @property
    def is_absolute(self) -> bool:
        """True if values state how bright it was: luminance or spectral radiance."""
        return self.coding.unit == "cd/m2" or self.bands_nm is not None

    @property
    def luminance_shares(self) -> Floats:
        """Luminance of each channel with the value 1, (3,); of spectra in cd/m², (B,)."""
        return np.array(LUMINANCE_SHARES) if self.bands_nm is None else luminances(self.bands_nm)

    def __len__(self) -> int:
        """Return the number of frames."""
        return self.count

    @abstractmethod
    def _numbers(self, index: int) -> NDArray[Any]:
        """Return codes or light of a frame, (H, W) or (H, W, 3)."""

    def frame(self, index: int) -> NDArray[np.float32]:
        """Return linear light (H, W, 3) in the primaries of sRGB, finite and never negative.

        1 is the white of the code; arrays and pictures in light keep their values. Of spectra, a
        channel for each (H, W, B). Raises UserError if the frame cannot be read, IndexError if
        there is none.
        """
        return self.coding.light(self._held(index))

    def mean(self, index: int) -> Floats:
        """Return the mean of each channel of a frame's light; errors as for `frame`."""
        numbers, coding = self._held(index), self.coding
        if coding.table is None or coding.matrix is not None:  # clipping follows the matrix
            return np.asarray(coding.light(numbers).mean(axis=(0, 1), dtype=np.float64))
        planes = 1 if numbers.ndim == 2 else 3
        codes = len(coding.table)
        counts = [cv2.calcHist([numbers], [k], None, [codes], [0, codes]) for k in range(planes)]
        sums = np.array([of_plane.ravel() @ coding.table.astype(np.float64) for of_plane in counts])
        return np.array(np.broadcast_to(sums / np.prod(self.shape), 3))

    def saturated(self, index: int) -> float:
        """Return the share of pixels with any channel at white or above; 0 without codes."""
        if self.coding.table is None:
            return 0.0
        numbers, below = self._held(index), self.coding.white - 1
        channels = 1 if numbers.ndim == 2 else 3
        is_below = cv2.inRange(numbers, (0,) * channels, (below,) * channels)
        return 1 - cv2.countNonZero(is_below) / is_below.size

    @contextmanager
    def opened(self) -> Iterator[BinaryIO]:
        """Give the first file, open for reading."""
        with self.path.open("rb") as file:
            yield file

    def close(self) -> None:
        """Free the decoder and the cached frames."""
        self._kept.clear()

    def __enter__(self) -> Self:
        """Return the footage itself, to be closed at the end."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close it."""
        self.close()

    def _held(self, index: int) -> NDArray[Any]:
        # Decoders have one place in their file; threads of Dask and of `sense` ask for frames.
        with self._decoding:
            index = range(self.count)[index]
            if index not in self._kept:
                held = next(iter(self._kept.values()), np.empty(0)).nbytes
                while self._kept and held * (len(self._kept) + 1) > 2**27:  # bytes kept
                    del self._kept[next(iter(self._kept))]  # before the next one is decoded
                self._kept[index] = np.ascontiguousarray(self._numbers(index))
            return self._kept[index]

    def _note(self, text: str) -> None:
        self.notes = self.notes if text in self.notes else (*self.notes, text)

    def _as_light(self, values: NDArray[Any], path: Path) -> NDArray[np.float32]:
        """Return light as float32; values slightly below 0 become 0. Raises DamagedFileError."""
        with np.errstate(over="ignore"):
            light = np.ascontiguousarray(values, np.float32)
        if not np.isfinite(light).all():
            raise DamagedFileError(
                f"{path} has values that are not finite, or beyond float32; repair it"
            )
        if light.min() >= 0:
            return light
        clipped = np.maximum(light, 0)
        total = clipped.sum(dtype=np.float64)
        if total - light.sum(dtype=np.float64) > _MOST_NEGATIVE * total:
            raise DamagedFileError(
                f"{path} has values below 0, the lowest {light.min():.2g}, more than "
                f"{_MOST_NEGATIVE:.0%} of its light; give light instead of differences"
            )
        self._note(f"{self.path} has values slightly below 0, which are set to 0")
        return clipped


def check_size(path: Path, shape: tuple[int, ...]) -> None:
    """Raise DamagedFileError for a frame without pixels, or with more than the budget allows."""
    check_decoded(path, shape[:2], PIXEL_BYTES)
    if 0 in shape[:2]:
        raise DamagedFileError(f"{path} has {shape[1]} × {shape[0]} pixels; save it again")


def converted(
    path: Path, chromaticities: Sequence[float]
) -> tuple[tuple[float, ...] | None, tuple[str, ...]]:
    """Return stated chromaticities and notes; None and no note if they are those of BT.709.

    Raises DamagedFileError for chromaticities in which light has no color.
    """
    xy = tuple(map(float, chromaticities))
    try:
        matrix = to_bt709(xy)
    except ValueError as problem:
        raise DamagedFileError(
            f"{path} states primaries without colors (x, y of red, green, blue and white: "
            f"{', '.join(f'{value:.4g}' for value in xy)}; {problem}); save it in sRGB"
        ) from None
    if matrix is None:
        return None, ()
    return xy, (f"{path} states its primaries; its light is converted to those of sRGB",)


def not_square(path: Path, width_to_height: float) -> Iterator[str]:
    """Yield a note on pixels that are wider or narrower than high by more than 1 %."""
    if width_to_height > 0 and abs(width_to_height - 1) > 0.01:
        yield (
            f"{path} states pixels {width_to_height:.4g} times as wide as high; they are treated "
            "as square"
        )


def unused(path: Path, stated: Mapping[str, object]) -> Iterator[str]:
    """Yield a note on statements without effect, by name."""
    if stated:
        listed = ", ".join(f"{name} {quoted(str(value), 40)}" for name, value in stated.items())
        yield f"{path} states what is not used: {quoted(' '.join(listed.split()), 600)}"


@contextmanager
def without_log() -> Iterator[None]:
    """Keep OpenCV from printing what it thinks of a file."""
    log = cv2.utils.logging
    level = log.getLogLevel()
    log.setLogLevel(log.LOG_LEVEL_SILENT)
    try:
        yield
    finally:
        log.setLogLevel(level)
