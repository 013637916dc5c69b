import math

import numpy as np
import pytest
from scipy.constants import sigma

from megalopta.scenes.lighting.levels import LEVELS, Light, illuminance_of
from megalopta.scenes.spectra import Spectrum, flat, luminous, luminous_efficiency, planckian


@pytest.mark.parametrize("level", LEVELS)
def test_sky_and_disc_together_give_the_named_illuminance(level):
    lighting = Light(level=level).lighting()
    lux = math.pi * luminous(lighting.sky)
    if lighting.sun:
        lux += luminous(lighting.sun.irradiance) * lighting.sun.direction[2]
    assert lux == pytest.approx(LEVELS[level].illuminance_lux, rel=1e-12)


def test_overrides_replace_parts_of_a_level():
    light = Light(level="full_moon", illuminance_lux=3.0, disc_fraction=0.0)
    assert light.lighting().sun is None
    assert math.pi * luminous(light.lighting().sky) == pytest.approx(3.0)


def test_airglow_can_be_stronger_but_not_of_another_color():
    usual, strong = (
        Light(level="airglow", illuminance_lux=lux).lighting().sky(1600.0)
        for lux in (None, 1.638e-3)
    )
    assert strong == pytest.approx(2 * usual, rel=1e-9)
    for field, value in (("color_temperature_k", 4000.0), ("disc_fraction", 0.5)):
        with pytest.raises(ValueError, match=f"{field} .*spectrum of its own"):
            Light.model_validate({"level": "airglow", field: value})


def test_disc_direction_is_a_unit_vector_toward_azimuth_and_elevation():
    sun = Light(level="daylight", disc_azimuth_deg=90, disc_elevation_deg=30).lighting().sun
    np.testing.assert_allclose(sun.direction, [0, math.cos(math.pi / 6), 0.5], atol=1e-12)


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


def test_levels_are_named_or_given_in_lux():
    assert illuminance_of("starlight") == 1e-3
    assert illuminance_of(0.3) == 0.3
    with pytest.raises(ValueError, match="'dusk' is unknown: use one of daylight"):
        illuminance_of("dusk")
    with pytest.raises(ValueError, match="lux: give between 1e-12 and 1e.09 lux"):
        illuminance_of(-1.0)


@pytest.mark.parametrize("lux", [1e308, 1e-300, 0, -1])
def test_light_beyond_sense_is_refused(lux):
    with pytest.raises(ValueError, match="illuminance_lux"):
        Light(illuminance_lux=lux)


def test_spectrum_is_constant_beyond_its_ends_and_refuses_nonsense():
    spectrum = Spectrum((400.0, 500.0), (1.0, 3.0))
    np.testing.assert_allclose(spectrum([300, 450, 900]), [1, 2, 3])
    assert flat(0.3)(123.0) == 0.3
    with pytest.raises(ValueError, match="must increase"):
        Spectrum((500.0, 400.0), (1.0, 1.0))
    with pytest.raises(ValueError, match="non-negative"):
        Spectrum((400.0, 500.0), (1.0, -1.0))
    with pytest.raises(ValueError, match="one value per wavelength"):
        Spectrum((400.0, 500.0), (1.0,))
