"""Spectral bands to display colors; colors of pictures and of surfaces to spectra.

For display: CIE 1931 matching functions, white balance, sRGB. The matching functions are the
multi-lobe Gaussian fits of Wyman, Sloan and Shirley (JCGT 2(2), 2013), accurate to about 1 %: for
display, not for photometry.

The three colors of a picture whose white is a given light leave its spectrum open. Here each pixel
has the light's spectrum times a smooth function of wavelength: red, green and blue follow each
other in logistic steps, so that white has the light's spectrum, nothing is negative, and light is
conserved. The steps are placed so that each color has its sRGB share of the luminance. Red extends
into the infrared and blue into the ultraviolet, on which the picture has no information.

Reflectances of surfaces of which a color is known: a sum of those of red, green and blue, which add
up to 1 (Mallett and Yuksel 2019, Spectral Primary Decomposition for Rendering with sRGB
Reflectance). They are the smoothest that are nowhere negative and have, in D65, the colors of sRGB.
Sums are linear in the color, so that a texture of colors is one of three weights. Beyond 360 to 830
nm a color says nothing.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq
from scipy.special import expit

from megalopta.core.arrays import Floats
from megalopta.scenes.spectra.spectrum import (
    MAXIMUM_EFFICACY_LM_W,
    PHOTOPIC_NM,
    TABLES,
    Spectrum,
    luminous_efficiency,
)

# (weight, center nm, 1/width below, 1/width above), per lobe of x, y and z.
_LOBES = (
    (
        (1.056, 599.8, 0.0264, 0.0323),
        (0.362, 442.0, 0.0624, 0.0374),
        (-0.065, 501.1, 0.0490, 0.0382),
    ),
    ((0.821, 568.8, 0.0213, 0.0247), (0.286, 530.9, 0.0613, 0.0322)),
    ((1.217, 437.0, 0.0845, 0.0278), (0.681, 459.0, 0.0385, 0.0725)),
)

_XYZ_FROM_SRGB = np.array(
    [
        [0.4124564, 0.3575761, 0.1804375],
        [0.2126729, 0.7151522, 0.0721750],
        [0.0193339, 0.1191920, 0.9503041],
    ]
)
_D65 = _XYZ_FROM_SRGB.sum(axis=1)

Bands = Sequence[tuple[float, float]]


def matching_functions(wavelength_nm: ArrayLike) -> Floats:
    """CIE 1931 x̄, ȳ, z̄ at each wavelength (nm), stacked on the last axis."""
    wavelength = np.asarray(wavelength_nm, dtype=np.float64)

    def lobe(weight: float, center: float, below: float, above: float) -> Floats:
        width = np.where(wavelength < center, below, above)
        return np.asarray(weight * np.exp(-0.5 * ((wavelength - center) * width) ** 2))

    return np.stack([sum(lobe(*part) for part in lobes) for lobes in _LOBES], axis=-1)


def linear_srgb(radiance: NDArray[np.floating], bands_nm: Bands, white: Spectrum) -> Floats:
    """Linear sRGB (..., 3) of radiance (..., B), up to a common factor.

    The spectrum of `white` becomes neutral. Without any visible band the result is gray.
    """
    grids = [np.linspace(lower, upper, 65) for lower, upper in bands_nm]
    to_xyz = np.stack([np.trapezoid(matching_functions(grid), grid, axis=0) for grid in grids])
    band_white = np.array([white(grid).mean() for grid in grids])
    light = band_white @ to_xyz
    if light[1] < 1e-2 * band_white.max():
        return np.repeat(radiance.mean(axis=-1, keepdims=True), 3, axis=-1).astype(np.float64)
    balanced = radiance @ to_xyz * (light[1] / light) * _D65
    return np.asarray(np.clip(balanced @ np.linalg.inv(_XYZ_FROM_SRGB).T, 0, None))


def encode_srgb(linear: NDArray[np.floating]) -> NDArray[np.uint8]:
    """8-bit sRGB of linear values of any shape; values of 1 and above are white."""
    bounded = np.clip(linear, 0, 1)
    curved = np.where(bounded <= 0.0031308, 12.92 * bounded, 1.055 * bounded ** (1 / 2.4) - 0.055)
    return np.asarray(curved * 255 + 0.5).astype(np.uint8)


def linear_of_srgb(curved: NDArray[np.floating]) -> Floats:
    """Linear values of sRGB from 0 to 1, of any shape (IEC 61966-2-1)."""
    return np.asarray(
        np.where(curved <= 0.04045, curved / 12.92, ((curved + 0.055) / 1.055) ** 2.4)
    )


LUMINANCE_SHARES = (0.2126, 0.7152, 0.0722)
"""Luminance shares of red, green and blue in linear sRGB (IEC 61966-2-1)."""

_STEP_WIDTH_NM = 12.0
_GRID_NM = np.concatenate([np.arange(300.0, 800.0, 5.0), np.arange(800.0, 2001.0, 10.0)])


def primaries(light: Spectrum) -> tuple[Spectrum, Spectrum, Spectrum]:
    """Spectra of red, green and blue that add up to that of white, with sRGB's luminances."""
    red_share, _, blue_share = LUMINANCE_SHARES
    values = light(_GRID_NM)
    seen = luminous_efficiency(PHOTOPIC_NM)

    def luminous(values: Floats) -> float:
        visible = np.interp(PHOTOPIC_NM, _GRID_NM, values) * seen
        return float(MAXIMUM_EFFICACY_LM_W * np.trapezoid(visible, PHOTOPIC_NM))

    total = luminous(values)

    def luminance_below(edge_nm: float) -> float:
        return luminous(values * expit((edge_nm - _GRID_NM) / _STEP_WIDTH_NM)) / total

    blue_edge = brentq(lambda edge: luminance_below(edge) - blue_share, 400.0, 700.0)
    red_edge = brentq(lambda edge: luminance_below(edge) - 1 + red_share, 400.0, 700.0)
    not_blue, red = (expit((_GRID_NM - edge) / _STEP_WIDTH_NM) for edge in (blue_edge, red_edge))
    shares = red, not_blue - red, 1 - not_blue
    known_nm = light.range_nm
    first, second, third = (Spectrum.of(_GRID_NM, values * share, known_nm) for share in shares)
    return first, second, third


