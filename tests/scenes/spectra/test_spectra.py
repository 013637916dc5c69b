"""Spectra, the colors that they have, and reflectances."""

import math

import mitsuba
import numpy as np
import pytest
from scipy.constants import sigma
from scipy.optimize import nnls

from megalopta.config.model import Configuration
from megalopta.config.yaml_model import validated
from megalopta.core import strict_yaml
from megalopta.core.errors import UserError
from megalopta.scenes.levels import LEVELS
from megalopta.scenes.material import Emission, Material, Texture
from megalopta.scenes.scene import Scene
from megalopta.scenes.spectra.color import (
    BLUE,
    GREEN,
    KNOWN_NM,
    LUMINANCE_SHARES,
    RED,
    encode_srgb,
    linear_srgb,
    matching_functions,
    primaries,
    reflectance_of_color,
)
from megalopta.scenes.spectra.reflectance import LEAVES, TABLE, Leaf, leaf_of, reflectance_of
from megalopta.scenes.spectra.spectrum import (
    SPECTRA,
    Spectrum,
    flat,
    luminous,
    luminous_efficiency,
    planckian,
)


def test_integral_of_luminous_efficiency_is_the_cie_value():
    grid = np.arange(360.0, 831.0)
    # 106.857 nm is the integral of the CIE's 1 nm table.
    assert np.trapezoid(luminous_efficiency(grid), grid) == pytest.approx(106.857, rel=1e-4)


def test_planckian_peaks_by_wiens_law_and_falls_like_stefan_boltzmann_predicts():
    spectrum = planckian(5000)
    peak = spectrum.wavelengths_nm[int(np.argmax(spectrum.values))]
    assert peak == pytest.approx(2.897771955e6 / 5000, abs=10)  # grid step
    # Tables of the black body: 0.9142 of the total lies below λT = 10 000 µm·K, 0.0128 below 1500.
    grid = np.linspace(300, 2000, 20001)
    scale = 2 * math.pi * 6.62607015e-34 * 299792458**2
    at_peak = scale / (peak * 1e-9) ** 5 / math.expm1(0.01438776877 / (peak * 1e-9 * 5000))
    total = np.trapezoid(spectrum(grid), grid) * 1e-9 * at_peak
    assert total / (sigma * 5000**4) == pytest.approx(0.9142 - 0.0128, abs=2e-3)


def test_spectrum_is_constant_beyond_its_ends_and_refuses_nonsense():
    spectrum = Spectrum((400.0, 500.0), (1.0, 3.0))
    np.testing.assert_allclose(spectrum([300, 450, 900]), [1, 2, 3])
    assert flat(0.3)(123.0) == 0.3
    for wavelengths in ((500.0, 400.0), (400.0, math.nan), (400.0, math.inf)):
        with pytest.raises(ValueError, match="must increase and be finite"):
            Spectrum(wavelengths, (1.0, 1.0))
    with pytest.raises(ValueError, match="non-negative"):
        Spectrum((400.0, 500.0), (1.0, -1.0))
    with pytest.raises(ValueError, match="one value per wavelength"):
        Spectrum((400.0, 500.0), (1.0,))


BANDS = tuple((float(a), float(a + 50)) for a in range(400, 700, 50))


def band_means(spectrum):
    return np.array([spectrum(np.linspace(*band, 501)).mean() for band in BANDS])


def test_what_has_the_spectrum_of_the_light_is_neutral():
    light = planckian(9000)
    assert encode_srgb(np.array([-1, 0.2140, 2])).tolist() == [0, 127, 255]  # middle gray
    pixel = linear_srgb(band_means(light), BANDS, light)
    np.testing.assert_allclose(pixel, pixel.mean(), rtol=1e-4)


def test_y_matching_function_is_the_luminous_efficiency():
    grid = np.arange(400.0, 701.0)
    # The Gaussian fit is good to about 1 % of the peak.
    error = matching_functions(grid)[:, 1] - luminous_efficiency(grid)
    assert np.abs(error).max() < 0.02


@pytest.mark.parametrize("level", LEVELS)
def test_primaries_add_up_to_the_light_and_share_its_luminance_as_srgb_does(level):
    light = LEVELS[level].spectrum()
    spectra = primaries(light)
    grid = np.array(spectra[0].wavelengths_nm)
    # On the primaries' own grid nothing is interpolated: float64 rounding is all that remains.
    np.testing.assert_allclose(sum(each(grid) for each in spectra), light(grid), rtol=1e-12)
    total = sum(map(luminous, spectra))
    np.testing.assert_allclose(
        [luminous(each) / total for each in spectra], LUMINANCE_SHARES, atol=1e-9
    )
    # Corners of the light's table between the grid's points.
    assert total == pytest.approx(LEVELS[level].illuminance_lux, rel=2e-3)


GRID = np.arange(KNOWN_NM[0], KNOWN_NM[1] + 1, 1.0)
D65 = SPECTRA["D65"](GRID)
XYZ_OF_SRGB = np.array(
    [
        [0.4124564, 0.3575761, 0.1804375],
        [0.2126729, 0.7151522, 0.0721750],
        [0.0193339, 0.1191920, 0.9503041],
    ]
)


