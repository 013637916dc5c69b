"""Data sheet of a sensor as text, page and picture."""

import math
import re
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from megalopta.benchmark.data_sheet import FULL, HOT_TIMES, REFLECTANCE, DataSheet
from megalopta.core.errors import UserError
from megalopta.core.files import atomic_write
from megalopta.report import style
from megalopta.report.sections import Section, block, table, write_sections
from megalopta.report.text import UNDEFINED, number, percent, short, with_error
from megalopta.scenes.levels import LEVELS
from megalopta.sensor import Sensor

Row = tuple[str, ...]
LEVELS_HEAD = "light", "lux", "photons", "reading", "SNR", "ideal SNR"
_PNG_IN = 12.0, 9.0
_AROUND = 10.0
"""Factor of light that is drawn beyond threshold and saturation"""


def figures(sheet: DataSheet) -> tuple[Row, ...]:
    """Return rows of name, value, and where it is from if a device file tells."""
    sensor, curve = sheet.sensor, sheet.curve
    is_spad = isinstance(sensor, Sensor)
    area = f"{_of(sensor.pitch_m, 'm')} pitch, {percent(sensor.fill_factor)} fill factor"
    exposure = f"{_of(sensor.exposure_s, 's')}, at most {short(1 / sensor.exposure_s)} frames/s"
    pde = f"{percent(sheet.pde)} at {sheet.wavelength_nm:g} nm, of a whole pixel (PDE)"
    rows = [
        ("pixel", area, "pitch_m"),
        ("exposure", exposure, "exposure_s"),
        ("detection efficiency", pde, "efficiency"),
        ("dark counts" if is_spad else "dark electrons", _dark(sheet), "dark_counts"),
    ]
    if isinstance(sensor, Sensor):
        dead, carriers = sensor.dead_time, sensor.afterpulsing
        delay = "" if carriers.table_delays_s else f", after {_of(carriers.delay_s, 's')}"
        dead_text = f"{_of(dead.dead_time_s, 's')}, {dead.kind}"
        fired = f"{percent(sensor.crosstalk.mean_fired_neighbors)}: neighbors fired by an avalanche"
        carried = f"{percent(carriers.mean_carriers)}{delay}"
        counter = f"{sensor.counter.kind}, up to {number(sensor.counter.capacity)} counts"
        rows += [
            ("dead time", dead_text if dead.is_on else "none", "dead_time"),
            ("crosstalk", fired if sensor.crosstalk.is_on else "none", "crosstalk"),
            ("afterpulses", carried if carriers.is_on else "none", "afterpulsing"),
            ("counter", counter if sensor.counter.is_on else "without a limit", "counter"),
        ]
        others = [
            name
            for name in ("temperature", "bias", "telegraph", "gate", "jitter", "tcspc", "filters")
            if getattr(sensor, name).is_on
        ]
        rows += [("also simulated", ", ".join(others), others[0])] if others else []
    else:
        swing = f"{_of(sensor.swing_v, 'V')} on {_of(sensor.capacitance_f, 'F')}"
        rows.append(("well", f"{swing}, {number(curve.mean.max())} electrons", "swing_v"))
    is_within = ~(curve.photons > sheet.saturation_photons)
    best = int(np.argmax(np.where(is_within, curve.snr, 0)))
    ratio = sheet.saturation_photons / sheet.threshold_photons
    of_range = f"{sheet.dynamic_range_db:.0f} dB, a factor of {number(ratio)}"
    ideal = f" at {_light(sheet, curve.photons[best])}; ideal: {number(curve.photons[best] ** 0.5)}"
    rows += [
        ("SNR = 1 at", _light(sheet, sheet.threshold_photons), ""),
        (f"{percent(FULL)} saturated at", _light(sheet, sheet.saturation_photons), ""),
        ("dynamic range", of_range if math.isfinite(ratio) else UNDEFINED, ""),
        ("largest SNR", f"{number(curve.snr[best])}{ideal}", ""),
    ]
    if not sheet.stated:
        return tuple((name, text) for name, text, _ in rows)
    return tuple((name, text, _origin(sheet, field)) for name, text, field in rows)


def _of(value: float, unit: str) -> str:
    return re.sub(r"\.0+ ", " ", with_error(value, math.nan, unit))


def _light(sheet: DataSheet, photons: float) -> str:
    if not math.isfinite(photons):
        return "no light that can be computed"
    return f"{number(photons)} photons, or {number(photons * sheet.lux_per_photon)} lux"


