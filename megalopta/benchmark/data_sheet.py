"""Data sheet of an image sensor: what a typical pixel reads over light, without drawing photons.

A typical pixel has the median moments (`expectation`) of the middle 16 × 16 pixels at most, on the
lens's axis and without color filters. SNR is referred to the exposure (EMVA 1288).
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
from markupsafe import Markup
from pydantic_core import to_json

from megalopta.core import strict_yaml
from megalopta.core.arrays import Floats
from megalopta.core.bounded import read_text
from megalopta.core.errors import UserError, refused_as
from megalopta.core.progress import step
from megalopta.core.quantities import number, percent, with_error
from megalopta.report import style
from megalopta.report.sections import Section, block, table, write_sections
from megalopta.scenes.levels import LEVELS
from megalopta.scenes.spectra.color import band_means
from megalopta.sensor import ImageSensor, Sensor, changed, detected_photons, expectation
from megalopta.sensor.image_sensors import sensor_named
from megalopta.sensor.optics import photon_rate
from megalopta.sensor.spad.device import draw_fixed_pattern

_REFLECTANCE, _BRIGHTER, _AT_REST_S = 0.18, 0.01, 1e-9
_QUANTILES = 0.05, 0.5, 0.95
_HEAD = "photons", "lux", "reading", "SNR", "ideal SNR"
_NOTE = (
    "Photons of {sheet.wavelength_nm:g} nm on a whole pixel in an exposure; lux of daylight on a "
    "surface of 18 % reflectance, through f/{lens.f_number:g} and a transmission of "
    "{lens.transmission:g}. The ideal detector counts every photon."
)


@dataclass(frozen=True, eq=False, kw_only=True)
class DataSheet:
    """Figures of a sensor; NaN: never, or too slow to compute.

    `curve`: mean and standard deviation of the reading (counts or electrons) and SNR over photons
    of `wavelength_nm` on a whole pixel in an exposure, where `pde` is its efficiency. Daylight of
    `lux_per_photon` is detected as often. The SNR is 1 at `threshold_photons`, the mean reading at
    90 % of its range at `saturation_photons`. `dark_hz` (rows, columns): dark counts or electrons;
    `hot_share` of pixels have over ten times their median. `origins`: where fields are from.
    """

    sensor: ImageSensor
    origins: Mapping[str, str]
    wavelength_nm: float
    pde: float
    curve: pd.DataFrame
    lux_per_photon: float
    threshold_photons: float
    saturation_photons: float
    dynamic_range_db: float
    dark_hz: Floats
    hot_share: float

    def to_json(self) -> str:
        """Return all figures; NaN is null. Of `dark_hz` the quantiles 5, 50 and 95 %."""
        quantiles = {"dark_hz": np.quantile(self.dark_hz, _QUANTILES).tolist()}
        plain = vars(self) | quantiles | {"curve": self.curve.to_dict("list")}
        return to_json(plain, indent=1, inf_nan_mode="null").decode()


@step("reading over light")
def data_sheet(sensor: ImageSensor | str | Path, wavelength_nm: float | None = None) -> DataSheet:
    """Return the data sheet of a sensor, of a preset's name, or of a device's YAML file.

    `wavelength_nm`: of the photons; default: 550 nm if the efficiency is largest there, else where
    it is. Raises UserError if the sensor is unknown or damaged, or sees nothing there.
    """
    with refused_as("sensor"):
        named, stated = sensor_named(sensor), {"preset": sensor if isinstance(sensor, str) else ""}
        if str(sensor).endswith((".yaml", ".yml")):
            stated = strict_yaml.load(read_text(Path(str(sensor))))
        base = stated.get("preset")
        origins = {
            **dict.fromkeys(type(named).model_fields, f"preset {base}" if base else "not stated"),
            **dict.fromkeys(stated, "device file"),
            **dict.fromkeys(stated.get("measured", ()), "measured map"),
        }
        filters = dict.fromkeys(("red", "green", "blue", "white")) | {"mosaic": ()}
        pixel = changed(named, lens={"falloff_fov_deg": None, "blur_m": 0.0}, filters=filters)
        whole = (128, 128)
        if isinstance(pixel, Sensor) and pixel.measured.is_on:
            pixel, whole = changed(pixel, measured={"fit": "center"}), pixel.measured.shape
        shape = min(whole[0], 16), min(whole[1], 16)

        curves = [pixel.efficiency, *pixel.lens.curves]
        low_nm = max(curve.wavelengths_nm[0] for curve in curves)
        high_nm = min(curve.wavelengths_nm[-1] for curve in curves)
        if (nm := wavelength_nm) is None:
            usual = np.clip([550, *pixel.efficiency.wavelengths_nm], low_nm + 0.5, high_nm - 0.5)
            nm = float(usual[np.argmax(pixel.efficiency(usual).round(6))])
        line = [(nm - 0.5, nm + 0.5)]
        per_radiance = photon_rate(np.ones((1, 1, 1, 1)), line, pixel).item() * pixel.exposure_s
        photon = np.full((1, *shape, 1), 1 / per_radiance)
        if not (pde := float(np.median(detected_photons(photon, line, pixel)))) > 0:
            raise ValueError(f"{named.name} detects nothing at {nm:g} nm; give --wavelength-nm")

        columns, full = np.empty((4, 0)), math.inf
        decade = 10.0 ** (math.floor(-1 - math.log10(pde)) + np.arange(10) / 10)
        while full == math.inf:  # until a decade of light adds 2 % of the signal, or takes too long
            light = np.append(0, decade)[:, None, None, None] * photon
            try:
                lit, brighter = (
                    expectation(factor * light, line, pixel, frame_period_s=_AT_REST_S)
                    for factor in (1.0, 1 + _BRIGHTER)
                )
            except UserError:
                break
            sigma, snr = np.sqrt(lit.reading_variance), lit.signal_to_noise(brighter, _BRIGHTER)
            read = np.median([lit.photons, lit.mean_reading, sigma, snr], axis=(2, 3))
            if read[1].max() > 1e9:
                break
            columns, decade = np.hstack((columns, read[:, 1:])), 10 * decade
            signal, dark = read[1] - read[1, 0], read[1, 0]
            if columns[3].max() > 1 and signal[-1] < 1.02 * signal[1]:
                full = dark + 0.9 * (columns[1].max() - dark)
        if not columns.size:
            raise ValueError(f"{named.name}: its readings take too long; leave out afterpulsing")
        photons, mean, _, snr = columns
        threshold, saturation = _reached(photons, snr, 1.0), _reached(photons, mean, full)

        daylight = LEVELS["daylight"]
        known_nm = daylight.spectrum().range_nm
        ends_nm = max(low_nm, known_nm[0]), min(high_nm, known_nm[1])
        bands = list(pairwise(np.linspace(*ends_nm, 60)))
        radiance = _REFLECTANCE / math.pi * band_means([daylight.spectrum()], bands)[0]
        by_day = detected_photons(np.ones((1, *shape, 1)) * radiance, bands, pixel)
        if isinstance(pixel, Sensor):
            states = draw_fixed_pattern(pixel, whole).dark_levels()
            dark_hz = np.asarray(sum(chance * state_hz for chance, state_hz in states))
        else:
            unlit = expectation(np.zeros((1, *whole, 1)), line, pixel, 0, _AT_REST_S)
            dark_hz = np.asarray(unlit.mean_events[0] / pixel.exposure_s)
        return DataSheet(
            sensor=named,
            origins=origins,
            wavelength_nm=nm,
            pde=pde,
            curve=pd.DataFrame(columns.T, columns=["photons", "mean", "sigma", "snr"]),
            lux_per_photon=pde / float(np.median(by_day)) * daylight.illuminance_lux,
            threshold_photons=threshold,
            saturation_photons=saturation,
            dynamic_range_db=20 * math.log10(saturation / threshold),
            dark_hz=dark_hz,
            hot_share=float(np.mean(dark_hz > 10 * np.median(dark_hz))),
        )


def _reached(photons: Floats, values: Floats, level: float) -> float:
    """Least light at which values are at a level, between the points of a curve; NaN if never."""
    rising = slice(int(np.argmax(values)) + 1)
    logs = np.log(np.maximum(values[rising], 1e-9)), np.log(photons[rising])
    return math.exp(np.interp(math.log(level), *logs, left=math.nan, right=math.nan))


def figures(sheet: DataSheet) -> list[tuple[str, str, str]]:
    """Return rows of name, value, and where it is from."""
    sensor = sheet.sensor
    low, median, high = map(number, np.quantile(sheet.dark_hz, _QUANTILES))
    hot = f"{percent(sheet.hot_share)} over 10 times that"
    pixel = f"{with_error(sensor.pitch_m, 0, 'm')} pitch, {percent(sensor.fill_factor)} fill factor"
    pde = f"{percent(sheet.pde)} at {sheet.wavelength_nm:g} nm, of a whole pixel (PDE)"
    rows = [
        ("pixel", pixel, "pitch_m"),
        ("exposure", with_error(sensor.exposure_s, 0, "s"), "exposure_s"),
        ("detection efficiency", pde, "efficiency"),
        ("dark counts", f"{median} per second (90 %: {low} to {high}; {hot})", "dark_counts"),
    ]
    if isinstance(sensor, Sensor):
        dead, counter = sensor.dead_time, sensor.counter
        for field, text in (
            ("dead_time", f"{with_error(dead.dead_time_s, 0, 's')}, {dead.kind}"),
            ("crosstalk", f"{percent(sensor.crosstalk.mean_fired_neighbors)} per avalanche"),
            ("afterpulsing", percent(sensor.afterpulsing.mean_carriers)),
            ("counter", f"{counter.kind}, up to {number(counter.capacity)} counts"),
        ):
            shown = text if getattr(sensor, field).is_on else "none"
            rows.append((field.replace("_", " "), shown, field))
    limits = sheet.threshold_photons, sheet.saturation_photons
    for name, photons in zip(("SNR = 1 at", "90 % saturated at"), limits, strict=True):
        light = f"{number(photons)} photons, or {number(photons * sheet.lux_per_photon)} lux"
        rows.append((name, "not reached" if math.isnan(photons) else light, ""))
    rows.append(("dynamic range", f"{number(sheet.dynamic_range_db)} dB", ""))
    return [(name, text, sheet.origins.get(field, "computed")) for name, text, field in rows]


def over_light(sheet: DataSheet) -> list[tuple[str, ...]]:
    """Return two rows per decade of light, as `_HEAD`."""
    rows: list[tuple[str, ...]] = []
    for photons, mean, sigma, snr in sheet.curve[::5].itertuples(index=False):
        lux, reading = photons * sheet.lux_per_photon, f"{number(mean)} ± {number(sigma)}"
        rows.append((number(photons), number(lux), reading, number(snr), number(photons**0.5)))
    return rows


def text_of(sheet: DataSheet) -> str:
    """Return the data sheet as lines of text."""
    lines = [f"{sheet.sensor.name}: {sheet.sensor.source or 'source not stated'}", ""]
    lines += [f"{name:<22}{origin:<22}{text}" for name, text, origin in figures(sheet)]
    form = "{:>9}{:>12}{:>18}{:>12}{:>12}"
    rows = [form.format(*row) for row in (_HEAD, *over_light(sheet))]
    return "\n".join([*lines, "", *rows, "", _NOTE.format(sheet=sheet, lens=sheet.sensor.lens)])


@style.in_style
def write_page(path: Path, sheet: DataSheet) -> Path:
    """Write the data sheet as a page; return its path."""
    sensor, curve, lux, charts = sheet.sensor, sheet.curve, sheet.lux_per_photon, list[Markup]()
    figure, axes = style.new_axes(*style.CHART_PT)
    nm = np.array(sensor.efficiency.wavelengths_nm)
    pde = 100 * sensor.photon_detection_efficiency(nm)
    axes.plot(nm, pde, color=style.BLACK)
    for color, ink in (("red", style.VERMILION), ("green", style.GREEN), ("blue", style.BLUE)):
        if (passing := getattr(sensor.filters, color)) is not None:
            axes.plot(nm, pde * passing(nm), color=ink)
    axes.set(xlabel="wavelength (nm)", ylabel="PDE of a whole pixel (%)", ylim=(0, None))
    charts.append(style.to_svg(figure, "efficiency", "Detection efficiency over wavelength"))
    scales = partial(np.multiply, lux), partial(np.multiply, 1 / lux)
    for label, lines in (
        (f"reading ({sensor.unit})", {"mean": curve["mean"], "standard deviation": curve["sigma"]}),
        ("SNR", {sensor.name: curve["snr"], "ideal": curve["photons"] ** 0.5}),
    ):
        figure, axes = style.new_axes(*style.CHART_PT)
        for place, (name, values) in enumerate(lines.items()):
            shown = values.where(values > 0)
            axes.plot(curve["photons"], shown, label=name, **style.line_style(place))
        for photons in filter(math.isfinite, (sheet.threshold_photons, sheet.saturation_photons)):
            axes.axvline(photons, color=style.GRAY, linewidth=1, linestyle=":")
        style.logarithmic(axes, "x", style.NUMBERS)
        style.logarithmic(axes, "y", style.NUMBERS)
        axes.set(xlabel=f"photons on a pixel, {sheet.wavelength_nm:g} nm", ylabel=label)
        above = axes.secondary_xaxis("top", functions=scales)
        above.xaxis.set_major_formatter(style.NUMBERS)
        above.set_xlabel("lux (daylight)")
        about = f"{label} over light; dotted: SNR = 1 and 90 % saturated"
        charts.append(style.with_legend(figure, label, about))
    if np.ptp(sheet.dark_hz) > 0:
        charts.append(style.map_chart(sheet.dark_hz, "dark", "dark counts (per second)"))
    body = block("words", table("Figures", ("", "value", "from"), figures(sheet)))
    sections = (
        Section("Figures", _NOTE.format(sheet=sheet, lens=sensor.lens), body=body),
        Section("Curves", charts=tuple(charts)),
        Section("Over light", "", _HEAD, tuple(over_light(sheet))),
    )
    return write_sections(path, f"Data sheet of {sensor.name}", sensor.source, sections)
