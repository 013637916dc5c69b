"""Chapter 4, §4.2: the detectors' scenes, and their information on motion per photon.

The Poisson bound (`flow.translation_bound`) sums J = (∂λ/∂x)²/λ over a block. Per pixel, at one
photon per pixel, it depends on the picture and on dark counts. The variances 1/J of the bound are
averaged over the blocks. The inverse of their mean predicts the photons that a method needs better
than contrast, which is dominated by a few bright spots in few blocks, and better than the median
block.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import partial
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import PercentFormatter

from megalopta.assets_gen import generator
from megalopta.assets_gen.dead_leaves_model import dead_leaves
from megalopta.assets_gen.grating import GratingVariant, moving_cycles, sine_grating
from megalopta.benchmark.panoramas import NATURAL_PANORAMAS, ROWS, natural_templates
from megalopta.benchmark.runner import Results
from megalopta.benchmark.trial import PanoramaTemplate, Template, Trial
from megalopta.core.arrays import Floats
from megalopta.flow.detectors.blocks import block_grid
from megalopta.flow.metrics.translation_bound import fisher_information
from megalopta.flow.stimuli.moving_template import MovingTemplate
from megalopta.flow.stimuli.resizing import resize
from megalopta.flow.stimuli.statistics import ImageStatistics, image_statistics, power_spectrum
from megalopta.plotting.picture import Figure, columns_of
from megalopta.plotting.style import BLACK, DASHES, PALETTE, draw_key, log_decades, method_style
from megalopta.reproduction.chapter4_curves import PHOTOGRAPHED, SWEEPS, in_form, span
from megalopta.reproduction.chapter4_table import PRINTED, SIZE
from megalopta.reproduction.drawing import FigureRecipe, Run, Templates
from megalopta.reproduction.sweep_figure import threshold_of
from megalopta.scenes import ToneCurve
from megalopta.scenes.spectra.color import encode_srgb

POOLED, CYCLES = 60, 4.0
"""Parameters of Fig. 4.2."""
_VARIANTS: tuple[GratingVariant, ...] = ("rot", "periodic")
_LEAVES_COLUMNS = 753
_CAPTION = (
    "Four seeded forests in four lights replace the photographs of the dissertation, with their "
    "fields of view, in cylindrical projection, where a camera rotation shifts columns. They are "
    "shown as sRGB; templates are linear in light."
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
            "C = 1 and nearest-neighbor pooling. The dissertation's rotation (rot) has √2·f "
            "cycles per frame, not a whole number, so a circular shift moves a seam along; the "
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
    """Return the range over the forests, and the dead leaves, of each statistic."""
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


_SOURCES = (PHOTOGRAPHED, SWEEPS["fig-4.11"])
_COLUMNS_APART = 25
_ALIKE = ("BM", "NDM", "NDS")
_NEED_CAPTION = (
    f"Points: least photons per frame of {SIZE} × {SIZE} px, over all velocities, against the "
    "information on motion along x per photon: the harmonic mean over blocks of (∂λ/∂x)²/λ at "
    "one photon per pixel, with dark counts. Lines: inverse proportionality through the gray "
    "values. Stars: where they meet the printed thresholds."
)
_KEY = (
    ("o", BLACK, "forests, gray values"),
    ("o", "none", "forests, light"),
    ("*", BLACK, "dissertation"),
)


class Need(NamedTuple):
    """Photons that one method needs for one picture."""

    method: str
    picture: str
    coding: str
    information: float
    """px⁻² per photon"""

    photons: float
    """Photons per frame, at the velocity where they are fewest"""


def information_per_photon(template: Floats, dark_share: float = 0.0) -> float:
    """Return the information on motion along x in 60 × 60 frames, the harmonic mean of the blocks.

    In px⁻² per pixel at one photon per pixel, for a full turn (251, m) with `dark_share` dark
    counts per photon; 0 if a block has no gradient.
    """
    grid = block_grid((SIZE, SIZE))
    turning = MovingTemplate(template, _COLUMNS_APART, SIZE)
    frames = turning.light(0, template.shape[1] // _COLUMNS_APART) * SIZE**2 + dark_share
    along_x = [fisher_information(frame, grid)[1:-1, 1:-1, 0, 0] for frame in frames]
    with np.errstate(divide="ignore"):
        return float(1 / np.mean(1 / np.array(along_x))) / grid.block_px**2


def implied_information(seen: Sequence[Need], printed: float) -> float:
    """Return the information of a picture for which a method needs the printed photons.

    Thresholds are inverse to it, at the (geometric) mean of the given pictures.
    """
    products = [each.information * each.photons for each in seen]
    return float(np.exp(np.mean(np.log(products)))) / printed


def _trials(is_quick: bool) -> list[Trial]:
    sweeps = (in_form(sweep, is_quick) for sweep in _SOURCES)
    return [point.trial for sweep in sweeps for point in sweep.points if point.size == SIZE]


def needed_of(method: str, trials: Sequence[Trial], results: Results, templates: Templates) -> Need:
    """Return the photons that a method needs for the common picture of these trials."""
    template = trials[0].template
    assert isinstance(template, PanoramaTemplate)
    found = [threshold_of(results, trial, method, "literal", 2).flux for trial in trials]
    photons = min((flux for flux in found if flux is not None), default=math.nan)
    information = math.nan
    if photons > 0:
        dark_counts = trials[0].search.dark_counts * ROWS**2
        information = information_per_photon(templates[template], dark_counts / photons)
    return Need(method, template.name, template.coding, information, photons)


def explained(seen: Sequence[Need], stars: Mapping[str, float]) -> dict[str, tuple[str, str]]:
    """Return the variation of photons with pictures, and information implied by printed values."""
    gray = {method: _of(seen, method, "srgb") for method in PRINTED}
    ranges = [_quotient([each.photons for each in own]) for own in gray.values()]
    spreads = [
        _quotient([each.information * each.photons for each in own]) for own in gray.values()
    ]
    shares = [
        stars[method] / each.information
        for method in _ALIKE
        for each in gray[method]
        if each.picture == "open"
    ]
    iia = stars["IIA"] / math.exp(np.mean([math.log(stars[method]) for method in _ALIKE]))
    found = {
        "Photons, most over least picture (gray values)": span(ranges),
        "Photons times information, the same": span(spreads),
        "Information implied by BM, NDM, NDS over forest open": span(shares),
        "Information implied by IIA over theirs": span([iia]),
    }
    return {what: (text, "—") for what, text in found.items()}


def _of(seen: Sequence[Need], method: str, coding: str) -> list[Need]:
    return [each for each in seen if (each.method, each.coding) == (method, coding)]


def _quotient(values: Sequence[float]) -> float:
    return max(values) / min(values) if values else math.nan


def _information(run: Run) -> Figure:
    pictures: dict[Template, list[Trial]] = {}
    for trial in _trials(run.is_quick):
        pictures.setdefault(trial.template, []).append(trial)
    seen = [
        needed_of(method, trials, run.results, run.templates)
        for trials in pictures.values()
        for method in PRINTED
    ]
    stars = {
        method: implied_information(_of(seen, method, "srgb"), printed)
        for method, (_, printed) in PRINTED.items()
    }
    printed = [
        Need(method, "dissertation", "", stars[method], natural)
        for method, (_, natural) in PRINTED.items()
    ]
    columns = ("method", "picture", "coding", "information_per_photon", "photons_per_frame")
    return Figure(
        title="Photons needed over the information in a natural picture",
        caption=_NEED_CAPTION,
        draw=partial(_draw, seen=seen, stars=stars),
        numbers=dict(zip(columns, zip(*seen, *printed, strict=True), strict=True)),
        height_in=4.2,
        printed=explained(seen, stars),
    )


def _draw(canvas: Canvas, seen: Sequence[Need], stars: Mapping[str, float]) -> None:
    axes = canvas.subplots()
    right = max(each.information for each in seen)
    for method, (_, printed) in PRINTED.items():
        style = method_style(method) | {"linestyle": "none"}
        for coding, face, label in (("srgb", style["color"], method), ("linear", "none", None)):
            *_, information, photons = zip(*_of(seen, method, coding), strict=True)
            axes.plot(information, photons, **style, markerfacecolor=face, label=label)
        ends = np.array([stars[method], right])
        axes.plot(ends, printed * ends[0] / ends, color=style["color"], linewidth=1)
        axes.plot(ends[0], printed, "*", color=style["color"], markersize=14)
    draw_key(axes, _KEY)
    log_decades(axes, "x", "{x:g}")
    log_decades(axes, "y")
    axes.set_xlabel("Information on motion (px$^{-2}$ per photon)")
    axes.set_ylabel("Least $N_{2b}$ (photons per frame)")
    canvas.legend(loc="outside right center")


RECIPES = (
    FigureRecipe("fig-4.2", _figure_4_2),
    FigureRecipe("fig-4.3", _figure_4_3),
    FigureRecipe("natural-information", _information, _trials),
)
