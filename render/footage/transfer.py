"""Conversion of codes of pictures and videos to linear light, by the standards that define them.

Codes are numbers from 0 to 1. sRGB: IEC 61966-2-1. BT.709: the inverse of its camera curve (ITU-R
BT.709-6), also for BT.601 and BT.2020. PQ and HLG: ITU-R BT.2100-2; PQ gives light of the display
relative to the white of ITU-R BT.2408; HLG gives light of the scene, with 1 its brightest.
"""

from collections.abc import Callable, Mapping

import numpy as np

from megalopta.core.arrays import Floats
from megalopta.scenes.spectra.color import linear_of_srgb

PQ_WHITE_CD_M2 = 203.0
"""Luminance with a value of 1 in PQ light (ITU-R BT.2408)."""
_PQ_TOP_CD_M2 = 10000.0
_M1, _M2 = 2610 / 16384, 2523 / 32
_C1, _C2, _C3 = 3424 / 4096, 2413 / 128, 2392 / 128
_A, _B, _C = 0.17883277, 0.28466892, 0.55991073


def _bt709(code: Floats) -> Floats:
    return np.where(code < 0.081, code / 4.5, ((code + 0.099) / 1.099) ** (1 / 0.45))


def _pq(code: Floats) -> Floats:
    root = code ** (1 / _M2)
    share = (np.maximum(root - _C1, 0) / (_C2 - _C3 * root)) ** (1 / _M1)
    return np.asarray(share * (_PQ_TOP_CD_M2 / PQ_WHITE_CD_M2))


def _hlg(code: Floats) -> Floats:
    return np.where(code <= 0.5, code**2 / 3, (np.exp((code - _C) / _A) + _B) / 12)


TRANSFERS: Mapping[str, Callable[[Floats], Floats]] = {
    "sRGB": linear_of_srgb,
    "BT.709": _bt709,
    "HLG": _hlg,
    "PQ": _pq,
    "gamma 2.2": lambda code: np.asarray(code**2.2),
    "gamma 2.8": lambda code: np.asarray(code**2.8),
    "linear": lambda code: code,
}
"""Light of codes from 0 to 1, by the name of the transfer function."""

_BT709_XY = (0.640, 0.330, 0.300, 0.600, 0.150, 0.060, 0.3127, 0.3290)
BT2020_XY = (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290)
P3_XY = (0.680, 0.320, 0.265, 0.690, 0.150, 0.060, 0.3127, 0.3290)
"""Chromaticities x, y of red, green, blue and white (BT.709-6, BT.2020-2, SMPTE EG 432-1)."""


def to_bt709(chromaticities: tuple[float, ...]) -> Floats:
    """Return the matrix (3, 3) from light in some primaries to that in BT.709; white stays white.

    `chromaticities` are x and y of red, green, blue and white.
    """
    matrix = np.linalg.solve(_to_xyz(_BT709_XY), _to_xyz(chromaticities))
    return np.asarray(matrix / matrix.sum(axis=1, keepdims=True))


def _to_xyz(chromaticities: tuple[float, ...]) -> Floats:
    x, y = np.reshape(chromaticities, (4, 2)).T
    colors = np.stack([x / y, np.ones(4), (1 - x - y) / y])
    return np.asarray(colors[:, :3] * np.linalg.solve(colors[:, :3], colors[:, 3]))
