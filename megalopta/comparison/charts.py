"""Pictures of the comparison report."""

from collections.abc import Sequence

import numpy as np
from markupsafe import Markup

from megalopta.comparison.motion import SpeedResponse
from megalopta.figures import BLACK, BLUE, VERMILION, in_style, new_axes, to_svg
from megalopta.sensor.compare import SEGMENT, Comparison, CountedFrames, mean_spectrum

Levels = Sequence[CountedFrames]

_WIDTH_PT, _HEIGHT_PT = 380, 270
_FRAMES_SHOWN = 200
_SOURCES = (("captured", BLUE, "o"), ("simulated", VERMILION, "x"))


@in_style
def transfer_chart(captured: Levels, simulated: Levels) -> Markup:
    """Variance of pixels over their mean."""
    figure, axes = new_axes(_WIDTH_PT, _HEIGHT_PT)
    for levels, (label, color, marker) in zip((captured, simulated), _SOURCES, strict=True):
        mean = np.concatenate([level.counts.mean(axis=0).ravel() for level in levels])
        variance = np.concatenate([level.counts.var(axis=0).ravel() for level in levels])
        axes.plot(mean, variance, marker, color=color, markersize=2.5, linewidth=0, label=label)
    axes.set(xlabel="mean counts", ylabel="variance", xscale="symlog", yscale="symlog")
    axes.legend(frameon=False)
    return to_svg(figure, "transfer", "Photon transfer: variance over mean, captured and simulated")


@in_style
def dark_chart(captured: CountedFrames, simulated: CountedFrames) -> Markup:
    """Dark counts of pixels in order, captured and simulated."""
    figure, axes = new_axes(_WIDTH_PT, _HEIGHT_PT)
    for level, (label, color, _) in zip((captured, simulated), _SOURCES, strict=True):
        rates = np.sort(level.counts.mean(axis=0).ravel()) / level.exposure_s
        share = (np.arange(rates.size) + 0.5) / rates.size
        axes.plot(np.maximum(rates, 1e-3), share, color=color, label=label)
    axes.set(xscale="log", xlabel="dark counts (Hz)", ylabel="share of pixels below")
    axes.legend(frameon=False)
    return to_svg(figure, "dark", "Distribution of dark counts over the pixels")


@in_style
def spectrum_chart(captured: CountedFrames, simulated: CountedFrames) -> Markup:
    """Temporal spectrum of the readings, mean over pixels."""
    figure, axes = new_axes(_WIDTH_PT, _HEIGHT_PT)
    for level, (label, color, _) in zip((captured, simulated), _SOURCES, strict=True):
        segments = len(level.counts) // SEGMENT
        pieces = np.asarray(level.counts[: segments * SEGMENT], np.float64)
        power = mean_spectrum(pieces.reshape(segments, SEGMENT, -1)).mean(axis=0)[1:]
        axes.plot(np.arange(1, power.size + 1) / SEGMENT, power, color=color, label=label)
    axes.set(xlabel="cycles per frame", ylabel="power (counts²)", ylim=(0, None))
    axes.legend(frameon=False)
    return to_svg(figure, "spectrum", "Temporal spectrum of readings, captured and simulated")


@in_style
def difference_chart(captured: CountedFrames, simulated: CountedFrames, name: str) -> Markup:
    """Map of the difference of means, in standard errors."""
    figure, axes = new_axes(_WIDTH_PT, _HEIGHT_PT)
    pair = captured.counts, simulated.counts
    error = np.sqrt(sum(each.var(axis=0, ddof=1) / len(each) for each in pair))
    z = (pair[0].mean(axis=0) - pair[1].mean(axis=0)) / np.maximum(error, 1e-9)
    picture = axes.imshow(z, cmap="PuOr", vmin=-6, vmax=6, interpolation="nearest")
    figure.colorbar(picture, ax=axes, shrink=0.85)
    kind = "dark" if captured.is_dark else f"light {captured.light_hz:g}"
    axes.set(title=f"{kind}, {captured.exposure_s:g} s (standard errors)")
    return to_svg(figure, name, "Map of captured less simulated means, in standard errors")


@in_style
def distance_chart(found: Comparison) -> Markup:
    """Energy distances of pixels in order, and those by chance."""
    figure, axes = new_axes(_WIDTH_PT, _HEIGHT_PT)
    for values, label, color in (
        (found.distances.energy, "captured and simulated", BLUE),
        (found.by_chance.energy, "by chance", VERMILION),
    ):
        share = (np.arange(values.size) + 0.5) / values.size
        axes.plot(np.sort(values.ravel()), share, color=color, label=label)
    axes.set(xlabel="energy distance (counts^½)", ylabel="share of pixels below", xlim=(0, None))
    axes.legend(frameon=False)
    return to_svg(figure, "distance", "Energy distances of histograms, and those by chance")


@in_style
def time_chart(captured: CountedFrames, simulated: CountedFrames) -> Markup:
    """Mean counts of frames, one after the other."""
    figure, axes = new_axes(_WIDTH_PT, _HEIGHT_PT)
    for frames, (label, color, _) in zip((captured, simulated), _SOURCES, strict=True):
        axes.plot(frames.counts[:_FRAMES_SHOWN].mean(axis=(1, 2)), color=color, label=label)
    axes.set(xlabel="frame", ylabel="mean counts")
    axes.legend(frameon=False)
    return to_svg(figure, "time", "Mean counts of frames, captured and simulated")


@in_style
def response_chart(responses: Sequence[SpeedResponse], method: str) -> Markup:
    """Transfer function: peak response over speed, mean and standard deviation."""
    figure, axes = new_axes(_WIDTH_PT, _HEIGHT_PT)
    own = [each for each in responses if each.name == method]
    for field, (label, color, marker) in zip(("captured", "simulated"), _SOURCES, strict=True):
        values = [getattr(each, field) for each in own]
        axes.errorbar(
            [each.speed_mm_s for each in own],
            [each.mean() for each in values],
            [each.std(ddof=1) for each in values],
            color=color,
            marker=marker,
            label=label,
        )
    axes.axhline(0, color=BLACK, linewidth=0.5)
    axes.set(
        xlabel="speed (mm/s)", ylabel=f"peak response ({own[0].difference.unit})", title=method
    )
    axes.legend(frameon=False)
    return to_svg(figure, f"response-{method}", f"Transfer function of {method}")
