"""Data sheet of an image sensor: what a typical pixel reads over light, without drawing photons.

A typical pixel has the median moments (`expectation`) of the middle 16 × 16 pixels at most, on the
lens's axis and without color filters. SNR is referred to the exposure (EMVA 1288). Of a frame
camera, the sheet has its exact figures of EMVA 1288.

That of a contrast sensor has bandwidth, noise and noise events over light. These are drawn: of
16 × 16 pixels, with their own thresholds, in constant light.
"""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from operator import attrgetter
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from markupsafe import Markup
from pydantic_core import to_json

from megalopta.core import strict_yaml
from megalopta.core.arrays import Floats, first_reached
from megalopta.core.bounded import read_text
from megalopta.core.errors import UserError, refused_as
from megalopta.core.progress import step
from megalopta.core.quantities import number, percent, with_error
from megalopta.report import style
from megalopta.report.sections import Section, write_sections
from megalopta.scenes.levels import LEVELS
from megalopta.scenes.spectra.color import band_means
from megalopta.sensor import (
    ContrastSensor,
    ImageSensor,
    Sensor,
    changed,
    detected_photons,
    expectation,
    expose_events,
)
from megalopta.sensor.calibrate import emva as standard
from megalopta.sensor.frame.model import FrameSensor
from megalopta.sensor.image_sensors import IMAGE_SENSORS, is_device_file, sensor_named
from megalopta.sensor.optics import photon_rate
from megalopta.sensor.spad.device import draw_fixed_pattern

_REFLECTANCE, _BRIGHTER, _AT_REST_S = 0.18, 0.01, 1e-9
_QUANTILES = 0.05, 0.5, 0.95
_SIDE, _WATCHED_S = 16, 2.0
_HEAD = "photons", "lux", "reading", "SNR", "ideal SNR"
_EMVA = (
    "Release 4, Linear: exact figures of 64 × 64 pixels at {:g} nm. K, η, σ_d and µ_e.sat are "
    "without the excess noise F² of a register, with which photon transfer gives K·F²."
)
_NOTE = (
    "Photons of {sheet.wavelength_nm:g} nm on a whole pixel in an exposure; lux of daylight on a "
    "surface of 18 % reflectance, through f/{lens.f_number:g} and a transmission of "
    "{lens.transmission:g}. The ideal detector counts every photon."
)
_NOISE_EVENTS = (
    "Lux of daylight on a surface of 18 % reflectance. ON and OFF events per second and pixel in "
    "constant light, in 2 s after as many, and the standard error over pixels."
)


