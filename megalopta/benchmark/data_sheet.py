"""Data sheet of an image sensor: what a typical pixel reads over light, without drawing photons.

Means and variances are those of the sensor stage (`sensor.expectations`), of the middle 16 × 16
pixels at most; a typical pixel has the median over them. Light comes as photons of one wavelength
on a whole pixel in an exposure, or from a surface of the stated reflectance at a light level,
through the sensor's lens, on its axis. A pixel of a mosaic is one without its color filter.

    SNR             slope of the mean reading over light, times the light, over the standard
                    deviation of a reading (EMVA 1288, referred to the exposure); ideal: √photons
    threshold       least light at which the SNR is 1
    saturation      least light at which the mean reading is at 90 % of its range
    dynamic range   their ratio, 20·log₁₀
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from megalopta.benchmark.design import covered_nm, white_radiance
from megalopta.core import strict_yaml
from megalopta.core.arrays import Floats
from megalopta.core.bounded import read_text
from megalopta.core.errors import UserError, refused_as
from megalopta.core.progress import step
from megalopta.scenes import Pictures
from megalopta.scenes.levels import LEVELS
from megalopta.sensor import ImageSensor, Sensor, changed, detected_photons, expectation, without
from megalopta.sensor.image_sensors import sensor_named
from megalopta.sensor.optics import photon_rate
from megalopta.sensor.spad.device import draw_fixed_pattern

REFLECTANCE = float(Pictures.model_fields["reflectance"].default)
HOT_TIMES = 10.0
"""Dark counts of a hot pixel, in multiples of the median"""
FULL = 0.9
"""Share of the range of readings at which a pixel counts as saturated"""
_LIGHT_NM, _BAND_NM, _LINE_NM, _USUAL_NM = (360.0, 1800.0), 25.0, 1.0, 550.0
"""Where the spectra of light levels are known; widths of their bands and of a line of light"""
_SIDE, _DARK_SIDE, _BRIGHTER, _AT_REST_S = 16, 128, 0.01, 1e-9
_DECADE = 10.0 ** (np.arange(10) / 10)
_FEWEST_DETECTED, _MOST_READ = 0.1, 1e9
_STILL_GROWS = 1.02
"""Growth of the mean reading in a decade of light, below which a pixel is full"""


class Readings(NamedTuple):
    """A typical pixel over light, each (N,)."""

    photons: Floats
    """On a whole pixel in an exposure"""
    mean: Floats
    """Mean reading: counts, or electrons of a CTIA array"""
    sigma: Floats
    """Standard deviation of a reading"""
    snr: Floats


@dataclass(frozen=True, eq=False, kw_only=True)
class DataSheet:
    """Figures of a sensor; NaN: never, or too slow to compute."""

    sensor: ImageSensor
    preset: str
    """Preset that supplies what a device file does not state; "" without one"""
    stated: frozenset[str]
    """Fields that the device file states"""
    left_out: str
    """Effect that the readings leave out, as it would take too long; "" if none"""
    wavelength_nm: float
    """Of the photons"""
    pde: float
    """Photon detection efficiency of a whole pixel there"""
    curve: Readings
    """Over photons of that wavelength, ten per decade"""
    lux_per_photon: float
    """Daylight that is detected as often as one of these photons, lux"""
    threshold_photons: float
    saturation_photons: float
    dark_hz: Floats
    """(rows, columns) dark counts, or dark electrons, per second"""
    levels: Mapping[str, Readings]
    """(1,) at light levels, the brightest first, over photons of all wavelengths of `range_nm`"""
    range_nm: tuple[float, float]

    @property
    def dynamic_range_db(self) -> float:
        """Saturation over threshold, dB."""
        return 20 * math.log10(self.saturation_photons / self.threshold_photons)

    @property
    def hot_share(self) -> float:
        """Share of pixels whose dark counts exceed ten times the median."""
        return float(np.mean(self.dark_hz > HOT_TIMES * np.median(self.dark_hz)))

    def to_dict(self) -> dict[str, Any]:
        """Return all figures as plain data; what is never reached is None."""
        figures = {field.name: getattr(self, field.name) for field in fields(self)}
        plain: dict[str, Any] = _plain(
            {
                **figures,
                "sensor": self.sensor.model_dump(mode="json"),
                "dark_hz": {"median": np.median(self.dark_hz), "mean": self.dark_hz.mean()},
                **{"dynamic_range_db": self.dynamic_range_db, "hot_share": self.hot_share},
            }
        )
        return plain


def _plain(value: Any) -> Any:
    """Return arrays and records as lists and mappings, NaN as None."""
    if isinstance(value, Readings):
        value = value._asdict()
    if isinstance(value, Mapping):
        return {name: _plain(inner) for name, inner in value.items()}
    if isinstance(value, np.ndarray | tuple | frozenset):
        return [_plain(inner) for inner in value]
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    return value


@step("reading over light")
def data_sheet(sensor: ImageSensor | str | Path, wavelength_nm: float | None = None) -> DataSheet:
    """Return the data sheet of a sensor, of a preset's name, or of a device's YAML file.

    `wavelength_nm`: of the photons; default: 550 nm if the efficiency is largest there, else where
    it is. Raises UserError if the sensor is unknown or damaged, or sees nothing there.
    """
    preset, stated = "", frozenset[str]()
    with refused_as("sensor"):
        given, sensor = sensor, sensor_named(sensor)
        if isinstance(given, str | Path) and str(given).endswith((".yaml", ".yml")):
            written = strict_yaml.load(read_text(Path(given)))
            preset, stated = str(written.get("preset", "")), frozenset(written)
        # a clear pixel on the axis
        filters = dict.fromkeys(("red", "green", "blue", "white")) | {"mosaic": ()}
        lens = {"falloff_fov_deg": None, "blur_m": 0.0}
        pixel = changed(sensor, lens=lens, filters=filters)
        shape, dark_shape = (_SIDE, _SIDE), (_DARK_SIDE, _DARK_SIDE)
        if isinstance(pixel, Sensor) and (size := pixel.measured.shape):
            pixel = changed(pixel, measured={"fit": "center"})
            shape, dark_shape = (min(size[0], _SIDE), min(size[1], _SIDE)), size

        low_nm, high_nm = covered_nm(pixel)
        nm = _peak_nm(pixel, low_nm, high_nm) if wavelength_nm is None else wavelength_nm
        line = [(nm - _LINE_NM / 2, nm + _LINE_NM / 2)]
        of_unit = photon_rate(np.ones((1, 1, 1, 1)), line, pixel).item() * pixel.exposure_s
        per_photon = np.full((1, *shape, 1), 1 / of_unit)
        pde = float(np.median(detected_photons(per_photon, line, pixel)))
        if not pde > 0:
            raise ValueError(f"{sensor.name} detects nothing at {nm:g} nm; give --wavelength-nm")

        light_nm = max(low_nm, _LIGHT_NM[0]), min(high_nm, _LIGHT_NM[1])
        edges = np.linspace(*light_nm, 1 + math.ceil((light_nm[1] - light_nm[0]) / _BAND_NM))
        bands = np.column_stack((edges[:-1], edges[1:]))
        by_day = REFLECTANCE * white_radiance("daylight", bands)
        light = np.broadcast_to(by_day, (1, *shape, len(bands)))
        day = float(np.median(detected_photons(light, bands, pixel)))

        dark, left_out = _readings(pixel, np.zeros((1, 1)), line, shape).mean.item(), ""
        if math.isnan(dark) and isinstance(pixel, Sensor):
            pixel, left_out = without(pixel, "afterpulsing"), "afterpulsing"
            dark = _readings(pixel, np.zeros((1, 1)), line, shape).mean.item()
        photons, parts, is_full = _FEWEST_DETECTED / pde * _DECADE, list[Readings](), False
        while not is_full:
            part = _readings(pixel, photons[:, np.newaxis] / of_unit, line, shape)
            if not part.mean.max() < _MOST_READ:
                break
            parts.append(part)
            is_lit = any(part.snr.max() > 1 for part in parts)
            rise = part.mean - dark
            is_full = is_lit and bool(rise[-1] < _STILL_GROWS * rise[0])
            photons = 10 * photons
        if not parts:
            raise ValueError(f"{sensor.name}: its readings cannot be computed; simulate them")
        curve = Readings(*map(np.concatenate, zip(*parts, strict=True)))
        full = dark + FULL * (curve.mean.max() - dark)
        names = sorted(LEVELS, key=lambda name: -LEVELS[name].illuminance_lux)
        levels = {
            name: _readings(pixel, REFLECTANCE * white_radiance(name, bands)[None], bands, shape)
            for name in names
        }
        return DataSheet(
            sensor=sensor,
            preset=preset,
            left_out=left_out,
            stated=stated,
            wavelength_nm=nm,
            pde=pde,
            curve=curve,
            lux_per_photon=pde / day * LEVELS["daylight"].illuminance_lux,
            threshold_photons=_reached(curve.photons, curve.snr, 1.0),
            saturation_photons=_reached(curve.photons, curve.mean, full) if is_full else math.nan,
            dark_hz=_dark_hz(pixel, dark_shape, line),
            levels=levels,
            range_nm=light_nm,
        )


def _peak_nm(pixel: ImageSensor, low_nm: float, high_nm: float) -> float:
    """Wavelength of the largest efficiency; of several, the one closest to 550 nm."""
    curve = pixel.efficiency
    points_nm = np.array([*curve.wavelengths_nm, _USUAL_NM]).clip(low_nm, high_nm)
    best_nm = points_nm[np.isclose(curve(points_nm), curve(points_nm).max(), rtol=1e-6)]
    peak_nm = best_nm[np.argmin(np.abs(best_nm - _USUAL_NM))]
    return float(np.clip(peak_nm, low_nm + _LINE_NM / 2, high_nm - _LINE_NM / 2))


def _readings(
    pixel: ImageSensor, radiance: Floats, bands_nm: ArrayLike, shape: tuple[int, int]
) -> Readings:
    """Return readings at radiances (N, B); NaN where moments would be too slow to compute."""
    light = np.broadcast_to(radiance[:, None, None, :], (len(radiance), *shape, radiance.shape[1]))
    try:
        lit, brighter = (
            expectation(factor * light, bands_nm, pixel, frame_period_s=_AT_REST_S)
            for factor in (1.0, 1 + _BRIGHTER)
        )
    except UserError:
        return Readings(*np.full((4, len(radiance)), np.nan))
    of_pixels = (
        *(lit.photons, lit.mean_reading, np.sqrt(lit.reading_variance)),
        lit.signal_to_noise(brighter, _BRIGHTER),
    )
    return Readings(*(np.median(values, axis=(1, 2)) for values in of_pixels))


def _dark_hz(pixel: ImageSensor, shape: tuple[int, int], bands_nm: ArrayLike) -> Floats:
    if isinstance(pixel, Sensor):
        levels = draw_fixed_pattern(pixel, shape).dark_levels()
        return np.asarray(np.sum([chance * level_hz for chance, level_hz in levels], axis=0))
    dark = expectation(np.zeros((1, *shape, 1)), bands_nm, pixel, frame_period_s=_AT_REST_S)
    return np.asarray(dark.mean_events[0] / pixel.exposure_s)


def _reached(photons: Floats, values: Floats, level: float) -> float:
    """Least light at which values are at a level, between the points of a curve; NaN if never."""
    above = np.flatnonzero(values >= level)
    if not above.size or above[0] == 0:
        return math.nan
    around = slice(above[0] - 1, above[0] + 1)
    ends = np.log(np.maximum(values[around], 1e-9))
    return math.exp(np.interp(math.log(level), ends, np.log(photons[around])))