def _dark(sheet: DataSheet) -> str:
    low, median, high = np.quantile(sheet.dark_hz, (0.05, 0.5, 0.95))
    if high == 0:
        return "none"
    if low == high:
        return f"{number(median)} per second in every pixel"
    return (
        f"{number(median)} per second (median; 90 % of pixels: {number(low)} to {number(high)}; "
        f"hot, above {HOT_TIMES:g} times: {percent(sheet.hot_share)})"
    )


def _origin(sheet: DataSheet, field: str) -> str:
    """Return where a field is from: measured maps, the device file, or the preset."""
    if not field:
        return "computed"
    if getattr(getattr(sheet.sensor, "measured", None), field, None):
        return "measured map"
    if field in sheet.stated:
        return "device file"
    return f"preset {sheet.preset}" if sheet.preset else "not stated"


def at_levels(sheet: DataSheet) -> tuple[Row, ...]:
    """Return a row per light level, as `LEVELS_HEAD`."""
    rows, most = [], sheet.curve.mean.max() if math.isfinite(sheet.saturation_photons) else np.inf
    for name, at in sheet.levels.items():
        photons, mean, sigma, snr = (values.item() for values in at)
        is_full = snr <= 0 or mean >= FULL * most
        reading = number(mean) + (f" ± {number(sigma)}" if sigma else "")
        shown = "saturated" if is_full else number(snr)
        ends = name.replace("_", " "), short(LEVELS[name].illuminance_lux), number(photons)
        rows.append((*ends, reading, shown, number(math.sqrt(photons))))
    return tuple(rows)


def notes(sheet: DataSheet) -> str:
    """Return what the figures hold for, in sentences."""
    low_nm, high_nm = sheet.range_nm
    lens, left_out = sheet.sensor.lens, sheet.left_out
    told = f" Readings leave out {left_out}, which would take too long." if left_out else ""
    return (
        f"Photons are those on a whole pixel in an exposure, of {sheet.wavelength_nm:g} nm; at "
        f"light levels, of {low_nm:g} to {high_nm:g} nm. Lux are those on a surface of "
        f"{percent(REFLECTANCE)} reflectance, seen through f/{lens.f_number:g} and "
        f"{percent(lens.transmission)} transmission; by daylight, where no level is named. SNR is "
        f"referred to the exposure; the ideal detector counts every photon on the pixel.{told}"
    )


def write_data_sheet(path: Path, sheet: DataSheet) -> Path:
    """Write the data sheet as a page (.html) or a picture (.png); return its path."""
    name = sheet.sensor.name
    if path.suffix.lower() == ".png":
        _write_png(path, sheet)
        return path
    if path.suffix.lower() != ".html":
        raise UserError(f"--out {path}: neither a page nor a picture; name it .html or .png")
    charts = [_svg(sheet, *chart) for chart in _charts(sheet)]
    low, high = (_light(sheet, x) for x in (sheet.threshold_photons, sheet.saturation_photons))
    of_range = (
        f", {sheet.dynamic_range_db:.0f} dB" if math.isfinite(sheet.saturation_photons) else ""
    )
    summary = f"It sees light from {low} (SNR = 1) to {high} ({percent(FULL)} saturated){of_range}."
    head = ("", "value", "from") if sheet.stated else ("", "value")
    values = block("words", table("Figures", head, figures(sheet)))
    sections = [
        Section("Figures", f"Source: {sheet.sensor.source or 'not stated'}.", body=values),
        Section("At light levels", notes(sheet), LEVELS_HEAD, at_levels(sheet)),
        Section("Curves", charts=tuple(charts)),
    ]
    return write_sections(path, f"Data sheet of {name}", summary, sections)


Draw = Callable[[Axes, DataSheet], None]


def _charts(sheet: DataSheet) -> list[tuple[Draw, str]]:
    charts: list[tuple[Draw, str]] = [
        (_draw_efficiency, "Detection efficiency over wavelength"),
        (_draw_readings, "Mean reading and its standard deviation over light"),
        (_draw_snr, "Signal-to-noise ratio over light, beside the ideal detector"),
    ]
    if np.ptp(sheet.dark_hz) > 0:
        charts.append((_draw_dark, "Share of pixels over dark counts"))
    return charts


@style.in_style
def _svg(sheet: DataSheet, draw: Draw, description: str) -> Markup:
    figure, axes = style.new_axes(*style.CHART_PT)
    draw(axes, sheet)
    return style.to_svg(figure, description, description)


