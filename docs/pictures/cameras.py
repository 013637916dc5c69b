"""Draw cameras.png and tutorials/millilux.png: python docs/pictures/cameras.py.

Uses what `megalopta benchmark cameras` left in out/cameras, or measures it in a quarter of an hour.
"""

from pathlib import Path

from matplotlib.figure import Figure

from megalopta.benchmark.cameras import AS_SOLD, compare_cameras
from megalopta.benchmark.cameras_page import draw_curves, summary
from megalopta.report.style import house_style

means = summary(compare_cameras())
for name, metric in (("cameras", "information"), ("tutorials/millilux", "error")):
    with house_style({"axes.grid": False}):
        figure = Figure(figsize=(6, 4.8), layout="constrained")
        draw_curves(figure, means[means["pixels"] == AS_SOLD], metric)
        figure.savefig(Path(__file__).parents[1] / f"{name}.png", dpi=140)
