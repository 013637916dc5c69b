"""Light on the die against integrals over the exit pupil of the lens.

The pupil is a disc of diameter f/N at the distance f from the die, every point of it as bright as
the scene, L. Seen from a point s of the die, a piece dA of it at p adds L·cos²θ·dA/|p − s|² with
cos θ = f/|p − s|. Both laws of `optics` follow from this: π/(4·N² + 1) on the axis, and cos⁴ where
the pupil is narrow.
"""

import math
from collections.abc import Iterator

import numpy as np
from scipy.constants import c, h
from scipy.integrate import dblquad, quad

from megalopta.sensor.optics import Efficiency, Lens, Transmission, photon_rate
from megalopta.sensor.selfcheck.comparison import Row, exact_row
from megalopta.sensor.spad import Sensor, detection_rate

_CURVE = Efficiency(wavelengths_nm=(400, 550, 700), values=(0.1, 0.4, 0.2))
_ROWS, _COLUMNS, _FOV_DEG = 5, 9, 80.0


def check_lens() -> Iterator[Row]:
    """Detections of a pixel on the axis, for fast and slow lenses."""
    radiance = 1e-6
    per_watt, _ = quad(
        lambda nm: float(_CURVE(np.array(nm))) * nm * 1e-9 / (h * c), 400, 700, points=[550]
    )
    for f_number, transmission in ((0.95, 0.9), (1.4, 1.0), (5.6, 0.8)):
        sensor = _sensor(Lens(f_number=f_number, transmission=transmission))
        photons = radiance * transmission * _seen_pupil(f_number, 0.0, 0.0) * per_watt
        measured = detection_rate(np.full((1, 1, 1, 1), radiance), [(400, 700)], sensor)
        expected = photons * 0.5 * 10e-6**2
        yield exact_row(
            "lens",
            f"detections at f/{f_number:g} (1/s)",
            expected,
            float(measured[0, 0, 0]),
            1e-6 * expected,
        )


def check_transmission() -> Iterator[Row]:
    """Detections and photons through a lens that passes some wavelengths more than others."""
    radiance, f_number = 1e-6, 2.0
    passing = Transmission(wavelengths_nm=(350, 500, 750), values=(0.2, 0.9, 0.5))
    sensor = _sensor(Lens(f_number=f_number, transmission=0.8, transmission_curve=passing))
    light = radiance * 0.8 * _seen_pupil(f_number, 0.0, 0.0) * 10e-6**2
    image, bands = np.full((1, 1, 1, 1), radiance), [(400, 700)]

    def photons(nm: float) -> float:
        return float(np.interp(nm, (350, 500, 750), (0.2, 0.9, 0.5))) * nm * 1e-9 / (h * c)

    for name, measured, per_watt in (
        ("photons", photon_rate(image, bands, sensor), photons),
        (
            "detections",
            detection_rate(image, bands, sensor),
            lambda nm: 0.5 * float(_CURVE(np.array(nm))) * photons(nm),
        ),
    ):
        whole, _ = quad(per_watt, 400, 700, points=[500, 550])
        yield exact_row(
            "lens, by wavelength",
            f"{name} (1/s)",
            light * whole,
            float(measured[0, 0, 0]),
            1e-6 * light * whole,
        )


def check_falloff() -> Iterator[Row]:
    """Light at the edges of an image relative to its middle."""
    f_number = 100.0
    sensor = _sensor(Lens(f_number=f_number, falloff_fov_deg=_FOV_DEG))
    image = detection_rate(np.ones((1, _ROWS, _COLUMNS, 1)), [(400, 700)], sensor)[0]
    focal_pixels = _COLUMNS / 2 / np.tan(np.radians(_FOV_DEG / 2))
    right, down = _COLUMNS // 2 / focal_pixels, _ROWS // 2 / focal_pixels
    axis = _seen_pupil(f_number, 0.0, 0.0)
    for name, row, column, at in (
        ("right edge", _ROWS // 2, -1, (right, 0.0)),
        ("top edge", 0, _COLUMNS // 2, (0.0, -down)),
        ("corner", -1, 0, (-right, down)),
    ):
        measured = float(image[row, column] / image[_ROWS // 2, _COLUMNS // 2])
        # a pupil of f/100 is wide enough to differ from a point by some 1e-4
        yield exact_row(
            "cos⁴ falloff", f"{name} over middle", _seen_pupil(f_number, *at) / axis, measured, 3e-4
        )


def check_blur() -> Iterator[Row]:
    """A point and a grating through a lens that blurs by so many pixels."""
    point = np.zeros((1, 81, 81, 1))
    point[:, 40, 40] = 1.0
    places = np.arange(81) - 40.0
    grating = 1 + np.cos(2 * np.pi * np.arange(96) / 16) * np.ones((1, 3, 96))
    for blur_px in (1.0, 3.0):
        sensor = _sensor(Lens(f_number=4.0, blur_m=blur_px * 10e-6))
        spot = detection_rate(point, [(400, 700)], sensor)[0]
        bars = detection_rate(grating[..., np.newaxis], [(400, 700)], sensor)[0, 1, 32:64]
        quantities = {
            "variance of a point (px²)": (
                blur_px**2,
                float(places**2 @ spot.sum(axis=1) / spot.sum()),
            ),
            "contrast left of 16 px": (
                math.exp(-2 * (math.pi * blur_px / 16) ** 2),
                float(np.ptp(bars) / (bars.max() + bars.min())),
            ),
        }
        for name, (expected, measured) in quantities.items():
            # tails end at four standard deviations, with a thousandth of the variance
            tolerance = 2e-3 * expected
            yield exact_row("blur", f"{name} at {blur_px:g} px", expected, measured, tolerance)


def _sensor(lens: Lens) -> Sensor:
    return Sensor(
        name="optics", pitch_m=10e-6, fill_factor=0.5, exposure_s=1.0, lens=lens, efficiency=_CURVE
    )


def _seen_pupil(f_number: float, x: float, y: float) -> float:
    """Irradiance per radiance of the pupil at a point of the die, in focal lengths, sr."""
    seen, _ = dblquad(
        lambda r, phi: r / (1 + (r * np.cos(phi) - x) ** 2 + (r * np.sin(phi) - y) ** 2) ** 2,
        0,
        2 * np.pi,
        0,
        1 / (2 * f_number),
    )
    return float(seen)
