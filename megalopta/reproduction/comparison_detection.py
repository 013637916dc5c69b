"""Figure "detection": motion and its direction, over the photons; not in the dissertation.

The textures have equal contrast in all octaves. Fluxes do not count dark counts.
"""

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import PercentFormatter

from megalopta.benchmark.detection import (
    COLUMNS,
    CONTRAST,
    DARK_COUNTS,
    RESPONSES,
    SIZE,
    SPEED_COLUMNS,
    Detection,
    detections,
)
from megalopta.flow.detectors.registry import METHODS, Method, method
from megalopta.flow.metrics.detection import d_prime
from megalopta.flow.metrics.photon_threshold import format_flux
from megalopta.plotting.picture import Figure, columns_of
from megalopta.plotting.style import GRAY, legend_alone, method_style
from megalopta.reproduction.drawing import FigureRecipe

FLUXES = tuple(10 ** (half / 2) for half in range(5, 14))
ROC_FLUX = 3e4
_CAPTION = (
    f"Textures of {100 * CONTRAST:g} % rms contrast move by {SPEED_COLUMNS * SIZE / COLUMNS:.2f} "
    f"px per frame, with {DARK_COUNTS:.2f} dark counts per pixel; each block of {SIZE // 10} × "
    f"{SIZE // 10} px in frames of {SIZE} × {SIZE} px has one response, a velocity or a mean, but "
    "PC one for the whole frame. The measure d′ is √2·Φ⁻¹(area under the ROC), which "
    f"{RESPONSES:,} responses limit to {{:.1f}} (dotted); NDM and NDS do not depend on direction. "
    "A false alarm exceeds half of the median noise-free response to motion; the ROC is that at "
    "{} photons per frame."
)


def detection_figure(
    methods: Sequence[Method] | None = None, fluxes: Sequence[float] = FLUXES
) -> Figure:
    """d′ against photons per frame, false alarms, and one ROC, for all methods or some."""
    detectors = [method(each) for each in methods or METHODS if methods or each != "IM"]
    at_flux = [detections(detectors, flux) for flux in fluxes]
    found = dict(zip((each.name for each in detectors), zip(*at_flux, strict=True), strict=True))
    shown = min(fluxes, key=lambda flux: abs(np.log(flux / ROC_FLUX)))

    return Figure(
        name="detection",
        title="Detecting motion and its direction, over the photons per frame",
        caption=_CAPTION.format(_limit(), format_flux(shown)),
        draw=partial(_draw_panels, found=found, roc_flux=shown),
        numbers=columns_of(
            {
                "method": each.method,
                "photons_per_frame": each.flux,
                "d_prime_motion": each.motion,
                "d_prime_direction": each.direction,
                "false_alarm_rate": each.false_alarms,
            }
            for measured in found.values()
            for each in measured
        ),
        height_in=7.4,
    )


def _limit() -> float:
    return d_prime(np.zeros(RESPONSES), np.ones(RESPONSES))


def _draw_panels(canvas: Canvas, found: Mapping[str, Sequence[Detection]], roc_flux: float) -> None:
    panels = canvas.subplot_mosaic(
        [["motion", "direction"], ["false_alarms", "roc"], ["legend", "legend"]],
        height_ratios=(1, 1, 0.18),
    )
    for field in ("motion", "direction", "false_alarms"):
        for name, measured in found.items():
            values = [getattr(each, field) for each in measured]
            fluxes = [each.flux for each in measured]
            panels[field].plot(fluxes, values, label=name, **method_style(name))
        panels[field].set(xscale="log", xlabel="Photons per frame")
    for field, title in (("motion", "Moving from still"), ("direction", "Right from left")):
        panels[field].axhline(_limit(), color=GRAY, linewidth=1, linestyle=":")
        panels[field].set(title=title, ylabel="d′")
    panels["false_alarms"].set(title="False alarms in a still scene", ylabel="Share of blocks")
    panels["false_alarms"].yaxis.set_major_formatter(PercentFormatter(1))
    _draw_roc(panels["roc"], found, roc_flux)
    look = {"ncols": 6, "handlelength": 2.8, "columnspacing": 1.1, "markerscale": 0.8}
    legend_alone(panels["legend"], panels["motion"], **look)


def _draw_roc(axes: Axes, found: Mapping[str, Sequence[Detection]], flux: float) -> None:
    for name, measured in found.items():
        curve = next(each.curve for each in measured if each.flux == flux)
        style = method_style(name) | {"marker": ""}
        axes.plot(curve.false_alarms, curve.hits, **style)
    axes.plot([0, 1], [0, 1], color=GRAY, linewidth=1, linestyle=":")
    axes.set(title="ROC, moving from still", xlabel="False alarms", ylabel="Hits")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(PercentFormatter(1))


RECIPES = (FigureRecipe("detection", lambda _: detection_figure()),)