def band_means(spectra: Sequence[Spectrum], bands_nm: Bands) -> Floats:
    """Means (n, B) of n spectra over the bands."""
    grids = [np.linspace(*band, 1025) for band in bands_nm]
    return np.array(
        [[np.trapezoid(s(grid), grid) / (grid[-1] - grid[0]) for grid in grids] for s in spectra]
    )


def luminances(bands_nm: Bands) -> Floats:
    """Luminance (B,), cd/m², of a radiance of 1 W·m⁻²·sr⁻¹·nm⁻¹ in each band."""
    grids = [np.linspace(*band, 1025) for band in bands_nm]
    return np.array(
        [MAXIMUM_EFFICACY_LM_W * np.trapezoid(luminous_efficiency(grid), grid) for grid in grids]
    )


def rebinned(bands_nm: Bands, to_nm: Bands) -> Floats:
    """Means (B, C) over C bands of radiance that is 1 in one of B bands and 0 in the others."""
    (lower, upper), (first, last) = np.array(bands_nm).T[..., None], np.array(to_nm).T[:, None]
    overlap_nm = np.minimum(upper, last) - np.maximum(lower, first)
    return np.asarray(overlap_nm.clip(0) / (last - first))


KNOWN_NM = (360.0, 830.0)
"""Lowest and highest wavelength at which a color has a reflectance."""
_RED, _BLUE = (np.array(TABLES[f"{name} of sRGB"]) for name in ("red", "blue"))
_KNOWN_GRID_NM = np.linspace(*KNOWN_NM, len(_RED))
_OF_PRIMARIES = np.stack([_RED, (1 - _RED - _BLUE).clip(0), _BLUE])


def reflectance_of_color(rgb: ArrayLike) -> Spectrum:
    """Return the reflectance of a color (3,) in linear sRGB, 0 to 1."""
    return Spectrum.of(_KNOWN_GRID_NM, np.asarray(rgb, np.float64) @ _OF_PRIMARIES)


RED, GREEN, BLUE = map(reflectance_of_color, np.eye(3))
"""Reflectances of the primaries of sRGB."""