@style.house_style({"axes.grid": False})
def _write_png(path: Path, sheet: DataSheet) -> None:
    figure = Figure(figsize=_PNG_IN, layout="constrained")
    charts = _charts(sheet)
    for axes, (draw, _) in zip(figure.subplots(2, 2).flat, charts, strict=False):
        draw(axes, sheet)
    for axes in figure.axes[len(charts) : 4]:
        axes.remove()
    figure.suptitle(f"{sheet.sensor.name}: {sheet.sensor.source}", wrap=True)
    with atomic_write(path) as temporary:
        figure.savefig(temporary, format="png", dpi=120, metadata={"Software": None})


def _draw_efficiency(axes: Axes, sheet: DataSheet) -> None:
    sensor = sheet.sensor
    ends = sensor.efficiency.wavelengths_nm[0], sensor.efficiency.wavelengths_nm[-1]
    grid_nm = np.linspace(*ends, 1001)
    pde = 100 * sensor.photon_detection_efficiency(grid_nm)
    axes.plot(grid_nm, pde, color=style.BLACK)
    for color, line in (("red", style.VERMILION), ("green", style.GREEN), ("blue", style.BLUE)):
        if (curve := getattr(sensor.filters, color)) is not None:
            axes.plot(grid_nm, pde * curve(grid_nm), color=line)
    axes.set(xlabel="wavelength (nm)", ylabel="PDE of a whole pixel (%)", ylim=(0, None))
    axes.grid(axis="y")


def _over_light(axes: Axes, sheet: DataSheet, label: str) -> None:
    """Make both axes logarithmic, with photons below and lux above, and mark both ends."""
    style.logarithmic(axes, "x", style.NUMBERS)
    style.logarithmic(axes, "y", style.NUMBERS)
    photons, ends = sheet.curve.photons, (sheet.threshold_photons, sheet.saturation_photons)
    axes.set_xlim(
        np.nanmax([ends[0] / _AROUND, photons[0]]), np.nanmin([ends[1] * _AROUND, photons[-1]])
    )
    for photons_at, text in zip(ends, ("SNR = 1", f"{percent(FULL)} full"), strict=True):
        if math.isfinite(photons_at):
            axes.axvline(photons_at, color=style.GRAY, linewidth=1, linestyle=":")
            axes.text(photons_at, 0.02, f" {text}", color=style.GRAY, fontsize=9,
                      transform=axes.get_xaxis_transform())  # fmt: skip
    axes.set(xlabel=f"photons on a pixel, {sheet.wavelength_nm:g} nm", ylabel=label)
    lux = sheet.lux_per_photon
    scales = partial(np.multiply, lux), partial(np.multiply, 1 / lux)
    above = axes.secondary_xaxis("top", functions=scales)
    above.xaxis.set_major_formatter(style.NUMBERS)
    above.set_xlabel("lux (daylight)")


def _draw_readings(axes: Axes, sheet: DataSheet) -> None:
    curve = sheet.curve
    floor = curve.mean.min() / 3
    low = np.maximum(curve.mean - curve.sigma, floor)
    axes.fill_between(
        curve.photons, low, curve.mean + curve.sigma, color=style.SKY, alpha=0.4, lw=0
    )
    axes.plot(curve.photons, curve.mean, color=style.BLUE)
    _over_light(axes, sheet, f"reading ± its σ ({sheet.sensor.unit})")
    axes.set_ylim(floor, None)


def _draw_snr(axes: Axes, sheet: DataSheet) -> None:
    curve = sheet.curve
    shown = np.where(curve.snr > 0, curve.snr, np.nan)
    axes.plot(curve.photons, np.sqrt(curve.photons), **style.line_style(6), label="ideal")
    axes.plot(curve.photons, shown, color=style.BLUE, label=sheet.sensor.name)
    axes.axhline(1, color=style.GRAY, linewidth=1, linestyle=":")
    _over_light(axes, sheet, "SNR")
    axes.set_ylim(0.1, None)
    axes.legend(frameon=False, loc="upper left")


def _draw_dark(axes: Axes, sheet: DataSheet) -> None:
    rates = np.sort(sheet.dark_hz.ravel())
    axes.plot(rates, 100 * (1 - np.arange(rates.size) / rates.size), color=style.BLUE)
    style.logarithmic(axes, "x", style.NUMBERS)
    style.logarithmic(axes, "y", style.NUMBERS)
    axes.set(xlabel="dark counts (per second)", ylabel="pixels with at least so many (%)")
