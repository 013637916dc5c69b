"""Published figures of light outdoors, W/m² in bands."""

import math

import numpy as np

BANDS = ((400, 700), (700, 900), (900, 1100), (1100, 1400), (1400, 1700))
# ASTM G173-03 (direct) and SPCTRL2 (sky) at all of their wavelengths
SUN = np.array((374.8, 191.2, 113.9, 82.69, 53.03))
SKY = np.array((56.54, 10.7, 4.119, 2.173, 0.9256))
# Kieffer and Stone's figure of the disc at a phase of 7°, over its value at 550 nm, with libration
FULL_MOON_NM = np.array([441.6, 549.1, 665.1, 865.3, 1059.5, 1243.2, 1538.7, 1633.6])
FULL_MOON = np.array([0.81, 1.00, 1.23, 1.38, 1.52, 1.62, 1.90, 1.92])
ARCSEC2_SR = math.radians(1 / 3600) ** 2


def in_bands(spectrum):
    grids = [np.linspace(*band, 3001) for band in BANDS]
    return np.array([np.trapezoid(spectrum(grid), grid) for grid in grids])


def quarter_moon(wavelengths_nm):
    """Kieffer and Stone (2005): the best line to 2 µm, over its value at 550 nm."""
    return 1 + 1.39 * (wavelengths_nm - 550) / 1000
