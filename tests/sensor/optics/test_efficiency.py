import numpy as np
import pytest
from scipy.integrate import quad

from megalopta.sensor.optics.efficiency import Efficiency, band_efficiency

CURVE = Efficiency(wavelengths_nm=(380, 450, 470, 620, 900), values=(0.02, 0.3, 0.21, 0.5, 0.0))


@pytest.mark.parametrize(
    "band", [(380.0, 900.0), (400.0, 440.0), (449.0, 451.0), (469.999, 620.001), (600.0, 601.0)]
)
def test_band_mean_equals_numerical_integral(band):
    nodes = [*band, *(w for w in CURVE.wavelengths_nm if band[0] < w < band[1])]
    pieces = zip(sorted(nodes)[:-1], sorted(nodes)[1:], strict=True)
    detected = sum(
        quad(lambda nm: np.interp(nm, CURVE.wavelengths_nm, CURVE.values) * nm, *piece)[0]
        for piece in pieces
    )
    photons = quad(lambda nm: nm, *band)[0]
    assert band_efficiency(CURVE, [band])[0] == pytest.approx(detected / photons, rel=1e-12)


def test_constant_efficiency_is_the_same_in_every_band():
    constant = Efficiency(wavelengths_nm=(300, 1000), values=(0.37, 0.37))
    bands = [(300.0, 1000.0 / 3), (500.0, 500.1), (700.0, 1000.0)]
    np.testing.assert_allclose(band_efficiency(constant, bands), 0.37, rtol=1e-12)


def test_detected_photons_add_up_over_adjacent_bands():
    edges = np.array([390.0, 455.0, 480.0, 700.0, 880.0])
    bands = np.stack([edges[:-1], edges[1:]], axis=1)
    photons = (edges[1:] ** 2 - edges[:-1] ** 2) / 2
    whole = band_efficiency(CURVE, [(390.0, 880.0)])[0] * photons.sum()
    assert (band_efficiency(CURVE, bands) * photons).sum() == pytest.approx(whole, rel=1e-13)


@pytest.mark.parametrize("band", [(379.0, 500.0), (500.0, 900.5), (1000.0, 1100.0)])
def test_band_outside_the_curve_is_refused_with_both_ranges(band):
    with pytest.raises(ValueError, match=rf"{band[0]:g}–{band[1]:g} nm.*380–900 nm"):
        band_efficiency(CURVE, [band])


@pytest.mark.parametrize(
    ("wavelengths", "values", "message"),
    [
        ((400, 500), (0.1, 1.2), "less than or equal to 1"),
        ((400, 500), (0.1, -0.1), "greater than or equal to 0"),
        ((400, 500), (0.1, np.nan), "finite"),
        ((500, 400), (0.1, 0.2), "sort the curve"),
        ((400, 400), (0.1, 0.2), "sort the curve"),
        ((400, 500), (0.1,), "one value per wavelength"),
        ((400,), (0.1,), "at least 2"),
    ],
)
def test_impossible_curve_is_refused(wavelengths, values, message):
    with pytest.raises(ValueError, match=message):
        Efficiency(wavelengths_nm=wavelengths, values=values)
