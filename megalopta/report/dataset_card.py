"""`megalopta dataset card`: README.md of a dataset, with statistics and pictures."""

import html
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from PIL import Image, ImageDraw, ImageFont

from megalopta import __version__
from megalopta.config.recipe import Plan
from megalopta.core import files
from megalopta.core.bounded import printable
from megalopta.core.errors import UserError
from megalopta.core.files import atomic_write
from megalopta.dataset.layout import Tree
from megalopta.dataset.opened import open_dataset
from megalopta.dataset.store import LICENSE
from megalopta.dataset.tables import table_path
from megalopta.plotting.style import BLUE, house_style
from megalopta.plotting.text import number
from megalopta.report.dataset_sheet import clips_of
from megalopta.stages.limits import size

Rows = list[dict[str, Any]]

_BINS, _DECADE = 24, 10
_STRIP, _WIDTH, _GAP, _LINE = 6, 160, 6, 18
_SPECIAL = re.compile(r"[\\`*_{}\[\]#|~!$]")
_TEMPLATE = Path(__file__).with_name("dataset_card.md")
"""What the card of every dataset says; braces are filled in."""


def write_card(root: Path) -> Path:
    """Write README.md and its pictures into a dataset; return its path. Raises UserError."""
    plan = Tree(root).plan()
    sequences, exposures = (_rows(root, name) for name in ("sequences", "exposures"))
    if not sequences:
        raise UserError(f"{root}: no finished sequence to show; run megalopta dataset make")
    _draw_statistics(root / "card" / "statistics.png", sequences, exposures)
    _draw_strip(root, root / "card" / "sequences.png")
    path = root / "README.md"
    files.write_text(path, _text(plan, sequences, exposures))
    return path


def _rows(root: Path, table: str) -> Rows:
    path = table_path(root, table)
    try:
        columns = [name for name in _COLUMNS if name in pq.read_schema(path).names]
        return list(pq.read_table(path, columns=columns).to_pylist())
    except (OSError, ValueError):
        raise UserError(f"{path} is no table of a dataset; run megalopta dataset check") from None


_QUANTITIES = {
    "mean_speed_px": "mean flow, px a frame",
    "percentile_99_speed_px": "99 % of flow below, px a frame",
    "unmatched_fraction": "pixels hidden or out of view in the next frame",
    "sky_fraction": "pixels of sky",
    "median_depth_m": "median depth, m",
    "texture": "texture (difference of neighbors, relative)",
}
_COLUMNS = (
    *("sequence", "split", "frames", "width", "height", "bytes", "scene", "light", "trajectory"),
    *("sensor", "level", "exposure_s", "unit", "photons_per_pixel", "saturated_fraction"),
    *_QUANTITIES,
)


def _text(plan: Plan, sequences: Rows, exposures: Rows) -> str:
    splits = Counter(row["split"] for row in sequences)
    return _TEMPLATE.read_text("utf-8").format(
        name=plain(plan.name),
        description=plain(plan.description),
        version=__version__,
        license=LICENSE,
        sequences=len(sequences),
        frames=sum(row["frames"] for row in sequences),
        bytes=size(sum(row["bytes"] for row in sequences)),
        sizes=", ".join(sorted({f"{row['width']} × {row['height']}" for row in sequences})),
        splits=", ".join(f"`{name}` {splits[name]}" for name in plan.splits),
        sample=plan.sample,
        kinds=_table(("", "sequences"), _kinds(sequences)),
        statistics=_table(("of a sequence", "5 %", "median", "95 %"), _statistics(sequences)),
        exposures=_table(
            ("sensor", "exposure, s", "photons per pixel: 5 %", "median", "95 %", "saturated"),
            _of_sensors(exposures),
        ),
    )


def _kinds(sequences: Rows) -> Iterable[tuple[str, str]]:
    for what in ("scene", "light", "trajectory"):
        for value, count in sorted(Counter(row[what] for row in sequences).items()):
            yield f"{what}: {plain(value)}", str(count)


def _statistics(sequences: Rows) -> Iterable[tuple[str, ...]]:
    for name, meaning in _QUANTITIES.items():
        yield meaning, *_percentiles(row[name] for row in sequences)


def _of_sensors(exposures: Rows) -> Iterable[tuple[str, ...]]:
    for sensor in sorted({row["sensor"] for row in exposures}):
        own = [row for row in exposures if row["sensor"] == sensor]
        times = sorted({row["exposure_s"] for row in own})
        told = " to ".join(f"{each:g}" for each in dict.fromkeys((times[0], times[-1])))
        photons = _percentiles(row["photons_per_pixel"] for row in own)
        full = float(np.mean([row["saturated_fraction"] for row in own]))
        yield plain(sensor), told, *photons, f"{full:.2g}"


def plain(text: object) -> str:
    """Return text of a stranger on one line, of which Markdown and HTML make nothing."""
    line = printable(" ".join(str(text).split()))
    return html.escape(_SPECIAL.sub(r"\\\g<0>", line), quote=False)


def _percentiles(values: Iterable[float | None]) -> tuple[str, str, str]:
    known = [value for value in values if value is not None]
    if not known:
        return "–", "–", "–"
    low, median, high = (number(float(each)) for each in np.percentile(known, (5, 50, 95)))
    return low, median, high


def _table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    lines = [list(head), *([*row] for row in rows)]
    texts = [f"| {' | '.join(line)} |" for line in lines]
    return "\n".join([texts[0], "|---" * len(lines[0]) + "|", *texts[1:]])


def _draw_statistics(path: Path, sequences: Rows, exposures: Rows) -> None:
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
        axes.hist(known, edges.tolist(), color=BLUE)
    if axes.get_xscale() == "linear":
        axes.xaxis.set_major_locator(MaxNLocator(3))
    axes.yaxis.set_major_locator(MaxNLocator(4, integer=True))
    axes.set_xlabel(title)


def _draw_strip(root: Path, path: Path) -> None:
    """Draw light, counts, flow and depth of a few sequences, one above the other."""
    dataset = open_dataset(root)
    names = dataset.names[:: max(1, -(-len(dataset) // _STRIP))]
    columns = [list(clips_of(dataset[name])) for name in names]
    sizes = [_size(clips[0].frames[0]) for clips in columns]
    tallest = max((height for _, height in sizes), default=1)
    whole = len(columns) * (_WIDTH + _GAP) + _GAP, 4 * (tallest + _GAP) + _LINE + _GAP
    sheet = Image.new("RGB", whole, "white")
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(12)
    for column, (name, clips, shape) in enumerate(zip(names, columns, sizes, strict=True)):
        left = _GAP + column * (_WIDTH + _GAP)
        draw.text((left, 2), name, "black", font)
        for row, clip in enumerate(clips):
            picture = clip.frames[0].convert("RGB").resize(shape, Image.Resampling.NEAREST)
            sheet.paste(picture, (left, _LINE + row * (tallest + _GAP)))
    with atomic_write(path) as temporary:
        sheet.save(temporary, "PNG")


def _size(image: Image.Image) -> tuple[int, int]:
    return _WIDTH, max(1, round(_WIDTH * image.height / image.width))
