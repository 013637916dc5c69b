"""Scale from rendered light to the light level of an exposure."""

import numpy as np
from numpy.typing import NDArray

from megalopta.config.model import Configuration, LightLevel
from megalopta.scenes.levels import LEVELS, illuminance_of
from megalopta.scenes.spectra.spectrum import Spectrum


def light_scale(configuration: Configuration, level: LightLevel) -> NDArray[np.float64]:
    """Factor (B,) per band from the rendered light to a level.

    A named level has its own spectrum, constant within a band. A level in lux, and a self-luminous
    scene, keep the rendered color.
    """
    light, scene = configuration.light, configuration.scene
    bands = configuration.render.bands_nm
    is_rendered = level == light.level and scene.has_truth
    if scene.is_self_luminous or is_rendered or not isinstance(level, str):
        return np.full(len(bands), illuminance_of(level) / light.resolved().illuminance_lux)
    before, after = scene.white(light), LEVELS[level].spectrum()
    return np.array([_band_mean(after, band) / _band_mean(before, band) for band in bands])


def _band_mean(spectrum: Spectrum, band: tuple[float, float]) -> float:
    grid = np.linspace(*band, 1025)  # airglow is piecewise linear, with a node every 20 nm
    return float(np.trapezoid(spectrum(grid), grid) / (band[1] - band[0]))
