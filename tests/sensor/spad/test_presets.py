"""Arrays as published: their figures come out of the presets, and what is assumed is named."""

import math

import numpy as np
import pytest

from megalopta.sensor import changed, expose, preset
from megalopta.sensor.spad.device import draw_fixed_pattern
from megalopta.sensor.spad.presets import PRESETS

# preset: wavelength (nm) and efficiency of a pixel at the peak, median dark counts (Hz), frames (Hz)
FIGURES = {
    "swissspad2": (520, 0.105 * 0.5, 7.5, 97_700), "swissspad3": (520, 0.105 * 0.5, 10, 97_700),
    "spad512s": (520, 0.105 * 0.5, 25, 1e5), "spad512-squared": (520, 0.5 * 0.5, 25, 1e5),
    "linospad2": (520, 0.251 * 2.3 * 0.53, 80, 1e3), "spcimager": (480, 0.268 * 0.395, 47, 50),
    "mpd-spc3": (450, math.pi * (15 / 150) ** 2 * 0.55, 100, 1e5),
    "pf32": (500, 0.015 * 0.27, 100, 1e5), "canon-3mp": (510, 0.694, 1.8, 60),
}  # fmt: skip


@pytest.mark.parametrize("name", FIGURES)
def test_the_figures_of_an_array_come_out_of_its_preset(name):
    peak_nm, pde, dark_hz, rate_hz = FIGURES[name]
    sensor, curve = preset(name), preset(name).efficiency
    assert curve.wavelengths_nm[np.argmax(curve.values)] == peak_nm
    assert float(sensor.photon_detection_efficiency(peak_nm)) == pytest.approx(pde, rel=1e-3)
    assert 1 / sensor.exposure_s == pytest.approx(rate_hz, rel=1e-3)
    ((_, drawn_hz),) = draw_fixed_pattern(sensor, (128, 128)).dark_levels()
    # four standard errors of a log-normal median, σ 1.525
    assert abs(math.log(np.median(drawn_hz) / dark_hz)) < 4 * 1.525 * math.sqrt(math.pi / 2) / 128
    frame = expose(np.full((1, 8, 8, 1), 1e-3), [(500, 540)], name, seed=0, stream="a").counts
    assert frame.shape == (1, 8, 8) and frame.max() <= sensor.counter.capacity


def test_what_is_assumed_is_a_field():
    assert {name for name, sensor in PRESETS.items() if sensor.assumed} == set(FIGURES)
    with pytest.raises(ValueError, match="assumed: 'gain: 3' does not begin with a field"):
        changed(preset("ideal"), assumed=("gain: 3",))
