"""Draw photons.png: python docs/pictures/demo.py, which makes the dataset of demo.yaml."""

import json
from pathlib import Path

from matplotlib.figure import Figure

from megalopta.config.model import load
from megalopta.dataset.store import Dataset
from megalopta.report.style import method_style
from megalopta.scenes import Forest
from megalopta.sensor import open_counts
from megalopta.stages.run import run_all


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
    ideal, forest = dataset.configuration.sensors[-1], dataset.configuration.scene
    assert isinstance(forest, Forest)
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
        f"A forest of {forest.trees} trees; gray: photons that an ideal sensor detects in "
        f"{ideal.exposure_s:g} s",
        loc="left",
        pad=22,
        fontsize=10,
    )
    axis.spines[["top", "right"]].set_visible(False)
    axis.grid(axis="x", alpha=0.3)
    figure.savefig(path, dpi=100)


if __name__ == "__main__":
    here = Path(__file__)
    made = run_all("out/photons", load(str(here.with_suffix(".yaml"))))
    photons(made, here.parents[1] / "photons.png")
