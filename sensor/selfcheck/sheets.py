"""Sensors by name against the figures that they are made from, copied from the source once more.

Table 2.1 of the dissertation is held against what its devices do in the dark and in light of the
wavelength printed there. Of other sensors the figures are compared as they are, and their curves of
efficiency by area, ∫ η dλ, and center, ∫ η·λ dλ / ∫ η dλ, which any point moves.
"""

from collections.abc import Iterator

import numpy as np
from scipy.constants import c, h

from megalopta.sensor import Sensor, event_moments
from megalopta.sensor.ctia import CTIA_PRESETS, PHOTODIODES, CtiaSensor, reverse_current
from megalopta.sensor.optics import Efficiency
from megalopta.sensor.selfcheck.comparison import Row, exact_row, worst, worst_of_each
from megalopta.sensor.spad import PRESETS, TABLE_2_1, detection_rate

# Hz, µm², V, efficiency, nm
_TABLE = {
    "niclass-800nm": (350, 38, 5, 0.12, 635),
    "niclass-350nm": (750, 78, 3.3, 0.36, 465),
    "mandai-180nm": (5e3, 78, 4, 0.36, 600),
    "gersbach-130nm-5v": (11e3, 58, 5, 0.36, 480),
    "gersbach-130nm-2v": (220, 58, 2, 0.26, 480),
    "richardson-130nm": (25, 50, 1.4, 0.28, 500),
    "webster-130nm": (1e3, 50, 12, 0.72, 560),
}
_DENSITIES = (9.2, 9.6, 64, 190, 3.8, 0.5, 20)
"""Hz/µm², as printed beside them"""
_F_NUMBER, _TRANSMISSION, _EXPOSURE_S = 1.4, 0.9, 0.1

# pitch, fill factor, exposure, area of the curve, its center; nm, m, s
_PIXELS = {
    "ideal": (60e-6, 1.0, 0.1, 1800.0, 1100.0),
    "spadcam": (60e-6, 0.1, 0.1, 1.4075, 522.14328),
    "array-12x4": (250e-6, 0.0314, 0.1, 148.25, 594.85666),
    "ctia_si": (0.31e-6**0.5, 1.0, 0.1, 228.1, 894.76107),
    "ctia_ingaas": (4.53e-8**0.5, 1.0, 0.01, 623.25, 1310.39444),
    "ctia_ingaas_quiet": (4.53e-8**0.5, 1.0, 0.1, 623.25, 1310.39444),
}
_CTIA = {
    "capacitance_f": 10e-12,
    "swing_v": 3.3,
    "gain_db": 130.0,
    "gain_sigma_db": 3.4,
    "offset_v": 18.7e-3,
    "offset_sigma_v": 10e-3,
    "dark_sigma": 0.1,
    "noise.read_noise_v": 100e-6,
}
_FIGURES = {
    "spadcam": {
        "bias.excess_v": 1.18,
        "bias.reference_v": 1.18,
        "bias.onset_v": 0.87,
        "bias.efficiency_scale_v": 0.2,
        "bias.dark_efold_v": 0.12,
        "bias.breakdown_sigma_v": 0.042,
        "dark_counts.bulk_mean_hz_um2": 0.765,
        "dark_counts.bulk_sigma_hz_um2": 0.2,
        "dark_counts.hot_fraction": 0.276,
        "dark_counts.hot_mean_hz_um2": 4.0,
        "dark_counts.hot_sigma_hz_um2": 0.2,
        "dead_time.dead_time_s": 1e-6,
        "temperature.dcr_doubling_k": 9.0,
        "counter.step_v": 10e-3,
        "counter.swing_v": 3.2,
        "counter.supply_v": 3.3,
        "counter.leak_v_s": 7.2e-3,
        "counter.leak_sigma_v_s": 0.69e-3,
        "counter.read_noise_v": 1e-3,
        "counter.adc_bits": 12,
    },
    "array-12x4": {
        "dark_counts.hot_fraction": 1.0,
        "dark_counts.hot_mean_hz_um2": 0.26,
        "dark_counts.hot_sigma_hz_um2": 0.79,
        "dead_time.dead_time_s": 120e-9,
        "crosstalk.mean_fired_neighbors": 4.82e-3,
        "crosstalk.diagonal": 162 / 1030,
        "crosstalk.distance_two": 13 / 1030,
    },
    **dict.fromkeys(CTIA_PRESETS, _CTIA),
}
# diode, reverse bias (V), dark current (A) there and its last digit
_DIODES = (
    ("si", 10.0, 50e-12, 0.1e-12),
    ("si", 15e-3, 1.6e-12, 0.005e-12),
    ("ingaas", 0.1, 170e-9, 0.05e-9),
    ("ingaas_quiet", 0.1, 97.91e-12, 0.05e-12),
)


