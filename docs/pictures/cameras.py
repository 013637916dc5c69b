"""Draw cameras.png and tutorials/millilux.png: python docs/pictures/cameras.py.

Uses what `megalopta benchmark cameras` left in out/cameras, or measures it in a quarter of an hour.
"""

from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from megalopta.benchmark.cameras import AS_SOLD, compare_cameras
from megalopta.benchmark.cameras_page import draw_curves, summary
from megalopta.report.style import house_style


def cell(of: Any) -> str:
    """Format a share and its interval (%), bold if no camera is surely better."""
    value, low, high = (
        f"{share:.{0 if share >= 10 else 1}f}" if share >= 1 else f"{share:.1g}"
        for share in (100 * of.value, 100 * of.low, 100 * of.high)
    )
    ends = "" if of.low == of.high else f" ({low}…{high})"
    return (f"**{value}**{ends}" if of.is_best else f"{value}{ends}").replace("nan (nan…nan)", "–")


means = summary(compare_cameras())
for metric, pixels in (("error", AS_SOLD), ("information", AS_SOLD), ("information", "of 10 µm")):
    shown = means[(means["metric"] == metric) & (means["pixels"] == pixels)]
    lux = sorted(shown["lux"].unique())[::-1]
    print(f"\n{metric}, pixels {pixels} (%), at {', '.join(f'{light:g}' for light in lux)} lux")
    for name, lights in shown.sort_values("lux", ascending=False).groupby("sensor", sort=False):
        print(f"| {name} | {' | '.join(cell(one) for one in lights.itertuples())} |")
        if metric == "information" and pixels == AS_SOLD:
            print("Mbit/s per mm²:", *(f"{rate / 1e6:.3g}" for rate in lights["bits_s_mm2"]))
for name, metric in (("cameras", "information"), ("tutorials/millilux", "error")):
    with house_style({"axes.grid": False}):
        figure = Figure(figsize=(6, 4.8), layout="constrained")
        draw_curves(figure, means[means["pixels"] == AS_SOLD], metric)
        figure.savefig(Path(__file__).parents[1] / f"{name}.png", dpi=140)
