"""Pictures of the calibration report."""

import numpy as np
from markupsafe import Markup
from matplotlib import colormaps
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter, ScalarFormatter

from megalopta.core.arrays import Floats
from megalopta.plotting.style import (
    BLACK,
    BLUE,
    GRAY,
    VERMILION,
    line_style,
)
from megalopta.plotting.svg import in_style, new_axes, to_svg
from megalopta.sensor.calibrate.device import Device
from megalopta.sensor.calibrate.saturation import DeadTimeKind, dead_time_moments

_WIDTH_PT, _HEIGHT_PT = 380, 270
_MAP, _BAR = (0.1, 0.13, 0.68, 0.78), (0.8, 0.17, 0.025, 0.7)
"""Left, bottom, width and height in the picture: to find them out takes as long as to draw it."""
_KINDS: tuple[DeadTimeKind, ...] = ("paralyzable", "nonparalyzable")


@in_style
def map_chart(
    values: Floats,
    name: str,
    title: str,
    limits: tuple[float, float] | None = None,
    colors: str = "viridis",
) -> Markup:
    """A map of pixels (rows, columns) with its scale; gray where nothing is known."""
    figure = Figure(figsize=(_WIDTH_PT / 72, _HEIGHT_PT / 72))
    axes, bar = figure.add_axes(_MAP), figure.add_axes(_BAR)
    low, high = limits or color_limits(values)
    shades = colormaps[colors].with_extremes(bad=GRAY)
    picture = axes.imshow(values, cmap=shades, vmin=low, vmax=high, interpolation="nearest")
    figure.colorbar(picture, cax=bar, format=ScalarFormatter(useOffset=False))
    axes.set(title=title, xlabel="column", ylabel="row")
    return to_svg(figure, name, f"Map of the {title}")


def color_limits(*maps: Floats) -> tuple[float, float]:
    """Ends of a scale for maps (rows, columns), which 98 % of their known pixels are within."""
    known = np.concatenate([each[np.isfinite(each)] for each in maps])
    low, high = np.percentile(known, (1, 99)) if known.size else (0.0, 1.0)
    return float(low), float(high)


@in_style
def photon_transfer_chart(device: Device, name: str) -> Markup:
    """Variance over mean fall, of all pixels at all levels, with the line of the median step."""
    figure, axes = new_axes(_WIDTH_PT, _HEIGHT_PT)
    used = device.falls.frames > 0
    dark = (device.counts.light_hz == 0)[:, None] & used
    mean, variance = 1e3 * device.falls.mean_v, 1e6 * device.falls.variance_v2
    for chosen, color, label in ((dark, BLACK, "dark"), (used & ~dark, BLUE, "light")):
        axes.plot(mean[chosen], variance[chosen], ".", color=color, markersize=2, label=label)
    ends = np.array([0.0, float(mean[used].max(initial=1.0))])
    step = 1e3 * float(np.nanmedian(device.step_v.value))
    axes.plot(ends, step * ends, color=VERMILION, linewidth=1.5, label=f"{step:.3g} mV per event")
    axes.set(xlabel="mean fall of the output (mV)", ylabel="variance (mV²)")
    axes.legend(frameon=False, markerscale=3)
    return to_svg(figure, name, "Photon transfer: variance of readings over their mean")


@in_style
def saturation_chart(device: Device, name: str) -> Markup:
    """Counted over light at the median pixel, with the fitted law and the line without loss."""
    figure, axes = new_axes(_WIDTH_PT, _HEIGHT_PT)
    assert device.efficiency is not None and device.dead_time_s is not None
    lit = device.counts.light_hz > 0
    light = device.counts.light_hz[lit]
    exposure = device.counts.exposure_s[lit]
    mean = np.where(device.falls.frames[lit] > 0, device.counts.mean[lit], np.nan)
    axes.plot(light, np.nanmedian(mean, axis=1) / exposure, "o", color=BLACK, label="measured")
    eta, tau = (np.nanmedian(each.value) for each in (device.efficiency, device.dead_time_s))
    dark = np.nanmedian(device.dark_counts_hz.value)
    grid = np.geomspace(light.min(), 1.5 * light.max(), 100)
    rate = dark + eta * grid
    axes.plot(grid, rate, ":", color=BLACK, linewidth=1, label="without dead time")
    for place, kind in enumerate(_KINDS):
        law = dead_time_moments(rate, exposure.max(), np.full(rate.shape, tau), kind)[0]
        axes.plot(grid, law / exposure.max(), **line_style(place), label=kind)
    axes.set(xscale="log", yscale="log", xlabel="light (photons/s on a pixel)", ylabel="counts/s")
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.legend(frameon=False)
    return to_svg(figure, name, "Saturation curve: counts over light")


@in_style
def residual_chart(device: Device, name: str) -> Markup:
    """Standardized residuals of mean counts at the levels of light."""
    figure, axes = new_axes(_WIDTH_PT, _HEIGHT_PT)
    axes.hist(residuals(device).ravel(), bins=60, range=(-6, 6), density=True, color=BLUE)
    z = np.linspace(-6, 6, 200)
    axes.plot(z, np.exp(-(z**2) / 2) / np.sqrt(2 * np.pi), color=BLACK, linewidth=1.5)
    axes.set(xlabel="residual (standard errors)", ylabel="density")
    return to_svg(figure, name, "Residuals of the saturation curve, beside a normal law")


def residuals(device: Device) -> Floats:
    """Mean counts less those of the fit, in standard errors; NaN where nothing is fitted.

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
