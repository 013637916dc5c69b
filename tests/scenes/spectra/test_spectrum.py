import math

import numpy as np
import pytest
from scipy.constants import sigma

from megalopta.scenes.spectra.photometry import luminous_efficiency
from megalopta.scenes.spectra.spectrum import Spectrum, flat, planckian, total


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
    with pytest.raises(ValueError, match="must increase"):
        Spectrum((500.0, 400.0), (1.0, 1.0))
    with pytest.raises(ValueError, match="non-negative"):
        Spectrum((400.0, 500.0), (1.0, -1.0))
    with pytest.raises(ValueError, match="one value per wavelength"):
        Spectrum((400.0, 500.0), (1.0,))


def test_sum_of_spectra_is_exact_between_their_wavelengths():
    first, second = Spectrum((400.0, 500.0), (1.0, 3.0)), Spectrum((450.0, 480.0), (2.0, 0.0))
    grid = np.linspace(380, 520, 71)
    np.testing.assert_allclose(total([first, second])(grid), first(grid) + second(grid))
    assert total([])(500.0) == 0
