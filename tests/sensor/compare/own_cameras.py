"""Counts, bits and codes of an own simulation, not the program's: Poisson arrivals that dead time
thins one by one, own maps of a device, own readout."""

from pathlib import Path

import numpy as np
from numba import njit

from megalopta.sensor import changed, preset
from megalopta.sensor.calibrate.level import Level
from megalopta.sensor.compare.model import level_of_codes

FRAMES, TOP, EFFICIENCY = 300, 4095, 0.35
CAMERAS = {
    "counts": ((32, 32), ((2e-3, 0.0, 450), (1e-4, 6e5, 900), (1e-4, 4e6, 900)), 6e-8),
    "bits": ((64, 64), ((4e-4, 0.0, 900), (1e-5, 6e4, 900), (1e-5, 2e5, 900)), 0.0),
    "codes": ((16, 16), ((2e-2, 0.0, 45), (2e-4, 3e5, 900), (2e-4, 1.2e6, 900)), 1e-6),
}
"""Shape, levels (exposure s, photons per second on a pixel, frames per second) and dead time"""


class Capture:
    """One level of a camera: rates, and what happens to readings."""

    def __init__(self, camera, maps, level, rng):
        self.kind, self.rng, self.maps = camera, rng, maps
        self.shape, _, self.dead_s = CAMERAS[camera]
        self.exposure_s, self.light_hz, rate_hz = level
        self.dark = np.repeat(maps["dark_counts"][None], FRAMES, axis=0)
        self.light = (
            self.light_hz * EFFICIENCY * np.repeat(maps["efficiency"][None], FRAMES, axis=0)
        )
        self.times = np.arange(FRAMES) / rate_hz
        self.scale = np.ones((FRAMES, 1, 1))
        self.read_noise_v, self.echoes = 1e-3, ()

    def expose(self):
        """Readings that grow with the light: counts, bits, or codes below the top."""
        arrivals = self.rng.poisson((self.dark + self.light) * self.exposure_s * self.scale)
        dead = self.dead_s / self.exposure_s
        is_extended = self.kind == "codes"
        counts = _survivors(arrivals, dead, is_extended, self.rng) if dead else arrivals
        if self.echoes:  # fired at any time; arrivals that are lost fire nothing
            for row, column, share in self.echoes:
                arrivals = arrivals + _shifted(self.rng.binomial(counts, share), row, column)
            counts = _survivors(arrivals, dead, is_extended, self.rng) if dead else arrivals
        if self.kind == "bits":
            counts = np.minimum(counts, 1)
        elif self.kind == "codes":
            drop_v = counts * self.maps["step"] + self.maps["leak"] * self.exposure_s
            noise_v = self.rng.normal(0, self.read_noise_v, counts.shape) - self.maps["offset"]
            counts = np.rint((np.minimum(drop_v, 3.2) + noise_v) * TOP / 3.3).clip(0, TOP)
        self.readings = counts.astype(np.int64)

    def level(self, device):
        readings, most = self.readings, {"counts": 1023, "bits": 1, "codes": TOP}[self.kind]
        readings = np.clip(readings, 0, most)
        if self.kind != "codes":
            stored = readings.astype(np.uint16)
            return Level(stored, self.exposure_s, self.light_hz, times_s=self.times)
        codes = (TOP - readings).astype(np.uint16)
        return level_of_codes(codes, device, self.exposure_s, self.light_hz, self.times)


@njit(cache=True)
def _survivors(arrivals, dead, is_extended, rng):
    """Arrivals, uniform in an exposure of 1, that no dead time hides; extended by each, or not."""
    counts = np.zeros_like(arrivals)
    for at in np.ndindex(arrivals.shape):
        gaps = rng.standard_exponential(arrivals[at] + 1)
        limit, since = dead * gaps.sum(), np.inf
        for gap in gaps[:-1]:
            since += gap
            if since > limit:
                counts[at] += 1
                since = 0.0
            elif is_extended:
                since = 0.0
    return counts


def _shifted(frames, row, column):
    rows, columns = frames.shape[1:]
    padded = np.pad(frames, ((0, 0), (2, 2), (2, 2)))
    return padded[:, 2 - row : 2 - row + rows, 2 - column : 2 - column + columns]


def draw_maps(camera, rng):
    """Pixels of a device."""
    shape = CAMERAS[camera][0]
    maps = {
        "dark_counts": 500 * rng.lognormal(0, 0.6, shape) * (0.2 if camera == "codes" else 1),
        "efficiency": rng.normal(1, 0.06, shape).clip(0.6, 1.4),
    }
    if camera == "codes":
        steps = {"step": (1e-2, 2e-4), "leak": (7e-3, 7e-4), "offset": (0, 2e-3)}
        maps |= {name: rng.normal(*normal, shape) for name, normal in steps.items()}
    return maps


def device_of(camera, maps, folder):
    """Sensor with these maps."""
    _, _, dead_s = CAMERAS[camera]
    for name, values in maps.items():
        np.save(Path(folder) / f"{name}.npy", values)
    counter = {"kind": "digital", "capacity": 1023 if camera == "counts" else 1}
    if camera == "codes":
        counter = {"kind": "analog", "step_v": 1e-2, "read_noise_v": 1e-3, "adc_bits": 12}
    kind = {"counts": "nonparalyzable", "bits": "ideal", "codes": "paralyzable"}[camera]
    return changed(
        preset("ideal"),
        efficiency={"wavelengths_nm": (300, 1000), "values": (EFFICIENCY, EFFICIENCY)},
        dead_time={"kind": kind, **({"dead_time_s": dead_s} if dead_s else {})},
        counter=counter,
        measured={name: str(Path(folder) / f"{name}.npy") for name in maps},
    )


def calibrated(camera, maps, rng):
    """Maps as a calibration of 2000 dark frames finds them, with their standard errors."""
    seconds = 2000 * CAMERAS[camera][1][0][0]
    counts = rng.poisson(maps["dark_counts"] * seconds)
    errors = {"dark_counts": np.sqrt(np.maximum(counts, 1)) / seconds, "efficiency": 4e-3}
    light = maps["efficiency"] + rng.normal(0, errors["efficiency"], counts.shape)
    return {**maps, "dark_counts": counts / seconds, "efficiency": light}, errors
