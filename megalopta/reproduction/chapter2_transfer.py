"""Figures 2.18 and 2.19 of §2.4.8: peak responses of NDM and NDS over the velocity of an edge.

The dissertation gives one signal-to-noise ratio per detector and no definition. Here it is 20·log10
of the mean peak response of one detector over its standard deviation between crossings, averaged
over all speeds but standstill.
"""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from megalopta.camera.motion_bench import (
    PIXELS,
    SENSORS,
    SPEEDS_MM_S,
    TIME_CONSTANTS_S,
    UNITS,
    Peaks,
    filter_step,
    peaks,
    pixels_per_frame,
)
from megalopta.core.arrays import Floats
from megalopta.flow.detectors.correlation import ndm_mean, nds_mean
from megalopta.plotting.picture import Figure
from megalopta.plotting.style import (
    BLACK,
    BLUE,
    GREEN,
    ORANGE,
)
from megalopta.reproduction.chapter2_edge import csv_name
from megalopta.reproduction.figure_recipe import FigureRecipe

THEORY_CYCLES = 0.5
"""Cycles of the theoretical sinusoid along the row; the dissertation says only: below 1."""
PRINTED_SNR_DB = {"NDM": 12.6, "NDS": 15.7}
SHEET_DARK_COUNTS = 1.77 * 360 * 0.1
"""Hz/µm² (§2.4.7) · µm² · s."""
_EQUATIONS = {"NDM": "Eq. 4.2", "NDS": "Eq. 4.3, corrected"}
_MEANS = {"NDM": ndm_mean, "NDS": nds_mean}
_NOISELESS = "edge without noise"


def measured_peaks(method: str) -> dict[str, list[Peaks]]:
    """Return peak responses at every speed, for each noise model."""
    return {
        name: [peaks(speed, sensor)[method] for speed in SPEEDS_MM_S]
        for name, sensor in SENSORS.items()
    }


def mean_snr_db(over_speeds: Sequence[Peaks]) -> float:
    """Return the mean over all speeds but standstill, which comes first."""
    return float(np.mean([each.snr_db for each in over_speeds[1:]]))


def theory(method: str, velocity: Floats) -> Floats:
    """Return the mean response to a sinusoid of contrast 1 that moves so many pixels per frame."""
    phase = 2 * np.pi * THEORY_CYCLES / PIXELS
    return _MEANS[method](filter_step(method), phase * velocity, phase, 1.0)


class OverSpeeds(NamedTuple):
    """Peaks of one detector over the speed of the plate, of each of two recordings."""

    method: str
    speeds_mm_s: Sequence[float]
    found: Mapping[str, Sequence[Peaks]]

    @property
    def velocity(self) -> Floats:
        """Velocity of the image (px per frame)."""
        return np.array([pixels_per_frame(speed) for speed in self.speeds_mm_s])

    @property
    def ideal(self) -> Floats:
        """Mean peaks without noise, those of the first recording."""
        first = next(iter(self.found.values()))
        return np.array([each.ideal.mean() for each in first])

    def theory(self, velocity: Floats) -> Floats:
        """Return the theoretical curve, as high as the peaks without noise."""
        scale = self.ideal.max() / theory(self.method, self.velocity).max()
        return np.asarray(scale * theory(self.method, velocity))

    def columns(self) -> dict[str, Floats]:
        """Return the numbers at every speed by the names of their columns."""
        return {
            "speed_mm_s": np.array(self.speeds_mm_s, float),
            "velocity_px_per_frame": self.velocity,
            "theoretical": self.theory(self.velocity),
            "without_noise": self.ideal,
            **{
                f"{csv_name(label)}_{what}": values
                for label, own in self.found.items()
                for what, values in _statistics(own).items()
            },
        }

    def draw(self, axes: Axes, snr_db: Mapping[str, float]) -> None:
        """Draw peak responses with their standard deviations, and what they should be."""
        velocity, styles = self.velocity, (("o", BLUE, -0.1), ("s", ORANGE, 0.1))
        fine = np.linspace(0, velocity[-1], 201)
        curve = self.theory(fine)
        axes.plot(fine, curve, "--", color=BLACK, lw=1.6, label="theoretical, sinusoid")
        line = "-" if velocity.size > 1 else "_"
        axes.plot(velocity, self.ideal, line, color=GREEN, lw=1.6, ms=24, label=_NOISELESS)
        for (label, own), (marker, color, shift) in zip(self.found.items(), styles, strict=True):
            each = _statistics(own)
            look: dict[str, Any] = {"fmt": marker, "color": color, "capsize": 3, "lw": 1.4}
            look["label"] = f"{label}, mean SNR {snr_db[label]:.1f} dB"
            axes.errorbar(velocity + shift, each["mean"], each["sigma"], **look)
        axes.set_ylim(0, None)
        axes.set_ylabel(f"Peak response ({UNITS[self.method]})")
        axes.legend(loc="lower right")


