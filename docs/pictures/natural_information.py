"""Draw natural-information.png: photons that methods need over a picture's information on motion.

Points are the least photons per frame of 60 × 60 px over all velocities, from the trials of
`megalopta reproduce chapter-4`, which are measured here if they are not in out/figures/trials. The
information is the harmonic mean over blocks of (∂λ/∂x)²/λ at one photon per pixel (the Poisson
bound). Filled: gray values of the forests; open: their light; lines: inverse to the information.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.ticker import FixedLocator, NullLocator

from megalopta.benchmark.trial import run, template_pixels
from megalopta.flow import METHODS, fisher_information
from megalopta.flow.detectors.blocks import block_grid
from megalopta.flow.stimuli.moving_template import MovingTemplate
from megalopta.report.style import NUMBERS, house_style, method_style
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
with house_style():
    figure, axes = plt.subplots(figsize=(6, 5.6), layout="constrained")
    for method in PRINTED:
        look = method_style(method) | {"linestyle": "none"}
        products, all_information = [], []
        for template in dict.fromkeys(trial.template for trial in trials):
            photons = least[method, names[template]]
            turning = MovingTemplate(pixels[template], COLUMNS_APART, SIZE)
            light = turning.light(0, pixels[template].shape[1] // COLUMNS_APART) * SIZE**2
            light += trials[0].search.dark_counts * 251**2 / photons
            along_x = [fisher_information(one, GRID)[1:-1, 1:-1, 0, 0] for one in light]
            information = 1 / np.mean(1 / np.array(along_x)) / GRID.block_px**2
            is_gray = getattr(template, "coding", "") == "srgb"
            products += [information * photons] * is_gray
            all_information.append(information)
            face = look["color"] if is_gray else "none"
            axes.loglog(information, photons, **look, markersize=8, markerfacecolor=face)
        ends = np.array([min(all_information), max(all_information)])
        axes.plot(ends, np.exp(np.mean(np.log(products))) / ends, color=look["color"], linewidth=1)
        axes.plot([], [], **look, label=METHODS[method].label)
    axes.set(xlabel="information on motion per photon (px⁻²)", ylabel="least photons per frame")
    axes.xaxis.set_major_locator(FixedLocator([0.05, 0.1, 0.2, 0.5]))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(NUMBERS)
    axes.yaxis.set_major_formatter(NUMBERS)
    figure.legend(loc="outside lower center")
    figure.savefig(Path(__file__).parent.parent / "natural-information.png", dpi=140)
