"""Conversion of codes of pictures and videos to linear light, by the standards that define them.

Codes are numbers from 0 to 1. sRGB: IEC 61966-2-1. BT.709: the inverse of its camera curve (ITU-R
BT.709-6), also for BT.601 and BT.2020. PQ and HLG: ITU-R BT.2100-2; PQ gives light of the display
relative to the white of ITU-R BT.2408. Numbers are those of ITU-T H.273.
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from megalopta.core.arrays import Floats
from megalopta.scenes.spectra.color import linear_of_srgb

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


_D65_XY, _C_XY = (0.3127, 0.3290), (0.310, 0.316)
_BT709_XY = (0.640, 0.330, 0.300, 0.600, 0.150, 0.060, *_D65_XY)
_BT601_XY = (0.630, 0.340, 0.310, 0.595, 0.155, 0.070, *_D65_XY)
XYZ_XY = (1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1 / 3, 1 / 3)
PRIMARIES: Mapping[int, tuple[str, tuple[float, ...]]] = {
    1: ("BT.709", _BT709_XY),
    4: ("BT.470 M", (0.670, 0.330, 0.210, 0.710, 0.140, 0.080, *_C_XY)),
    5: ("BT.601, 625 lines", (0.640, 0.330, 0.290, 0.600, 0.150, 0.060, *_D65_XY)),
    6: ("BT.601, 525 lines", _BT601_XY),
    7: ("SMPTE 240M", _BT601_XY),
    8: ("film", (0.681, 0.319, 0.243, 0.692, 0.145, 0.049, *_C_XY)),
    9: ("BT.2020", (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, *_D65_XY)),
    10: ("CIE XYZ", XYZ_XY),
    11: ("DCI P3", (0.680, 0.320, 0.265, 0.690, 0.150, 0.060, 0.314, 0.351)),
    12: ("Display P3", (0.680, 0.320, 0.265, 0.690, 0.150, 0.060, *_D65_XY)),
    22: ("EBU 3213", (0.630, 0.340, 0.295, 0.605, 0.155, 0.077, *_D65_XY)),
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
