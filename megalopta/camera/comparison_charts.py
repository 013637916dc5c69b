"""Pictures of the comparison report."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from megalopta.camera.comparison_motion import SpeedResponse
from megalopta.core.arrays import Floats
from megalopta.plotting.style import BLACK, BLUE, VERMILION
from megalopta.plotting.svg import in_style, new_axes, to_svg
from megalopta.sensor.compare.counted import CountedFrames
from megalopta.sensor.compare.recordings import Comparison
from megalopta.sensor.compare.spectrum import SEGMENT, mean_spectrum

Levels = Sequence[CountedFrames]

_WIDTH_PT, _HEIGHT_PT = 380, 270
_FRAMES_SHOWN = 200
_MOST_POINTS = 2000
"""Pixels in a picture; of a large array, evenly chosen ones."""
_STYLES = (
    {"label": "captured", "color": BLUE, "marker": "o"},
    {"label": "simulated", "color": VERMILION, "marker": "x"},
)


@in_style
def transfer_chart(captured: Levels, simulated: Levels) -> Markup:
    """Variance of pixels over their mean."""
    figure, axes = new_axes(_WIDTH_PT, _HEIGHT_PT)
    for levels, style in _beside(captured, simulated):
        for place, level in enumerate(levels):
            shown = _thinned(level.counts.reshape(len(level.counts), -1).T)
            own = style | {"label": "" if place else style["label"]}
            axes.plot(shown.mean(axis=1), shown.var(axis=1), markersize=2.5, linewidth=0, **own)
    axes.set(xlabel="mean counts", ylabel="variance (counts²)", xscale="symlog", yscale="symlog")
    description = "Photon transfer: variance over mean counts"
    return _finished(figure, axes, "transfer", description, markerscale=2)


@in_style
def dark_chart(captured: CountedFrames, simulated: CountedFrames) -> Markup:
    """Dark counts of pixels in order."""
    figure, axes = new_axes(_WIDTH_PT, _HEIGHT_PT)
    for level, style in _beside(captured, simulated):
        rates = level.counts.mean(axis=0) / level.exposure_s
        _draw_shares(axes, np.maximum(rates, 1e-3), style)
    axes.set(xscale="log", xlabel="dark counts (Hz)", ylabel="share of pixels below")
    return _finished(figure, axes, "dark", "Distribution of dark counts over the pixels")


@in_style
def spectrum_chart(captured: CountedFrames, simulated: CountedFrames) -> Markup:
    """Temporal spectrum of the readings, mean over pixels."""
    figure, axes = new_axes(_WIDTH_PT, _HEIGHT_PT)
    for level, style in _beside(captured, simulated):
        segments = len(level.counts) // SEGMENT
        pieces = np.asarray(level.counts[: segments * SEGMENT], np.float64)
        power = mean_spectrum(pieces.reshape(segments, SEGMENT, -1)).mean(axis=0)[1:]
        axes.plot(np.arange(1, power.size + 1) / SEGMENT, power, **_line(style))
    axes.set(xlabel="cycles per frame", ylabel="power (counts²)", ylim=(0, None))
    return _finished(figure, axes, "spectrum", "Temporal spectrum of readings")


@in_style
def distance_chart(found: Comparison) -> Markup:
    """Energy distances of pixels in order, and those by chance."""
    figure, axes = new_axes(_WIDTH_PT, _HEIGHT_PT)
    for distances, label, color in (
        (found.distances, "captured and simulated", BLUE),
        (found.by_chance, "by chance", VERMILION),
    ):
        _draw_shares(axes, distances.energy, {"label": label, "color": color})
    axes.set(xlabel="energy distance (counts$^{1/2}$)", ylabel="share of pixels below")
    axes.set_xlim(left=0)
    return _finished(figure, axes, "distance", "Energy distances of histograms, over the pixels")


@in_style
def time_chart(captured: CountedFrames, simulated: CountedFrames) -> Markup:
    """Mean counts of frames, one after the other."""
    figure, axes = new_axes(1.5 * _WIDTH_PT, 0.8 * _HEIGHT_PT)
    for frames, style in _beside(captured, simulated):
        axes.plot(frames.counts[:_FRAMES_SHOWN].mean(axis=(1, 2)), **_line(style))
    axes.set(xlabel="frame", ylabel="mean counts")
    outside = {"loc": "lower right", "bbox_to_anchor": (1, 1), "ncols": 2}
    return _finished(figure, axes, "time", "Mean counts of frames", **outside)


@in_style
def response_chart(responses: Sequence[SpeedResponse], method: str) -> Markup:
    """Transfer function: peak response over speed, mean and standard deviation."""
    figure, axes = new_axes(_WIDTH_PT, _HEIGHT_PT)
    own = [each for each in responses if each.name == method]
    speeds = [each.speed_mm_s for each in own]
    for values, style in _beside([each.captured for each in own], [each.simulated for each in own]):
        means, spreads = zip(*((each.mean(), each.std(ddof=1)) for each in values), strict=True)
        axes.errorbar(speeds, means, spreads, capsize=3, markersize=4, **style)
    axes.axhline(0, color=BLACK, linewidth=0.5)
    unit = own[0].difference.unit
    axes.set(xlabel="speed (mm/s)", ylabel=f"peak response ({unit})", title=method)
    return _finished(figure, axes, f"response-{method}", f"Transfer function of {method}")


def _beside(captured: Any, simulated: Any) -> Iterator[tuple[Any, dict[str, Any]]]:
    """Both, each with its style."""
    return zip((captured, simulated), _STYLES, strict=True)


def _line(style: dict[str, Any]) -> dict[str, Any]:
    return style | {"marker": ""}


def _draw_shares(axes: Axes, values: Floats, style: dict[str, Any]) -> None:
    """Share of values up to each of them."""
    shares = (np.arange(values.size) + 0.5) / values.size
    axes.plot(_thinned(np.sort(values, axis=None)), _thinned(shares), **_line(style))


def _thinned(values: NDArray[Any]) -> NDArray[Any]:
    return values[:: max(1, len(values) // _MOST_POINTS)]


def _finished(figure: Figure, axes: Axes, name: str, description: str, **legend: Any) -> Markup:
    axes.legend(frameon=False, **legend)
    return to_svg(figure, name, f"{description}, captured and simulated")
