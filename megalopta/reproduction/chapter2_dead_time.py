"""Figure 2.2: what dead time leaves of the photons."""

from collections.abc import Mapping
from functools import partial

import numpy as np
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import EngFormatter

from megalopta.core.arrays import Floats
from megalopta.plotting.picture import Figure
from megalopta.plotting.style import BLACK, GRAY, PALETTE
from megalopta.reproduction.recipe import FigureRecipe, Run
from megalopta.sensor import DeadTime
from megalopta.sensor.effects import expected_counts

_DEAD_TIMES_S = (1e-9, 1e-8, 1e-7, 1e-6)
_DASHES = {"nonparalyzable": "-", "paralyzable": "--"}
_CAPTION = (
    "The curves are stationary means (Eq. 2.5 and 2.6) for four dead times τ. The count rate ends "
    "at 1/τ without and at 1/(e·τ) with paralysis, at one photon per dead time. The dynamic range "
    "reaches from 100 Hz of dark counts to that ceiling, for τ = 100 ns."
)


def _figure(_: Run) -> Figure:
    photons = np.geomspace(1e3, 1e10, 281)
    laws = {
        (kind, tau): DeadTime(kind=kind, dead_time_s=tau, start="stationary")
        for kind in _DASHES
        for tau in _DEAD_TIMES_S
    }
    curves = {key: expected_counts(photons, 1.0, law) for key, law in laws.items()}
    highest = curves["paralyzable", 1e-7].max()
    lasting, brief = (f"{20 * np.log10(rate / 100):.0f} dB" for rate in (highest, 1e7))
    return Figure(
        title="Figure 2.2: count rate over photon rate with dead time",
        caption=_CAPTION,
        printed={
            "Dynamic range, paralyzable": (lasting, "below 100 dB"),
            "Dynamic range, non-paralyzable": (brief, "below 100 dB"),
        },
        draw=partial(_draw, photons=photons, curves=curves),
        numbers={
            "photon_rate_hz": photons,
            **{f"{kind}_{1e9 * tau:g}_ns_hz": counts for (kind, tau), counts in curves.items()},
        },
    )


def _draw(canvas: Canvas, photons: Floats, curves: Mapping[tuple[str, float], Floats]) -> None:
    axes = canvas.subplots()
    axes.loglog(photons, photons, color=BLACK, label="ideal")
    for (kind, tau), counts in curves.items():
        color = PALETTE[_DEAD_TIMES_S.index(tau)]
        label = None if kind == "paralyzable" else f"τ = {EngFormatter(unit='s')(tau)}"
        axes.loglog(photons, counts, _DASHES[kind], color=color, label=label)
    for kind, label in (("nonparalyzable", "non-paralyzable"), ("paralyzable", "paralyzable")):
        axes.plot([], [], _DASHES[kind], color=GRAY, label=label)
    axes.set(xlabel="Photon rate (1/s)", ylabel="Count rate (1/s)")
    axes.set(xlim=(1e3, 1e10), ylim=(1e3, 3e9))
    axes.legend(loc="upper left", ncols=2)


RECIPES = (FigureRecipe("fig-2.2", _figure),)