def _figure(number: str, method: str) -> Figure:
    found = measured_peaks(method)
    over = OverSpeeds(method, SPEEDS_MM_S, found)
    return Figure(
        title=f"Figure {number}: peak response of {method} to an edge over its velocity",
        caption=_caption(method, found),
        printed=_printed(method, found, float(over.ideal[2] / over.ideal[1])),
        draw=partial(_draw, over=over),
        numbers=over.columns(),
    )


def _draw(canvas: Canvas, over: OverSpeeds) -> None:
    axes = canvas.subplots()
    over.draw(axes, {label: mean_snr_db(own) for label, own in over.found.items()})
    axes.set(xlabel="Image velocity (pixels/frame)")


def _statistics(over_speeds: Sequence[Peaks]) -> dict[str, Floats]:
    return {
        "mean": np.array([each.mean for each in over_speeds]),
        "sigma": np.array([each.deviation for each in over_speeds]),
        "snr_db": np.array([each.snr_db for each in over_speeds]),
    }


def _caption(method: str, found: dict[str, list[Peaks]]) -> str:
    crossings, rows, detectors = found["Poisson noise only"][0].noisy.shape
    return (
        "Points are the mean and σ of the largest response of one detector while an edge crosses, "
        f"over {crossings} crossings of {detectors} detectors in each of {rows} rows, with time "
        f"constants of {1e3 * TIME_CONSTANTS_S[method]:.0f} ms and, in SPADCAM, "
        f"{SHEET_DARK_COUNTS:.0f} dark counts per pixel and frame. The SNR is 20·log10(mean/σ), "
        "averaged over the speeds but 0; the dissertation does not define its own. The theoretical "
        f"curve is the mean response ({_EQUATIONS[method]}) to a sinusoid of {THEORY_CYCLES:g} "
        "cycles along the row, scaled to the same height."
    )


def _printed(
    method: str, found: dict[str, list[Peaks]], growth: float
) -> dict[str, tuple[str, str]]:
    """Return SNR, NDM behind NDS (a product doubles relative noise: 6 dB), and linearity."""
    rows_db = np.mean([each.row_snr_db for each in found["SPADCAM"][1:]], axis=0)
    sums, products = measured_peaks("NDS"), measured_peaks("NDM")
    behind = [mean_snr_db(sums[label]) - mean_snr_db(products[label]) for label in sums]
    return {
        **{
            f"SNR, {label}": (
                f"{mean_snr_db(over_speeds):.1f} dB",
                f"{PRINTED_SNR_DB[method]} dB, one row",
            )
            for label, over_speeds in found.items()
        },
        "SNR of single rows, SPADCAM": (f"{rows_db.min():.1f} to {rows_db.max():.1f} dB", "—"),
        "NDM behind NDS": (
            f"{min(behind):.1f} to {max(behind):.1f} dB",
            f"{PRINTED_SNR_DB['NDS'] - PRINTED_SNR_DB['NDM']:.1f} dB",
        ),
        "Growth from 1.67 to 3.33 px/frame": (f"{growth:.2f} times", "fairly linear below 4"),
    }


RECIPES = (
    FigureRecipe("fig-2.18", lambda _: _figure("2.18", "NDM")),
    FigureRecipe("fig-2.19", lambda _: _figure("2.19", "NDS")),
)
