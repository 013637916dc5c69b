"""Draw chapter-4.png, and print what docs/results/dissertation.md says of Chapter 4.

Results of `megalopta reproduce chapter-4` are taken from out/figures, or measured. Quotients of
N_2b by Eq. 4.5 have a 95 % CI (gratings) or the range over the forests.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from megalopta.benchmark.trial import GratingTemplate, Trial, measure_trial
from megalopta.report.style import NUMBERS, house_style, method_style
from megalopta.reproduction.chapter4 import CHAPTER, FIGURES, PRINTED, TABLE, reproduce
from megalopta.reproduction.sweep_figure import over_templates

OUT, PICTURE = Path("out/figures"), Path(__file__).parent.parent / "chapter-4.png"
PHOTONS, LABELS = "photons_per_frame", {"4.5": "cycles per frame", "4.6": "contrast"}
LABELS |= dict.fromkeys(("4.7", "4.10"), "dark counts per pixel")
LABELS |= dict.fromkeys(("4.9", "4.13"), "pooling N (px)")
SMALL = {"axes.labelsize": 8, "axes.titlesize": 9, "xtick.labelsize": 7.5, "ytick.labelsize": 7.5}
QUOTIENTS = (  # two points, each a figure, a size and a value
    (("4.5", 240, 1), ("4.5", 240, 9)),
    (("4.6", 240, 0.1), ("4.6", 240, 0.2)),
    (("4.6", 240, 0.8), ("4.6", 240, 0.9)),
    (("4.6", 240, 0.1), ("4.6", 240, 0.9)),
    (("4.7", 240, 1000), ("4.7", 240, 100)),
    (("4.8", 240, 10), ("4.8", 240, 2)),
    (("4.9", 240, 240), ("4.9", 60, 60)),
    (("4.10", 240, 1000), ("4.10", 240, 100)),
    (("4.11", 240, 10), ("4.11", 240, 2)),
    (("4.12", 240, 2), ("4.11", 240, 2)),
    (("4.12", 240, 10), ("4.11", 240, 10)),
    (("4.13", 240, 240), ("4.13", 60, 60)),
)
reproduce([CHAPTER], OUT)
tables = {name.removeprefix("fig-"): pd.read_csv(OUT / f"{name}.csv") for name in FIGURES}
tables = {figure: table[table["metric"] == "literal"] for figure, table in tables.items()}
for points in QUOTIENTS:
    for method in (*PRINTED, "IM"):
        chosen = "size_px == @size and value == @value and method == @method"
        pair = [tables[figure].query(chosen) for figure, size, value in points]
        mean = pair[0][PHOTONS].mean() / pair[1][PHOTONS].mean()
        ends = pair[0][PHOTONS].to_numpy() / pair[1][PHOTONS].to_numpy()
        if len(ends) == 1:
            widths = [np.log(side["high"] / side["low"]).item() / 2 for side in pair]
            ends = mean * np.exp(np.array([-1, 1]) * np.hypot(*widths))
        decades = " ".join(f"{number:.3f}" for number in np.log10([mean, min(ends), max(ends)]))
        print(
            f"{points} {method}: {mean:.3g} ({min(ends):.3g} to {max(ends):.3g}); log10 {decades}"
        )
trial = Trial.model_validate({"search": {"bits": (2, 4), "phases": 3, "frames": 4}})
for curve in measure_trial(trial, GratingTemplate().pixels(), "slope")[::2]:
    needed = [(at.flux, at.low, at.high) for at in curve.thresholds.values()]
    two, four = np.log10(np.array(needed, np.float64))
    slope = 12.04 / (four[0] - two[0])
    error = slope**2 / 12.04 * np.hypot(two[2] - two[1], four[2] - four[1]) / 2
    print(f"§4.6.5: {curve.method} {slope:.1f} ± {error:.1f} dB per decade")

with house_style(SMALL | {"lines.markersize": 4, "lines.linewidth": 1.3}):
    drawing, panels = plt.subplots(5, 2, figsize=(7, 10.5), layout="constrained")
    for axes, (figure, table) in zip(panels.flat, tables.items(), strict=False):
        shown = table[table["method"] != "IM"]
        shown = shown if "N" in LABELS.get(figure, "") else shown[shown["size_px"] == 240]
        for name, line in over_templates(shown).groupby("method", sort=False):
            flux = line[PHOTONS]
            bars = np.abs(np.stack((flux - line["low"], line["high"] - flux)))
            axes.errorbar(line["value"], flux, bars, **method_style(str(name)), label=name)
        kind = "gratings" if float(figure[2:]) < 10 else "forests"
        axes.set_title(f"{figure}: {kind}{', blurred' * (figure == '4.12')}", loc="left")
        axes.set(xlabel=LABELS.get(figure, "velocity (px per frame)"), yscale="log")
        axes.set_xscale("log" if "dark" in axes.get_xlabel() else "linear")
    axes, stated = panels[4, 1], pd.read_csv(OUT / f"{TABLE}.csv").query("metric == 'literal'")
    for (of, images), row in stated.groupby(["method", "images"]):
        face = {"natural": "none"} if images == "natural" else {}
        look = method_style(str(of)) | {"markerfacecolor": face.get(str(images))}
        bars = np.abs(row[["low", "high"]].to_numpy().T - row[PHOTONS].to_numpy())
        if images != "photo":
            axes.errorbar(row["thesis_photons_per_frame"], row[PHOTONS], bars, **look)
    axes.axline((1e5, 1e5), (1e6, 1e6), color="gray", linewidth=1)
    axes.set(xscale="log", yscale="log", xlabel="dissertation", ylabel="here")
    axes.set_title("Table 4.1: gratings, forests (open)", loc="left")
    for axes in panels.flat:
        axes.yaxis.set_major_formatter(NUMBERS)
    drawing.supylabel("N_2b (photons per frame)", fontsize=8)
    handles = panels[0, 0].get_legend_handles_labels()
    drawing.legend(*handles, loc="outside upper center", ncols=5)
    drawing.savefig(PICTURE, dpi=140)
