"""Draw natural-information.png: photons that methods need over a picture's information on motion.

Points are the least photons per frame of 60 × 60 px over all velocities, from the trials of
`megalopta reproduce chapter-4`, which are measured here if they are not in out/figures/trials. The
information is the harmonic mean over blocks of (∂λ/∂x)²/λ at one photon per pixel (the Poisson
bound). Filled: gray values of the forests; open: their light; stars: the dissertation's photons.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from megalopta.benchmark.trial import run, template_pixels
from megalopta.flow import fisher_information
from megalopta.flow.detectors.blocks import block_grid
from megalopta.flow.stimuli.moving_template import MovingTemplate
from megalopta.report.style import method_style
from megalopta.reproduction.chapter4 import PRINTED, SIZE, sweep
from megalopta.reproduction.sweep_figure import thresholds

GRID, COLUMNS_APART = block_grid((SIZE, SIZE)), 25
points = [*sweep("photographs").points, *sweep("fig-4.11").points]
points = [point for point in points if point.size == SIZE]
trials = [point.trial for point in points]
pixels = template_pixels(trial.template for trial in trials)
results = run(trials, pixels, Path("out/figures/trials"))
table = thresholds(points, results)
table = table[(table["metric"] == "literal") & (table["bits"] == 2)]
least = table.groupby(["method", "template"])["photons_per_frame"].min()
names = {point.trial.template: point.template for point in points}
figure, axes = plt.subplots(figsize=(8, 5), layout="constrained")
for method, (_, printed) in PRINTED.items():
    look = method_style(method) | {"linestyle": "none"}
    products = []
    for template in dict.fromkeys(trial.template for trial in trials):
        photons = least[method, names[template]]
        turning = MovingTemplate(pixels[template], COLUMNS_APART, SIZE)
        light = turning.light(0, pixels[template].shape[1] // COLUMNS_APART) * SIZE**2
        light += trials[0].search.dark_counts * 251**2 / photons
        along_x = [fisher_information(one, GRID)[1:-1, 1:-1, 0, 0] for one in light]
        information = 1 / np.mean(1 / np.array(along_x)) / GRID.block_px**2
        is_gray = getattr(template, "coding", "") == "srgb"
        products += [information * photons] * is_gray
        face = look["color"] if is_gray else "none"
        axes.loglog(information, photons, **look, markerfacecolor=face)
    star = np.exp(np.mean(np.log(products))) / printed
    axes.plot(star, printed, "*", color=look["color"], markersize=14, label=method)
axes.set(xlabel="information on motion (px⁻² per photon)", ylabel="least N_2b (photons per frame)")
axes.legend()
figure.savefig(Path(__file__).parent.parent / "natural-information.png", dpi=150)
