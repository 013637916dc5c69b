"""Draw photons.png: python docs/pictures/demo.py, which makes the dataset of demo.yaml."""

import json
from pathlib import Path

from matplotlib.figure import Figure

from megalopta.config.model import load
from megalopta.dataset.store import Dataset
from megalopta.flow import METHODS
from megalopta.report.style import BLACK, NUMBERS, house_style, method_style
from megalopta.sensor import open_counts
from megalopta.stages.run import run_all


def photons(dataset: Dataset, path: Path) -> None:
    """N_2b of every detector with its interval, and the light that there is."""
    curves = json.loads(dataset.result("benchmark.json").read_text())["curves"]
    rows, columns = max(curve["shape"] for curve in curves)
    chosen = [c for c in curves if c["shape"] == [rows, columns] and c["metric"] == "ratio"]
    with house_style({"axes.grid.axis": "x"}):
        figure = Figure(figsize=(6, 2.8), layout="constrained")
        axis = figure.subplots()
        for place, curve in enumerate(chosen):
            needed = curve["thresholds"]["N_2b"]
            low, high = needed["low"] or needed["flux"], needed["high"] or needed["flux"]
            color = method_style(curve["method"])["color"]
            axis.plot([low, high], [place, place], color=color, linewidth=5, alpha=0.35)
            axis.plot(needed["flux"], place, "o", color=color, markersize=9)
        axis.set_yticks(range(len(chosen)), [METHODS[curve["method"]].label for curve in chosen])
        axis.invert_yaxis()
        ideal = dataset.configuration.sensors[-1]
        for level in dataset.configuration.light_levels:
            events = open_counts(dataset.counts(ideal, level))["mean_events"]
            flux = events.mean() * events.shape[1] * events.shape[2]
            name = level.replace("_", " ") if isinstance(level, str) else f"{level:g} lux"
            axis.axvline(flux, color=BLACK, linestyle="--", linewidth=1.2)
            axis.annotate(name, (flux, 1), xycoords=axis.get_xaxis_transform(), xytext=(0, 4),
                          textcoords="offset points", ha="center")  # fmt: skip
        axis.set_xscale("log")
        axis.set_xlabel("photons per frame for an error of 25 %")
        axis.xaxis.set_major_formatter(NUMBERS)
        axis.tick_params(axis="y", length=0)
        axis.spines["left"].set_visible(False)
        figure.savefig(path, dpi=140)


if __name__ == "__main__":
    here = Path(__file__)
    made = run_all("out/photons", load(str(here.with_suffix(".yaml"))))
    photons(made, here.parents[1] / "photons.png")
