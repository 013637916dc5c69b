"""Chapter 4, §4.2: what the detectors look at. The grating of Fig. 4.2, the forests of Fig. 4.3."""

from collections.abc import Mapping
from dataclasses import asdict
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import PercentFormatter

from megalopta.assets_gen import generator
from megalopta.assets_gen.dead_leaves_model import dead_leaves
from megalopta.assets_gen.grating import GratingVariant, moving_cycles, sine_grating
from megalopta.benchmark.panoramas import NATURAL_PANORAMAS, ROWS, natural_templates
from megalopta.core.arrays import Floats
from megalopta.flow.stimuli.resizing import resize
from megalopta.flow.stimuli.statistics import ImageStatistics, image_statistics, power_spectrum
from megalopta.plotting.picture import Figure, columns_of
from megalopta.plotting.style import BLACK, DASHES, PALETTE
from megalopta.reproduction.drawing import FigureRecipe, Run
from megalopta.scenes import ToneCurve
from megalopta.scenes.spectra.color import encode_srgb

POOLED, CYCLES = 60, 4.0
"""Of Fig. 4.2."""
_VARIANTS: tuple[GratingVariant, ...] = ("rot", "periodic")
_LEAVES_COLUMNS = 753
_CAPTION = (
    "Four seeded forests in four lights stand in for the photographs of the dissertation, with "
    "their fields of view, in cylindrical projection, where turning the camera shifts columns. "
    "They are shown as sRGB, while templates are linear in light."
)
_STATISTICS = {
    "contrast": "Contrast (σ/mean)",
    "spectrum_slope": "Exponent of the power over frequency",
    "gradient_kurtosis": "Kurtosis of the gradient (3: normal)",
    "flat_share": "Neighbors that differ by less than 1 %",
}


def _figure_4_2(_: Run) -> Figure:
    center = (np.arange(ROWS) + 0.5) / ROWS
    y, x = np.meshgrid(center, center, indexing="ij")
    frames = {
        variant: resize(sine_grating(x, y, 1.0, CYCLES, variant=variant), POOLED)
        for variant in _VARIANTS
    }

    rows, columns = np.indices((POOLED, POOLED))
    return Figure(
        title="Figure 4.2: 2-D sine grating, 4 cycles per frame, 60 × 60 px",
        caption=(
            "The grating is S = 1 + C·sin(2πf·xr)·sin(2πf·yr) in coordinates turned by 45°, with "
            "C = 1 and nearest-neighbor pooling. The dissertation's rotation (rot) moves √2·f "
            "cycles per frame, no whole number, so that a circular shift drags a seam along; the "
            "other variant (periodic) has f cycles and no seam."
        ),
        draw=partial(_draw_4_2, frames=frames),
        numbers={
            "row": rows.ravel(),
            "column": columns.ravel(),
            **{f"brightness_{variant}": frame.ravel() for variant, frame in frames.items()},
        },
    )


def _draw_4_2(canvas: Canvas, frames: Mapping[GratingVariant, Floats]) -> None:
    for axes, (variant, frame) in zip(canvas.subplots(1, 2), frames.items(), strict=True):
        axes.imshow(frame, cmap="gray", vmin=0, vmax=2)
        axes.set_title(f"{variant}: {moving_cycles(CYCLES, variant):.3g} cycles move")
        axes.set(xlabel="Column (px)", ylabel="Row (px)")
        axes.grid(visible=False)


def _figure_4_3(run: Run) -> Figure:
    forests = natural_templates(run.cache)
    leaves = dead_leaves((ROWS, _LEAVES_COLUMNS), generator(1, "figure 4.3"))
    templates = {**forests, "dead leaves": leaves}
    statistics = {name: image_statistics(template) for name, template in templates.items()}

    return Figure(
        title="Figure 4.3: rendered forests in place of photographs",
        caption=_CAPTION,
        printed=_compared(statistics),
        printed_by=("Forests", "Dead leaves"),
        draw=partial(_draw_4_3, forests=forests, templates=templates),
        numbers=columns_of({"template": name, **asdict(each)} for name, each in statistics.items()),
        height_in=11.5,
    )


def _draw_4_3(
    canvas: Canvas, forests: Mapping[str, Floats], templates: Mapping[str, Floats]
) -> None:
    parts = canvas.subfigures(2, 1, height_ratios=[2.9, 1], squeeze=False)
    pictures, numbers = parts[:, 0]
    for letter, axes, (name, template) in zip(
        "abcd", pictures.subplots(4, 1), forests.items(), strict=True
    ):
        axes.imshow(encode_srgb(ToneCurve.of([template])(template)), "gray")
        fov = NATURAL_PANORAMAS[name].frame_fov_deg
        axes.set_title(f"({letter}) {name}, 251 columns cover {fov:g}°", loc="left")
        axes.set_anchor("W")
        axes.set_axis_off()
    spectra, gradients = numbers.subplots(1, 2)
    _draw_spectra(spectra, templates)
    _draw_gradients(gradients, templates)


def _compared(statistics: Mapping[str, ImageStatistics]) -> dict[str, tuple[str, str]]:
    """Return the least and the most of the forests, and the dead leaves, of each statistic."""
    leaves = statistics["dead leaves"]
    table = {}
    for name, what in _STATISTICS.items():
        values = sorted(getattr(statistics[each], name) for each in NATURAL_PANORAMAS)
        spread = f"{values[0]:.2g} to {values[-1]:.2g}", f"{getattr(leaves, name):.2g}"
        table[what] = spread[0].replace("-", "−"), spread[1].replace("-", "−")
    return table


def _draw_spectra(axes: Axes, templates: Mapping[str, Floats]) -> None:
    for index, (name, template) in enumerate(templates.items()):
        axes.loglog(*power_spectrum(template), **_line(index), label=name)
    axes.set(xlabel="Frequency (cycles/px)", ylabel="Power (mean² px²)")
    axes.legend()


def _draw_gradients(axes: Axes, templates: Mapping[str, Floats]) -> None:
    edges = np.linspace(-4, 4, 81)
    for index, template in enumerate(templates.values()):
        gradient = np.diff(template, axis=1, append=template[:, :1])
        share, _ = np.histogram(gradient / gradient.std(), edges)
        axes.semilogy((edges[:-1] + edges[1:]) / 2, share / gradient.size, **_line(index))
    axes.set(xlabel="Gradient along rows (σ)", ylabel="Share of pixels")
    axes.yaxis.set_major_formatter(PercentFormatter(1, decimals=1))


def _line(index: int) -> dict[str, object]:
    color = PALETTE[index] if index < len(NATURAL_PANORAMAS) else BLACK
    return {"color": color, "linestyle": DASHES[index], "linewidth": 1.5}


RECIPES = (
    FigureRecipe("fig-4.2", _figure_4_2),
    FigureRecipe("fig-4.3", _figure_4_3),
)