@pytest.fixture(scope="module")
def observer():
    """CIE 1931 standard observer (wavelengths, 3), from Mitsuba's tables."""
    mitsuba.set_variant("scalar_spectral")
    return np.array([np.ravel(mitsuba.cie1931_xyz(float(each))) for each in GRID], np.float64)


def seen(reflectance, observer):
    """Color (..., 3) of a reflectance (..., wavelengths) in D65, in linear sRGB; of white, 1."""
    xyz = (reflectance * D65) @ observer / (D65 @ observer) * XYZ_OF_SRGB.sum(axis=1)
    return xyz @ np.linalg.inv(XYZ_OF_SRGB).T


@pytest.mark.parametrize("color", [*np.eye(3), *np.random.default_rng(1).random((20, 3))])
def test_a_color_has_a_reflectance_that_looks_like_it_in_daylight(color, observer):
    reflectance = reflectance_of_color(color)(GRID)
    assert reflectance.min() >= 0 and reflectance.max() <= 1 + 1e-9
    # Tables have four digits; the inverse of the matrix multiplies their rounding by up to 3.
    np.testing.assert_allclose(seen(reflectance, observer), color, atol=3e-4)


def test_red_green_and_blue_add_up_to_a_perfect_white():
    np.testing.assert_allclose(RED(GRID) + GREEN(GRID) + BLUE(GRID), 1, atol=1e-9)


def test_the_primaries_are_the_smoothest_with_their_colors(observer):
    knots = np.linspace(*KNOWN_NM, 48)
    n = len(knots)
    tents = np.array([np.interp(GRID, knots, row) for row in np.eye(n)])
    colors = seen(tents, observer)
    heavy = 1e4  # of conditions, in the least squares of the steps
    rows = np.concatenate(
        [
            np.kron(np.eye(3), np.diff(np.eye(n), axis=0)),
            heavy * np.kron(np.eye(3), colors.T),
            heavy * np.tile(np.eye(n), 3),
        ]
    )
    wanted = np.concatenate([np.zeros(3 * (n - 1)), heavy * np.eye(3).ravel(), np.full(n, heavy)])
    best = nnls(rows, wanted, maxiter=10_000)[0].reshape(3, n)
    for found, expected in zip((RED, GREEN, BLUE), best, strict=True):
        np.testing.assert_allclose(found(knots), expected, atol=2e-3)


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("band", [(300, 320), (359, 420), (1780, 1801), (3000, 4000)])
def test_bands_in_which_the_light_is_unknown(level, band):
    fields = {
        "light": {"level": level},
        "render": {"bands_nm": [band]},
        "scene": {"kind": "forest"},
    }
    with pytest.raises(UserError, match=rf"light '{level}': .* known from 360 to 1800 nm"):
        validated(Configuration, fields, "a.yaml", {})


SOIL, BLADE = reflectance_of("soil * 1.6"), leaf_of("dry leaf")


@pytest.mark.parametrize(
    ("material", "band", "said"),
    [
        (Material(SOIL), (370, 400), "380 to 1700"),
        (Material(SOIL), (1600, 1750), "380 to 1700"),
        (Material(BLADE.reflectance, transmittance=BLADE.transmittance), (380, 420), "400 to 2500"),
        (Material(flat(0.1), Texture(np.ones((2, 2), "f4"), SOIL)), (1600, 1750), "380 to 1700"),
        (Material(flat(0.0), emission=Emission(Spectrum((500, 600), (1, 2)))), (590, 610), "500 to 600"),
        (Material(flat(0.3), known_nm=(500, 600)), (590, 610), "500 to 600"),
    ],
)  # fmt: skip
def test_bands_in_which_a_surface_is_unknown(material, band, said):
    scene = Scene({"it": material}, {}, ())
    with pytest.raises(
        ValueError, match=f"material 'it': .* known from {said} nm, and bands_nm has"
    ):
        scene.check_bands([(550, 560), band])
    scene.check_bands([(550, 560)])


ENTRIES = strict_yaml.load(TABLE.read_text("utf-8"))
TOLERANCE = 0.004
"""Largest error of a straight line between two wavelengths of a leaf's table."""


@pytest.mark.parametrize("name", LEAVES)
def test_tables_are_what_the_model_gives_for_the_parameters_beside_them(name):
    xleaf = pytest.importorskip("xleaf")
    table, wavelengths = dict(ENTRIES[name]), 1000 * np.asarray(xleaf.wavelengths, np.float64)
    curves = np.array(xleaf.simulate_leaf(**table.pop("prospect"), transmittance=True)).round(3)
    kept, off = [0, len(wavelengths) - 1], np.array(np.inf)
    while off.max() > TOLERANCE:
        lines = [np.interp(wavelengths, wavelengths[kept], each[kept]) for each in curves]
        off = np.abs(lines - curves).max(axis=0)
        kept = sorted({*kept, int(off.argmax())}) if off.max() > TOLERANCE else kept
    values = [each[kept].tolist() for each in (wavelengths.round(), *curves)]
    assert table == dict(zip(("wavelengths_nm", *Leaf._fields), values, strict=True))
