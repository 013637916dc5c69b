"""Diffuse reflectance of the forest's surfaces, 380 to 1700 nm.

The tables are plausible, not measured: drawn by hand, piecewise linear, after the levels and shapes
that are common to published spectral libraries of vegetation and soil (leaf optics: Jacquemoud &
Baret 1990, Remote Sens. Environ. 34:75; soils and litter: ECOSTRESS library, Meerdink et al. 2019,
Remote Sens. Environ. 230:111196). Green leaves absorb blue and red, reflect a tenth at 550 nm, and
rise at the red edge around 700 nm to about one half. Beyond 1000 nm the water in leaves absorbs, a
little at 1200 nm and strongly at 1450 nm; moist soil and wet bark show the same bands more weakly,
dry matter hardly. Surfaces are opaque here; the light that real leaves let through is counted in
with what they reflect. Constant beyond the ends.
"""

from megalopta.scenes.spectra.spectrum import Spectrum

# fmt: off
_LEAF_NM = (
    380, 450, 500, 530, 550, 580, 620, 660, 685, 700, 720, 745, 780, 1000,
    1090, 1200, 1270, 1340, 1400, 1450, 1520, 1600, 1660, 1700,
)
_SLOPE_NM = (380, 460, 540, 620, 700, 850, 1000, 1150, 1300, 1380, 1450, 1550, 1650, 1700)

LEAF_DARK = Spectrum(
    _LEAF_NM,
    (
        0.025, 0.03, 0.04, 0.075, 0.085, 0.06, 0.045, 0.035, 0.035, 0.10, 0.26, 0.42, 0.47, 0.48,
        0.48, 0.43, 0.44, 0.39, 0.22, 0.13, 0.19, 0.28, 0.31, 0.30,
    ),
)
"""Shaded leaf of a broad-leaved tree."""
LEAF_LIGHT = Spectrum(
    _LEAF_NM,
    (
        0.05, 0.06, 0.09, 0.21, 0.24, 0.18, 0.125, 0.085, 0.08, 0.18, 0.38, 0.56, 0.61, 0.62,
        0.62, 0.57, 0.58, 0.53, 0.34, 0.22, 0.30, 0.41, 0.45, 0.44,
    ),
)
"""Young leaf, light transmitted included."""
NEEDLE_DARK = LEAF_DARK.scaled(0.55)
"""Gap between needles, dark by mutual shading."""
NEEDLE_LIGHT = LEAF_LIGHT.scaled(0.6)
"""Needle of a spruce."""
GRASS_DARK = LEAF_DARK.scaled(1.1)
"""Blade of grass in its own shade."""
GRASS_LIGHT = LEAF_LIGHT.scaled(1.15)
"""Blade of grass, yellower than a tree's leaf."""

SOIL = Spectrum(
    _SLOPE_NM,
    (
        0.02, 0.028, 0.042, 0.06, 0.08, 0.13, 0.17,
        0.20, 0.23, 0.22, 0.18, 0.22, 0.25, 0.25,
    ),
)
"""Moist humus."""
LITTER = Spectrum(
    _SLOPE_NM,
    (
        0.055, 0.08, 0.13, 0.195, 0.26, 0.39, 0.47,
        0.51, 0.54, 0.54, 0.50, 0.53, 0.55, 0.54,
    ),
)
"""Dry fallen leaves, brown."""

BEECH_BARK_LIGHT = Spectrum(
    _SLOPE_NM,
    (
        0.21, 0.26, 0.31, 0.33, 0.36, 0.44, 0.48,
        0.49, 0.50, 0.48, 0.42, 0.44, 0.46, 0.45,
    ),
)
"""Gray bark with a film of lichen."""
BEECH_BARK_DARK = Spectrum(
    _SLOPE_NM,
    (
        0.06, 0.075, 0.09, 0.10, 0.12, 0.18, 0.22,
        0.24, 0.25, 0.22, 0.16, 0.19, 0.22, 0.22,
    ),
)
"""Wet gray bark."""
BIRCH_BARK_LIGHT = Spectrum(
    _SLOPE_NM,
    (
        0.38, 0.50, 0.58, 0.62, 0.65, 0.70, 0.71,
        0.70, 0.69, 0.66, 0.60, 0.61, 0.62, 0.60,
    ),
)
"""White bark."""
BIRCH_BARK_DARK = Spectrum(
    _SLOPE_NM,
    (
        0.03, 0.035, 0.04, 0.05, 0.06, 0.10, 0.14,
        0.17, 0.20, 0.20, 0.18, 0.21, 0.23, 0.23,
    ),
)
"""Black scars and cracks."""
SPRUCE_BARK_LIGHT = Spectrum(
    _SLOPE_NM,
    (
        0.09, 0.12, 0.17, 0.23, 0.28, 0.38, 0.44,
        0.47, 0.49, 0.48, 0.43, 0.45, 0.47, 0.46,
    ),
)
"""Reddish scales."""
SPRUCE_BARK_DARK = Spectrum(
    _SLOPE_NM,
    (
        0.025, 0.03, 0.04, 0.05, 0.065, 0.11, 0.15,
        0.18, 0.21, 0.20, 0.17, 0.20, 0.22, 0.22,
    ),
)
"""Cracks between scales."""
PINE_BARK_LIGHT = Spectrum(
    _SLOPE_NM,
    (
        0.10, 0.13, 0.20, 0.31, 0.38, 0.47, 0.52,
        0.54, 0.55, 0.54, 0.49, 0.51, 0.53, 0.52,
    ),
)
"""Orange flakes."""
STONE_LIGHT = Spectrum(
    _SLOPE_NM,
    (
        0.24, 0.28, 0.31, 0.33, 0.34, 0.35, 0.36,
        0.37, 0.38, 0.37, 0.36, 0.38, 0.39, 0.39,
    ),
)
"""Dry granite with pale lichen."""
STONE_DARK = Spectrum(
    _SLOPE_NM,
    (
        0.10, 0.12, 0.135, 0.15, 0.155, 0.17, 0.18,
        0.19, 0.20, 0.19, 0.17, 0.19, 0.20, 0.20,
    ),
)
"""Damp granite and its shaded cracks."""
FRESH_WOOD = Spectrum(
    _SLOPE_NM,
    (
        0.14, 0.22, 0.33, 0.43, 0.50, 0.60, 0.65,
        0.65, 0.66, 0.64, 0.55, 0.57, 0.60, 0.59,
    ),
)
"""Face of a log that was cut a season ago."""
WHITE_PETAL = Spectrum(
    _SLOPE_NM,
    (
        0.35, 0.66, 0.72, 0.74, 0.75, 0.76, 0.75,
        0.72, 0.71, 0.62, 0.42, 0.48, 0.55, 0.54,
    ),
)
"""White petal."""
# fmt: on
