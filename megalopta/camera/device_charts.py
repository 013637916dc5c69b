"""Charts of the calibration and of the comparison page."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter, ScalarFormatter
from numpy.typing import NDArray

from megalopta.camera.comparison import SpeedResponse
from megalopta.core.arrays import Floats
from megalopta.plotting.style import BLACK, BLUE, GRAY, VERMILION, line_style
from megalopta.plotting.svg import in_style, new_axes, to_svg
from megalopta.sensor.calibrate.device import Device
from megalopta.sensor.calibrate.saturation import DeadTimeKind, dead_time_moments
from megalopta.sensor.compare.counted import CountedFrames
from megalopta.sensor.compare.recordings import Comparison
from megalopta.sensor.compare.spectrum import SEGMENT, mean_spectrum

Levels = Sequence[CountedFrames]

_SIZE_PT = 380, 270
_MAP, _BAR = (0.1, 0.13, 0.68, 0.78), (0.8, 0.17, 0.025, 0.7)
"""Left, bottom, width and height in the picture: to find them out takes as long as to draw it."""
_KINDS: tuple[DeadTimeKind, ...] = ("paralyzable", "nonparalyzable")
_FRAMES_SHOWN = 200
_MOST_POINTS = 2000
"""Pixels in a picture; of a large array, evenly chosen ones."""
_STYLES = (
    {"label": "captured", "color": BLUE, "marker": "o"},
    {"label": "simulated", "color": VERMILION, "marker": "x"},
)


@in_style
def map_chart(
    values: Floats,
    name: str,
    title: str,
    limits: tuple[float, float] | None = None,
    colors: str = "viridis",
) -> Markup:
    """Return a map of pixels (rows, columns) with its scale; gray where nothing is known."""
    figure = Figure(figsize=(_SIZE_PT[0] / 72, _SIZE_PT[1] / 72))
    axes, bar = figure.add_axes(_MAP), figure.add_axes(_BAR)
    low, high = limits or color_limits(values)
    shades = colormaps[colors].with_extremes(bad=GRAY)
    picture = axes.imshow(values, cmap=shades, vmin=low, vmax=high, interpolation="nearest")
    figure.colorbar(picture, cax=bar, format=ScalarFormatter(useOffset=False))
    axes.set(title=title, xlabel="column", ylabel="row")
    return to_svg(figure, name, f"Map of the {title}")


def color_limits(*maps: Floats) -> tuple[float, float]:
    """Return the ends of a scale that 98 % of the known pixels of maps are within."""
    known = np.concatenate([each[np.isfinite(each)] for each in maps])
    low, high = np.percentile(known, (1, 99)) if known.size else (0.0, 1.0)
    return float(low), float(high)


@in_style
def falls_chart(device: Device) -> Markup:
    """Return variance over mean fall, of all pixels at all levels, with the line of the step."""
    figure, axes = new_axes(*_SIZE_PT)
    used = device.falls.frames > 0
    dark = (device.counts.light_hz == 0)[:, None] & used
    mean, variance = 1e3 * device.falls.mean_v, 1e6 * device.falls.variance_v2
    for chosen, color, label in ((dark, BLACK, "dark"), (used & ~dark, BLUE, "light")):
        axes.plot(mean[chosen], variance[chosen], ".", color=color, markersize=2, label=label)
    ends = np.array([0.0, float(mean[used].max(initial=1.0))])
    step = 1e3 * float(np.nanmedian(device.step_v.value))
    axes.plot(ends, step * ends, color=VERMILION, linewidth=1.5, label=f"{step:.3g} mV per event")
    axes.set(xlabel="mean fall of the output (mV)", ylabel="variance (mV²)")
    description = "Photon transfer: variance of readings over their mean"
    return _finished(figure, "transfer", description, markerscale=3)


@in_style
def saturation_chart(device: Device) -> Markup:
    """Return counts over light at the median pixel, with the laws and the line without loss."""
    figure, axes = new_axes(*_SIZE_PT)
    assert device.efficiency is not None and device.dead_time_s is not None
    lit = device.counts.light_hz > 0
    light, exposure = device.counts.light_hz[lit], device.counts.exposure_s[lit]
    mean = np.where(device.falls.frames[lit] > 0, device.counts.mean[lit], np.nan)
    axes.plot(light, np.nanmedian(mean, axis=1) / exposure, "o", color=BLACK, label="measured")
    eta, tau = (np.nanmedian(each.value) for each in (device.efficiency, device.dead_time_s))
    grid = np.geomspace(light.min(), 1.5 * light.max(), 100)
    rate = np.nanmedian(device.dark_counts_hz.value) + eta * grid
    axes.plot(grid, rate, ":", color=BLACK, linewidth=1, label="without dead time")
    for place, kind in enumerate(_KINDS):
        law = dead_time_moments(rate, exposure.max(), np.full(rate.shape, tau), kind)[0]
        axes.plot(grid, law / exposure.max(), **line_style(place), label=kind)
    axes.set(xscale="log", yscale="log", xlabel="light (photons/s on a pixel)", ylabel="counts/s")
    axes.xaxis.set_minor_formatter(NullFormatter())
    return _finished(figure, "saturation", "Saturation curve: counts over light")


@in_style
def residual_chart(device: Device) -> Markup:
    """Return standardized residuals of mean counts at the levels of light."""
    figure, axes = new_axes(*_SIZE_PT)
    axes.hist(
        saturation_residuals(device).ravel(), bins=60, range=(-6, 6), density=True, color=BLUE
    )
    z = np.linspace(-6, 6, 200)
    axes.plot(z, np.exp(-(z**2) / 2) / np.sqrt(2 * np.pi), color=BLACK, linewidth=1.5)
    axes.set(xlabel="residual (standard errors)", ylabel="density")
    return to_svg(figure, "residuals", "Residuals of the saturation curve, beside a normal law")


def saturation_residuals(device: Device) -> Floats:
    """Return mean counts less those of the fit, in standard errors; NaN where nothing is fitted.

    Where the curve does not tell the kind of dead time, of the kind that leaves less.
    """
    kinds = [kind for kind in _KINDS if device.dead_time_kind in (None, kind)]
    left = [_residuals_of(device, kind) for kind in kinds]
    return min(left, key=lambda each: float(np.nansum(each**2)))


def _residuals_of(device: Device, kind: DeadTimeKind) -> Floats:
    assert device.efficiency is not None and device.dead_time_s is not None
    lit = (device.counts.light_hz > 0) & (device.counts.exposure_s > 0)
    eta, tau, dark = (
        each.value.ravel()
        for each in (device.efficiency, device.dead_time_s, device.dark_counts_hz)
    )
    rate = dark + eta * device.counts.light_hz[lit][:, None]
    mean, variance = dead_time_moments(rate, device.counts.exposure_s[lit][:, None], tau, kind)
    frames = np.where(device.counts.frames[lit] > 0, device.counts.frames[lit], np.nan)
    return np.asarray((device.counts.mean[lit] - mean) / np.sqrt(variance / frames))


@in_style
def transfer_chart(captured: Levels, simulated: Levels) -> Markup:
    """Return variance of pixels over their mean."""
    figure, axes = new_axes(*_SIZE_PT)
    for levels, style in _beside(captured, simulated):
        for place, level in enumerate(levels):
            shown = _thinned(level.counts.reshape(len(level.counts), -1).T)
            own = style | {"label": "" if place else style["label"]}
            axes.plot(shown.mean(axis=1), shown.var(axis=1), markersize=2.5, linewidth=0, **own)
    axes.set(xlabel="mean counts", ylabel="variance (counts²)", xscale="symlog", yscale="symlog")
    return _finished(figure, "transfer", "Photon transfer: variance over mean", markerscale=2)


@in_style
def dark_chart(captured: CountedFrames, simulated: CountedFrames) -> Markup:
    """Return dark counts of pixels in order."""
    figure, axes = new_axes(*_SIZE_PT)
    for level, style in _beside(captured, simulated):
        rates = level.counts.mean(axis=0) / level.exposure_s
        _draw_shares(axes, np.maximum(rates, 1e-3), style)
    axes.set(xscale="log", xlabel="dark counts (Hz)", ylabel="share of pixels below")
    return _finished(figure, "dark", "Distribution of dark counts over the pixels")


@in_style
def spectrum_chart(captured: CountedFrames, simulated: CountedFrames) -> Markup:
    """Return the temporal spectrum of the readings, mean over pixels."""
    figure, axes = new_axes(*_SIZE_PT)
    for level, style in _beside(captured, simulated):
        segments = len(level.counts) // SEGMENT
        pieces = np.asarray(level.counts[: segments * SEGMENT], np.float64)
        power = mean_spectrum(pieces.reshape(segments, SEGMENT, -1)).mean(axis=0)[1:]
        axes.plot(np.arange(1, power.size + 1) / SEGMENT, power, **_line(style))
    axes.set(xlabel="cycles per frame", ylabel="power (counts²)", ylim=(0, None))
    return _finished(figure, "spectrum", "Temporal spectrum of readings, captured and simulated")


@in_style
def distance_chart(found: Comparison) -> Markup:
    """Return energy distances of pixels in order, and those by chance."""
    figure, axes = new_axes(*_SIZE_PT)
    _draw_shares(axes, found.distances.energy, {"label": "captured and simulated", "color": BLUE})
    _draw_shares(axes, found.by_chance.energy, {"label": "by chance", "color": VERMILION})
    axes.set(xlabel="energy distance (counts$^{1/2}$)", ylabel="share of pixels below")
    axes.set_xlim(left=0)
    return _finished(figure, "distance", "Energy distances of histograms, over the pixels")


@in_style
def time_chart(captured: CountedFrames, simulated: CountedFrames) -> Markup:
    """Return mean counts of frames, one after the other."""
    figure, axes = new_axes(1.5 * _SIZE_PT[0], 0.8 * _SIZE_PT[1])
    for frames, style in _beside(captured, simulated):
        axes.plot(frames.counts[:_FRAMES_SHOWN].mean(axis=(1, 2)), **_line(style))
    axes.set(xlabel="frame", ylabel="mean counts")
    outside = {"loc": "lower right", "bbox_to_anchor": (1, 1), "ncols": 2}
    return _finished(figure, "time", "Mean counts of frames, captured and simulated", **outside)


@in_style
def response_chart(responses: Sequence[SpeedResponse], method: str) -> Markup:
    """Return a transfer function: peak response over speed, mean and standard deviation."""
    figure, axes = new_axes(*_SIZE_PT)
    own = [each for each in responses if each.name == method]
    speeds = [each.speed_mm_s for each in own]
    for values, style in _beside([each.captured for each in own], [each.simulated for each in own]):
        means, spreads = zip(*((each.mean(), each.std(ddof=1)) for each in values), strict=True)
        axes.errorbar(speeds, means, spreads, capsize=3, markersize=4, **style)
    axes.axhline(0, color=BLACK, linewidth=0.5)
    unit = own[0].difference.unit
    axes.set(xlabel="speed (mm/s)", ylabel=f"peak response ({unit})", title=method)
    return _finished(figure, f"response-{method}", f"Transfer function of {method}")


def _beside(captured: Any, simulated: Any) -> Iterator[tuple[Any, dict[str, Any]]]:
    """Yield both, each with its style."""
    return zip((captured, simulated), _STYLES, strict=True)


def _line(style: dict[str, Any]) -> dict[str, Any]:
    return style | {"marker": ""}


def _draw_shares(axes: Axes, values: Floats, style: dict[str, Any]) -> None:
    """Draw the share of values up to each of them."""
    shares = (np.arange(values.size) + 0.5) / values.size
    axes.plot(_thinned(np.sort(values, axis=None)), _thinned(shares), **_line(style))


def _thinned(values: NDArray[Any]) -> NDArray[Any]:
    return values[:: max(1, len(values) // _MOST_POINTS)]


def _finished(figure: Figure, name: str, description: str, **legend: Any) -> Markup:
    figure.axes[0].legend(frameon=False, **legend)
    return to_svg(figure, name, description)
