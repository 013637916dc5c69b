"""Make the README's pictures from a demo dataset: python docs/pictures.py out/demo.

gallery.png comes from `megalopta gallery`, leaderboard.png and natural-information.png from
`megalopta reproduce`.
"""

import json
import sys
from pathlib import Path

import numpy as np
from matplotlib.colors import PowerNorm
from matplotlib.figure import Figure
from skimage.io import imread

from megalopta.dataset.store import Dataset, open_sequence
from megalopta.flow import flow_to_rgb, wheel_legend
from megalopta.plotting.style import method_style
from megalopta.render import read_truth
from megalopta.sensor import open_counts

FRAME = 15


def strip(dataset: Dataset, path: Path) -> None:
    """One view as light, as counts of two sensors, and as true motion."""
    spadcam, *_, ideal = dataset.configuration.sensors
    figure = Figure(figsize=(12, 3.5), layout="constrained")
    axes = figure.subplots(1, 4)
    axes[0].imshow(imread(dataset.frame("training/clean", FRAME, "png")))
    axes[0].set_title("rendered radiance")
    for axis, sensor, level, title in (
        (axes[1], spadcam, 10.0, "SPADCAM at 10 lux"),
        (axes[2], ideal, "starlight", "ideal sensor, starlight"),
    ):
        counts = open_counts(dataset.counts(sensor, level))["counts"][FRAME]
        image = axis.imshow(counts, cmap="gray", norm=PowerNorm(0.5, 0, np.percentile(counts, 97)))
        figure.colorbar(image, ax=axis, shrink=0.8, label="counts in 0.1 s")
        axis.set_title(title)
    flow = read_truth(dataset.truth(FRAME)).flow_forward
    speed = float(np.nanpercentile(np.hypot(*np.moveaxis(flow, -1, 0)), 99))
    axes[3].imshow(flow_to_rgb(flow, speed))
    axes[3].set_title("true motion")
    wheel = axes[3].inset_axes((1.04, 0.0, 0.3, 0.3))
    wheel.imshow(wheel_legend(120))
    wheel.set_title(f"rim {speed:.1f}\npx/frame", fontsize=8)
    for axis in (*axes, wheel):
        axis.set_axis_off()
    figure.savefig(path, dpi=100)


def photons(dataset: Dataset, path: Path) -> None:
    """N_2b of every detector with its interval, beside the light that there is."""
    curves = json.loads(dataset.result("benchmark.json").read_text())["curves"]
    rows, columns = max(curve["shape"] for curve in curves)
    figure = Figure(figsize=(9, 3.4), layout="constrained")
    axis = figure.subplots()
    chosen = [c for c in curves if c["shape"] == [rows, columns]]
    places = {curve["label"]: -place // 2 for place, curve in enumerate(chosen)}
    for curve in chosen:
        found, place = curve["thresholds"]["N_2b"], places[curve["label"]]
        if found["flux"]:
            low, high = found["low"] or found["flux"], found["high"] or found["flux"]
            color = method_style(curve["method"])["color"]
            fill = color if curve["metric"] == "ratio" else "white"
            axis.plot([low, high], [place, place], color=color, linewidth=5, alpha=0.4)
            axis.plot(found["flux"], place, "o", color=color, markersize=8, markerfacecolor=fill)
    axis.set_yticks(list(places.values()), list(places))
    ideal = dataset.configuration.sensors[-1]
    for level in dataset.configuration.light_levels:
        events = open_counts(dataset.counts(ideal, level))["mean_events"]
        flux = events.mean() * events.shape[1] * events.shape[2]
        name = level.replace("_", " ") if isinstance(level, str) else f"{level:g} lux"
        axis.axvline(flux, color="#999999", linewidth=1, zorder=0)
        axis.annotate(name, (flux, 1.01), xycoords=("data", "axes fraction"), ha="center")
    axis.set_xscale("log")
    axis.set_xlabel(
        f"photons per frame of {columns} × {rows} px for an error of "
        "25\N{NO-BREAK SPACE}% (N_2b)\n"
        "filled: ratio of sums, open: mean of ratios (Eq. 4.5), which near-zero responses dominate"
    )
    axis.set_title(
        f"The demo's forest of {dataset.configuration.scene.trees} trees; gray: photons that an "
        f"ideal sensor detects in {ideal.exposure_s:g} s",
        loc="left",
        pad=22,
        fontsize=10,
    )
    axis.spines[["top", "right"]].set_visible(False)
    axis.grid(axis="x", alpha=0.3)
    figure.savefig(path, dpi=100)


if __name__ == "__main__":
    source, folder = open_sequence(Path(sys.argv[1])), Path(__file__).parent
    strip(source, folder / "strip.png")
    photons(source, folder / "photons.png")
