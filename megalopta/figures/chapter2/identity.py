"""A straight line, to see how a figure is added."""

import numpy as np
from matplotlib.figure import Figure as Canvas

from megalopta.figures import Figure, FigureRecipe, Run


def _figure(run: Run) -> Figure:
    x = np.linspace(0, 1, 11)

    def draw(canvas: Canvas) -> None:
        axes = canvas.subplots()
        axes.plot(x, x)
        axes.set_xlabel("x")
        axes.set_ylabel("y")

    return Figure("A straight line", "y is x.", draw, {"x": x, "y": x})


RECIPES = (FigureRecipe("identity", _figure),)
