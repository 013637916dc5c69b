"""Shot noise: the standard deviation of counts is the root of their mean."""

import numpy as np
from matplotlib.figure import Figure as Canvas

from megalopta.plotting.picture import Figure
from megalopta.reproduction.drawing import FigureRecipe, Run
from megalopta.sensor import expose_rate, preset


def _figure(run: Run) -> Figure:
    sensor, means = preset("ideal"), np.geomspace(1, 1000, 13)
    rates = np.broadcast_to(means[:, None, None] / sensor.exposure_s, (13, 64, 64))
    counts = expose_rate(rates, sensor, seed=0, sequence="shot noise").counts
    deviations = counts.std(axis=(1, 2))

    def draw(canvas: Canvas) -> None:
        axes = canvas.subplots()
        axes.loglog(means, deviations, "o")
        axes.loglog(means, np.sqrt(means))
        axes.set(xlabel="mean counts", ylabel="standard deviation")

    numbers = {"mean": means, "deviation": deviations}
    return Figure("Shot noise", "Drawn: points; root of the mean: line.", draw, numbers)


RECIPES = (FigureRecipe("shot-noise", _figure),)