@dataclass(frozen=True, eq=False, kw_only=True)
class DataSheet:
    """Figures of a sensor; NaN: never, or too slow to compute.

    `curve`: mean and standard deviation of the reading (counts or electrons) and SNR over photons
    of `wavelength_nm` on a whole pixel in an exposure, where `pde` is its efficiency. Daylight of
    `lux_per_photon` is detected as often. The SNR is 1 at `threshold_photons`, the mean reading at
    90 % of its range at `saturation_photons`. `dark_hz` (rows, columns): dark counts or electrons;
    `hot_share` of pixels have over ten times their median. `origins`: where fields are from.
    `emva`: figures of EMVA 1288, of frame cameras.
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
    emva: standard.Emva | None

    def to_json(self) -> str:
        """Return all figures; NaN is null. Of `dark_hz` the quantiles 5, 50 and 95 %."""
        quantiles = {"dark_hz": np.quantile(self.dark_hz, _QUANTILES).tolist()}
        plain = vars(self) | quantiles | {"curve": self.curve.to_dict("list")}
        plain["emva"] = self.emva and {
            name: attrgetter(name)(self.emva) for _, _, name, _ in standard.FIGURES
        }
        return to_json(plain, indent=1, inf_nan_mode="null").decode()


class ContrastSheet(NamedTuple):
    """A contrast sensor, and its figures over light: a row per half decade."""

    sensor: ContrastSensor
    curve: pd.DataFrame

    def to_json(self) -> str:
        """Return all figures."""
        return to_json({"sensor": self.sensor, "curve": self.curve.to_dict("list")}).decode()


@step("reading over light")
def data_sheet(sensor: ImageSensor | str | Path, wavelength_nm: float | None = None) -> DataSheet:
    """Return the data sheet of a sensor, of a preset's name, or of a device's YAML file.

    `wavelength_nm`: of the photons; default: 550 nm if the efficiency is largest there, else where
    it is. Raises UserError if the sensor is unknown or damaged, or sees nothing there.

    Examples
    --------
    >>> round(data_sheet("spad512-squared").pde, 2)
    0.25
    """
    with refused_as("sensor"):
        named, stated = sensor_named(sensor), {"preset": sensor if isinstance(sensor, str) else ""}
        if is_device_file(sensor):
            stated = strict_yaml.load(read_text(Path(str(sensor))))
        if isinstance(named, ContrastSensor):
            raise ValueError(f"{named.name}: events of contrast have no wavelength; omit it")
        base = stated.get("preset")
        of_preset = IMAGE_SENSORS.get(base or "", named)
        known = f"preset {base}" if base else "not stated"
        if of_preset.assumed:  # then what it states besides is as its source has it
            base, known = "", "published"
        origins = {
            **dict.fromkeys(type(named).model_fields, known if base else "not stated"),
            **dict.fromkeys(of_preset.model_fields_set, known),
            **{
                path.split(".")[0]: "partly assumed" if "." in path else "assumed"
                for path in (text.partition(":")[0] for text in named.assumed)
            },
            **dict.fromkeys(stated, "device file"),
            **dict.fromkeys(stated.get("measured", ()), "measured map"),
        }
        filters = dict.fromkeys(("red", "green", "blue", "white")) | {"mosaic": ()}
        pixel = changed(named, lens={"falloff_fov_deg": None, "blur_m": 0.0}, filters=filters)
        sides = (128, 128)
        if isinstance(pixel, Sensor) and pixel.measured.is_on:
            pixel, sides = changed(pixel, measured={"fit": "center"}), pixel.measured.shape
        shape = min(sides[0], 16), min(sides[1], 16)

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
            if columns[3].max() > 0.5 and signal[-1] < 1.02 * signal[1]:
                full = dark + 0.9 * (columns[1].max() - dark)
        if not columns.size:
            raise ValueError(f"{named.name}: its readings take too long; leave out afterpulsing")
        photons, mean, _, snr = columns
        threshold, saturation = (
            first_reached(photons, 1 / np.maximum(values, 1e-9), 1 / level) or math.nan
            for values, level in ((snr, 1.0), (mean, full))
        )

        if isinstance(pixel, Sensor):
            states = draw_fixed_pattern(pixel, sides).dark_levels()
            dark_hz = np.asarray(sum(chance * state_hz for chance, state_hz in states))
        else:
            unlit = expectation(np.zeros((1, *sides, 1)), line, pixel, 0, _AT_REST_S)
            dark_hz = np.asarray(unlit.mean_events[0] / pixel.exposure_s)
        return DataSheet(
            sensor=named,
            origins=origins,
            wavelength_nm=nm,
            pde=pde,
            curve=pd.DataFrame(columns.T, columns=["photons", "mean", "sigma", "snr"]),
            lux_per_photon=pde / (daylight_hz(pixel, shape) * pixel.exposure_s),
            threshold_photons=threshold,
            saturation_photons=saturation,
            dynamic_range_db=20 * math.log10(saturation / threshold),
            dark_hz=dark_hz,
            hot_share=float(np.mean(dark_hz > 10 * np.median(dark_hz))),
            emva=standard.device_emva(pixel, sides, nm) if isinstance(pixel, FrameSensor) else None,
        )


@step("noise events over light")
def contrast_sheet(sensor: ContrastSensor) -> ContrastSheet:
    """Return the data sheet of a contrast sensor."""
    watched, rows = changed(sensor, exposure_s=_WATCHED_S), []
    for lux in 10.0 ** np.arange(-3, 4.1, 0.5):
        hz = daylight_hz(sensor) * lux
        noisy = expose_events(np.full((2, _SIDE, _SIDE), hz), watched, seed=0, stream="sheet")
        of_pixels = np.bincount(noisy.pixel[noisy.frame == 1], minlength=_SIDE**2) / _WATCHED_S
        rate_hz = np.array(hz + sensor.dark_e_s)
        bandwidth_hz = 1 / (2 * np.pi * sensor.time_constant_s(rate_hz))
        sigma, error = sensor.noise_variance(rate_hz) ** 0.5, of_pixels.std() / _SIDE
        rows.append((lux, float(rate_hz), bandwidth_hz, sigma, of_pixels.mean(), error))
    head = ["lux", "electrons/s", "bandwidth (Hz)", "noise of ln λ", "events/s", "error"]
    return ContrastSheet(sensor, pd.DataFrame(rows, columns=head))


def daylight_hz(sensor: ImageSensor, shape: tuple[int, int] = (1, 1)) -> float:
    """Photons per second that a typical pixel detects in daylight of 1 lux on gray surfaces."""
    daylight, curves = LEVELS["daylight"], [sensor.efficiency, *sensor.lens.curves]
    ranges_nm = [(curve.wavelengths_nm[0], curve.wavelengths_nm[-1]) for curve in curves]
    lows_nm, highs_nm = zip(*ranges_nm, daylight.spectrum().range_nm, strict=True)
    bands = list(pairwise(np.linspace(max(lows_nm), min(highs_nm), 60)))
    radiance = _REFLECTANCE / math.pi * band_means([daylight.spectrum()], bands)[0]
    photons = detected_photons(np.ones((1, *shape, 1)) * radiance, bands, sensor)
    return float(np.median(photons)) / sensor.exposure_s / daylight.illuminance_lux


def figures(sheet: DataSheet) -> list[tuple[str, str, str]]:
    """Return rows of name, value, and where it is from."""
    sensor = sheet.sensor
    low, median, high = map(number, np.quantile(sheet.dark_hz, _QUANTILES))
    hot = f"{percent(sheet.hot_share)} over 10 times that"
    pde = f"{percent(sheet.pde)} at {sheet.wavelength_nm:g} nm, of a whole pixel (PDE)"
    rows = [
        ("pixel pitch", with_error(sensor.pitch_m, 0, "m"), "pitch_m"),
        ("fill factor", percent(sensor.fill_factor), "fill_factor"),
        ("exposure", with_error(sensor.exposure_s, 0, "s"), "exposure_s"),
        ("detection efficiency", pde, "efficiency"),
        ("dark counts", f"{median} per second (90 %: {low} to {high}; {hot})", "dark_counts"),
    ]
    if isinstance(sensor, FrameSensor):
        register, read, adc = sensor.em, sensor.read, sensor.adc
        rows[-1] = ("dark electrons", rows[-1][1], "dark")
        if register.gain > 1:
            rows.append(("multiplication", f"{number(register.gain)} times", "em"))
        rows += [
            ("full well", f"{number(sensor.full_well_e)} electrons", "full_well_e"),
            ("read noise", f"{number(read.median_e / register.gain)} electrons (median)", "read"),
            ("gain", f"{number(1 / adc.e_per_dn)} DN per electron, {adc.bits} bits", "adc"),
        ]
    if isinstance(sensor, Sensor):
        dead, counter = sensor.dead_time, sensor.counter
        of_sums = f", sums of {counter.sums} exposures" if counter.sums > 1 else ""
        for field, text in (
            ("dead_time", f"{with_error(dead.dead_time_s, 0, 's')}, {dead.kind}"),
            ("crosstalk", f"{percent(sensor.crosstalk.mean_fired_neighbors)} per avalanche"),
            ("afterpulsing", percent(sensor.afterpulsing.mean_carriers)),
            ("counter", f"{counter.kind}, up to {sensor.largest} counts{of_sums}"),
        ):
            shown = text if getattr(sensor, field).is_on else "none"
            rows.append((field.replace("_", " "), shown, field))
    for part, field, name in (
        (sensor, "lag_share", "image lag"),
        (sensor, "residue_share", "left by a reset"),
        (getattr(sensor, "counter", None), "residue_share", "left by a reset"),
    ):
        if share := getattr(part, field, 0.0):
            rows.append((name, f"{percent(share)} of the frame before", field))
    limits = sheet.threshold_photons, sheet.saturation_photons
    for name, photons in zip(("SNR = 1 at", "90 % saturated at"), limits, strict=True):
        light = f"{number(photons)} photons, or {number(photons * sheet.lux_per_photon)} lux"
        rows.append((name, "not reached" if math.isnan(photons) else light, ""))
    rows.append(("dynamic range", f"{number(sheet.dynamic_range_db)} dB", ""))
    return [(name, text, sheet.origins.get(field, "computed")) for name, text, field in rows]


def sections(sheet: DataSheet | ContrastSheet) -> list[Section]:
    """Return the parts of a data sheet but its charts."""
    if isinstance(sheet, ContrastSheet):
        rows = [tuple(map(number, row)) for row in sheet.curve.itertuples(index=False)]
        fields = type(sheet.sensor).model_fields
        values = tuple(
            (name, number(value), str(fields[name].description).partition(". ")[0])
            for name, value in sheet.sensor
            if isinstance(value, float)
        )
        return [
            Section("Figures", "", ("field", "value", ""), values, True),
            Section("Over light", _NOISE_EVENTS, tuple(map(str, sheet.curve)), tuple(rows)),
        ]
    note = _NOTE.format(sheet=sheet, lens=sheet.sensor.lens)
    parts = [Section("Figures", note, ("", "value", "from"), tuple(figures(sheet)), True)]
    reasons = tuple(
        path.partition(": ")[::2]
        for path in sheet.sensor.assumed  # except of what a device file states
        if "assumed" in sheet.origins[re.split("[.:]", path)[0]]
    )
    if reasons:
        parts.append(Section("Assumed", "", ("field", "reason"), reasons, True))
    rows = []
    for photons, mean, sigma, snr in sheet.curve[::5].itertuples(index=False):  # two a decade
        lux, reading = photons * sheet.lux_per_photon, f"{number(mean)} ± {number(sigma)}"
        rows.append((number(photons), number(lux), reading, number(snr), number(photons**0.5)))
    parts.append(Section("Over light", "", _HEAD, tuple(rows)))
    if sheet.emva:
        text, head = _EMVA.format(sheet.wavelength_nm), ("symbol", "quantity", "value")
        parts.append(Section("EMVA 1288", text, head, standard.rows(sheet.emva)))
    return parts


@style.in_style
def write_page(path: Path, sheet: DataSheet | ContrastSheet) -> Path:
    """Write the data sheet as a page; return its path."""
    if isinstance(sheet, DataSheet):
        charts = _charts(sheet)
    else:
        figure, axes = style.new_axes(*style.CHART_PT)
        shown = sheet.curve[sheet.curve["events/s"] > 0]
        axes.errorbar(shown["lux"], shown["events/s"], shown["error"], color=style.BLACK)
        style.logarithmic(axes, "x", style.NUMBERS)
        style.logarithmic(axes, "y", style.NUMBERS)
        axes.set(xlabel="lux (daylight)", ylabel="noise events per second and pixel")
        charts = [style.to_svg(figure, "noise", "Noise events over light")]
    parts = [*sections(sheet), Section("Curves", charts=tuple(charts))]
    return write_sections(path, f"Data sheet of {sheet.sensor.name}", sheet.sensor.source, parts)


def _charts(sheet: DataSheet) -> list[Markup]:
    sensor, curve, lux, charts = sheet.sensor, sheet.curve, sheet.lux_per_photon, list[Markup]()
    figure, axes = style.new_axes(*style.CHART_PT)
    nm = np.array(sensor.efficiency.wavelengths_nm)
    pde = 100 * sensor.photon_detection_efficiency(nm)
    at_peak = sensor.photon_detection_efficiency(np.array(sheet.wavelength_nm))
    pde *= sheet.pde / at_peak  # of the typical pixel, by its map and bias
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
            # further on, readings lock to whole dead times, between which scatter rises again
            shown = values.where((values > 0) & ~(curve["photons"] > 10 * sheet.saturation_photons))
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
    return charts