def check_table_devices() -> Iterator[Row]:
    """Counts in the dark and in light of the printed wavelength."""
    names = set(_TABLE) ^ set(TABLE_2_1)
    yield exact_row("Table 2.1", "devices too many or missing", 0, len(names), 1e-9)
    yield from worst_of_each(
        _table_rows(name, density) for name, density in zip(_TABLE, _DENSITIES, strict=True)
    )


def check_sheets() -> Iterator[Row]:
    """Pixels, efficiency curves, circuits and diodes."""
    sensors: dict[str, Sensor | CtiaSensor] = {**PRESETS, **CTIA_PRESETS}
    for name, expected in _PIXELS.items():
        sensor = sensors[name]
        area, center = _area_and_center(sensor.efficiency)
        pixel = (sensor.pitch_m, sensor.fill_factor, sensor.exposure_s, area, center)
        lens = (sensor.lens.f_number, sensor.lens.transmission)
        yield _row(name, "pixel and efficiency", expected, pixel)
        yield _row(name, "lens", (_F_NUMBER, _TRANSMISSION), lens)
    for name, figures in _FIGURES.items():
        found = tuple(_field(sensors[name], path) for path in figures)
        yield _row(name, "circuit", tuple(figures.values()), found)
    for name, bias_v, current_a, digit_a in _DIODES:
        found_a = float(reverse_current(PHOTODIODES[name], bias_v))
        quantity = f"{name}, dark current at {bias_v:g} V (A)"
        yield exact_row("photodiode", quantity, current_a, found_a, digit_a)


def _table_rows(name: str, density: float) -> tuple[Row, ...]:
    dark_hz, area_um2, excess_v, efficiency, nm = _TABLE[name]
    sensor, printed = PRESETS[name], TABLE_2_1[name]
    dark, _ = event_moments(np.zeros((1, 1, 1)), sensor)
    seen = detection_rate(np.ones((1, 1, 1, 1)), [(nm - 1, nm + 1)], sensor)
    irradiance = np.pi * _TRANSMISSION / (4 * _F_NUMBER**2 + 1)
    photons = 2 * irradiance * nm * 1e-9 / (h * c)
    expected = photons * area_um2 * 1e-12 * efficiency
    due = dark_hz * _EXPOSURE_S
    bias_v = sensor.bias.excess_v, sensor.bias.reference_v
    return (
        exact_row("Table 2.1", f"dark counts ({name})", due, dark.item(), 1e-9 * due),
        exact_row("Table 2.1", f"detections ({name}, Hz)", expected, seen.item(), 1e-6 * expected),
        _row(
            "Table 2.1",
            f"bias, density, wavelength ({name})",
            (excess_v, excess_v, density, nm),
            (*bias_v, printed.density_hz_um2, printed.peak_nm),
        ),
    )


def _row(term: str, quantity: str, expected: tuple[float, ...], found: tuple[float, ...]) -> Row:
    """Return the worst of several figures, which are given to eight digits."""
    return worst(
        [
            exact_row(term, f"{quantity} (worst)", right, got, 1e-7 * abs(right))
            for right, got in zip(expected, found, strict=True)
        ]
    )


def _field(sensor: Sensor | CtiaSensor, path: str) -> float:
    value: object = sensor
    for name in path.split("."):
        value = getattr(value, name)
    assert isinstance(value, int | float)
    return float(value)


def _area_and_center(efficiency: Efficiency) -> tuple[float, float]:
    """∫ η dλ and ∫ η·λ dλ over it, both exact between two points; nm."""
    nm, value = np.array(efficiency.wavelengths_nm), np.array(efficiency.values)
    width, middle = np.diff(nm), (nm[1:] + nm[:-1]) / 2
    mean, rise = (value[1:] + value[:-1]) / 2, np.diff(value)
    area = float(width @ mean)
    return area, float(width @ (mean * middle + rise * width / 12)) / area
