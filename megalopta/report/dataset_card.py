"""`megalopta dataset card`: README.md of a dataset, with statistics and pictures."""

import html
import re
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq

from megalopta import __version__
from megalopta.config.recipe import Plan
from megalopta.core import files
from megalopta.core.bounded import printable
from megalopta.core.errors import UserError
from megalopta.dataset.croissant import table_path
from megalopta.dataset.layout import Tree
from megalopta.dataset.store import LICENSE
from megalopta.plotting.text import number
from megalopta.report.dataset_pictures import draw_statistics, draw_strip
from megalopta.stages.estimate import size

Rows = list[dict[str, Any]]

_SPECIAL = re.compile(r"[\\`*_{}\[\]#|~!$]")
_TEMPLATE = Path(__file__).with_name("dataset_card.md")
"""What the card of every dataset says; braces are filled in."""


def write_card(root: Path) -> Path:
    """Write README.md and its pictures into a dataset; return its path. Raises UserError."""
    plan = Tree(root).plan()
    sequences, exposures = (_rows(root, name) for name in ("sequences", "exposures"))
    if not sequences:
        raise UserError(f"{root}: no finished sequence to show; run megalopta dataset make")
    draw_statistics(root / "card" / "statistics.png", sequences, exposures)
    draw_strip(root, root / "card" / "sequences.png")
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
