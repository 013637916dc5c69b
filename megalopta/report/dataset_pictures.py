"""Pictures of the card: histograms over the sequences, and frames of a few of them."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from PIL import Image, ImageDraw, ImageFont

from megalopta.core.files import atomic_write
from megalopta.dataset.opened import open_dataset
from megalopta.plotting.style import BLUE, house_style
from megalopta.report.dataset_sheet import clips_of

_BINS, _DECADE = 24, 10
_STRIP, _WIDTH, _GAP, _LINE = 6, 160, 6, 18
Rows = list[dict[str, Any]]


def draw_statistics(path: Path, sequences: Rows, exposures: Rows) -> None:
    """Draw histograms of flow, photons, texture and occlusion."""
    panels = (
        ("mean flow (px a frame)", [row["mean_speed_px"] for row in sequences], True),
        ("photons per pixel, an exposure", [row["photons_per_pixel"] for row in exposures], True),
        ("texture, relative", [row["texture"] for row in sequences], True),
        ("hidden or out of view", [row["unmatched_fraction"] for row in sequences], False),
    )
    with house_style(), atomic_write(path) as temporary:
        canvas = Figure(figsize=(9, 2.2), layout="constrained")
        for axes, panel in zip(canvas.subplots(1, 4), panels, strict=True):
            _draw_histogram(axes, *panel)
        canvas.axes[0].set_ylabel("how many")
        canvas.savefig(temporary, dpi=150)


def _draw_histogram(
    axes: Axes, title: str, values: Sequence[float | None], is_logarithmic: bool
) -> None:
    known = np.array([value for value in values if value is not None], dtype=float)
    known = known[known > 0] if is_logarithmic else known
    if known.size:
        low, high = known.min(), known.max()
        edges = np.linspace(0, max(1.02 * high, 1e-3), _BINS)
        if is_logarithmic and high > _DECADE * low:
            edges = np.geomspace(low / 1.1, high * 1.1, _BINS)
            axes.set_xscale("log")
        axes.hist(known, edges, color=BLUE)
    if axes.get_xscale() == "linear":
        axes.xaxis.set_major_locator(MaxNLocator(3))
    axes.yaxis.set_major_locator(MaxNLocator(4, integer=True))
    axes.set_xlabel(title)


def draw_strip(root: Path, path: Path) -> None:
    """Draw light, counts, flow and depth of a few sequences, one above the other."""
    dataset = open_dataset(root)
    names = dataset.names[:: max(1, -(-len(dataset) // _STRIP))]
    columns = [list(clips_of(dataset[name])) for name in names]
    sizes = [_size(clips[0].frames[0]) for clips in columns]
    tallest = max((height for _, height in sizes), default=1)
    whole = len(columns) * (_WIDTH + _GAP) + _GAP, 4 * (tallest + _GAP) + _LINE + _GAP
    sheet = Image.new("RGB", whole, "white")
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(12)
    for column, (name, clips, size) in enumerate(zip(names, columns, sizes, strict=True)):
        left = _GAP + column * (_WIDTH + _GAP)
        draw.text((left, 2), name, "black", font)
        for row, clip in enumerate(clips):
            picture = clip.frames[0].convert("RGB").resize(size, Image.Resampling.NEAREST)
            sheet.paste(picture, (left, _LINE + row * (tallest + _GAP)))
    with atomic_write(path) as temporary:
        sheet.save(temporary, "PNG")


def _size(image: Image.Image) -> tuple[int, int]:
    return _WIDTH, max(1, round(_WIDTH * image.height / image.width))
