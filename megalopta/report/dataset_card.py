"""A dataset of many sequences: README.md with statistics, and a page of short films."""

import html
import re
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from PIL import Image

from megalopta import __version__
from megalopta.config.recipe import Plan
from megalopta.core import files
from megalopta.core.bounded import printable, undamaged
from megalopta.core.errors import UserError
from megalopta.core.files import atomic_write
from megalopta.core.progress import progress
from megalopta.dataset.index import table_path
from megalopta.dataset.opened import open_dataset
from megalopta.dataset.sequence import Sequence
from megalopta.dataset.store import LICENSE, Tree, exposure_name
from megalopta.plotting.sections import Section, block, captioned, image, write_sections
from megalopta.plotting.style import BLUE, house_style
from megalopta.plotting.text import level_name, number
from megalopta.report.film import gif_uri
from megalopta.report.images import write_sheet
from megalopta.report.seen import Panel
from megalopta.report.seen_sequence import ShownSequence
from megalopta.stages.limits import size

SHOWN = 24
"""Default number of sequences of a contact sheet"""
_FRAMES = 12
"""Most frames of a clip, from the first frame of the sequence."""
_FRAME_MS = 120


def write_contact_sheet(root: Path, most: int, folder: Path | None = None) -> Path:
    """Write index.html, with clips of `most` sequences, into the dataset or another folder.

    Returns its path. Raises UserError if no sequence is finished.
    """
    dataset = open_dataset(root)
    if not len(dataset):
        raise UserError(f"{root}: no finished sequence to show; run megalopta dataset make")
    names = dataset.names[:: max(1, -(-len(dataset) // most))]
    sections = []
    with progress("Drawing clips", len(names), "sequence") as advance:
        for name in names:
            sections.append(_section(dataset[name]))
            advance()
    summary = f"{len(names)} of {len(dataset)} sequences; each clip repeats the first frames."
    return write_sections((folder or root) / "index.html", root.resolve().name, summary, sections)


def _section(sequence: Sequence) -> Section:
    settings, camera = sequence.configuration, sequence.configuration.camera
    clips = (
        captioned(
            block("pixels", image(_clip(sequence, each), f"{each.name} of {sequence.name}")),
            Markup("<b>{}</b>, {}").format(each.name, each.caption),
        )
        for each in _panels(sequence)
    )
    scene = settings.scene.kind.replace("_", " ")
    return Section(
        f"{sequence.name} ({sequence.split})",
        f"{scene} in {level_name(settings.light.level)}; the camera {settings.trajectory}; "
        f"{len(sequence)} frames of {camera.width} × {camera.height}",
        body=block("clips", *clips),
    )


def _panels(sequence: Sequence) -> Iterator[Panel]:
    """Yield panels of the first frames of a sequence."""
    shown, settings = ShownSequence(sequence, _first_frames(sequence), 1), sequence.configuration
    yield shown.light
    if (name := exposure_name(*settings.exposures[0])) in sequence.exposures:
        readings = shown.readings(*settings.exposures[0])
        yield replace(readings, caption=f"{name}: {readings.caption}")
    yield shown.motion("flow")
    if settings.scene.has_truth:
        yield shown.depth


def _first_frames(sequence: Sequence) -> range:
    """Return the first frames with a next frame, and so with motion, or the only frame."""
    return range(min(max(len(sequence) - 1, 1), _FRAMES))


def _clip(sequence: Sequence, panel: Panel) -> str:
    """Return the data URI of a short film."""
    return gif_uri([panel.picture(each) for each in _first_frames(sequence)], _FRAME_MS)


Rows = list[dict[str, Any]]

_BINS, _DECADE = 24, 10
_STRIP, _WIDTH = 6, 160
_SPECIAL = re.compile(r"[\\`*_{}\[\]#|~!$]")
_TEMPLATE = Path(__file__).with_name("dataset_card.md")
"""Text of the card of every dataset, with fields in braces."""


def write_card(root: Path) -> Path:
    """Write README.md and its pictures into a dataset; return its path. Raises UserError."""
    if not (plan := Tree(root).plan):
        raise UserError(f"{root}: a dataset without a plan; give one of `megalopta dataset make`")
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
    with undamaged(path, "run megalopta check files"):
        columns = [name for name in _COLUMNS if name in pq.read_schema(path).names]
        return list(pq.read_table(path, columns=columns).to_pylist())


_QUANTITIES = {
    "mean_speed_px": "mean flow, px per frame",
    "percentile_99_speed_px": "99th percentile of flow, px per frame",
    "unmatched_fraction": "pixels hidden or out of view in the next frame",
    "sky_fraction": "sky pixels",
    "median_depth_m": "median depth, m",
    "texture": "texture (relative difference of neighbors)",
}
_COLUMNS = (
    *("sequence", "split", "frames", "width", "height", "bytes", "scene", "light", "trajectory"),
    *("sensor", "level", "exposure_s", "unit", "photons_per_pixel", "saturated_fraction"),
    *_QUANTITIES,
)


def _text(plan: Plan, sequences: Rows, exposures: Rows) -> str:
    splits = Counter(row["split"] for row in sequences)
    return _TEMPLATE.read_text("utf-8").format(
        name=plain_text(plan.name),
        description=plain_text(plan.description),
        version=__version__,
        license=LICENSE,
        sequences=len(sequences),
        frames=sum(row["frames"] for row in sequences),
        bytes=size(sum(row["bytes"] for row in sequences)),
        sizes=", ".join(sorted({f"{row['width']} × {row['height']}" for row in sequences})),
        splits=", ".join(f"`{name}` {splits[name]}" for name in plan.splits),
        sample=plan.sample,
        kinds=_table(("", "sequences"), _kinds(sequences)),
        statistics=_table(("per sequence", "5 %", "median", "95 %"), _statistics(sequences)),
        exposures=_table(
            ("sensor", "exposure, s", "photons per pixel: 5 %", "median", "95 %", "saturated"),
            _of_sensors(exposures),
        ),
    )


def _kinds(sequences: Rows) -> Iterable[tuple[str, str]]:
    for what in ("scene", "light", "trajectory"):
        for value, count in sorted(Counter(row[what] for row in sequences).items()):
            yield f"{what}: {plain_text(value)}", str(count)


def _statistics(sequences: Rows) -> Iterable[tuple[str, ...]]:
    for name, meaning in _QUANTITIES.items():
        yield meaning, *_percentiles(row[name] for row in sequences)


def _of_sensors(exposures: Rows) -> Iterable[tuple[str, ...]]:
    for sensor in sorted({row["sensor"] for row in exposures}):
        own = [row for row in exposures if row["sensor"] == sensor]
        times = sorted({row["exposure_s"] for row in own})
        exposed = " to ".join(f"{each:g}" for each in dict.fromkeys((times[0], times[-1])))
        photons = _percentiles(row["photons_per_pixel"] for row in own)
        full = float(np.mean([row["saturated_fraction"] for row in own]))
        yield plain_text(sensor), exposed, *photons, f"{full:.2g}"


def plain_text(text: object) -> str:
    """Return untrusted text on one line, without Markdown or HTML markup."""
    line = printable(" ".join(str(text).split()))
    return html.escape(_SPECIAL.sub(r"\\\g<0>", line), quote=False)


def _percentiles(values: Iterable[float | None]) -> tuple[str, ...]:
    known = np.array([*values], float)
    if np.isnan(known).all():
        return ("–",) * 3
    return tuple(number(float(each)) for each in np.nanpercentile(known, (5, 50, 95)))


def _table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    lines = [list(head), *([*row] for row in rows)]
    texts = [f"| {' | '.join(line)} |" for line in lines]
    return "\n".join([texts[0], "|---" * len(lines[0]) + "|", *texts[1:]])


def _draw_statistics(path: Path, sequences: Rows, exposures: Rows) -> None:
    """Draw histograms of flow, photons, texture and occlusion."""
    panels = (
        ("mean flow (px per frame)", [row["mean_speed_px"] for row in sequences], True),
        ("photons per pixel and exposure", [row["photons_per_pixel"] for row in exposures], True),
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
    axes: Axes, title: str, values: list[float | None], is_logarithmic: bool
) -> None:
    known = np.array(values, float)
    known = known[known > 0] if is_logarithmic else known[np.isfinite(known)]
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
    """Draw light, counts, flow and depth of a few sequences in rows."""
    dataset = open_dataset(root)
    names = dataset.names[:: max(1, -(-len(dataset) // _STRIP))]
    columns = ([_small(each.picture(0)) for each in _panels(dataset[name])] for name in names)
    *rows, last = ([("", each) for each in row] for row in zip(*columns, strict=True))
    named = [(name, each) for name, (_, each) in zip(names, last, strict=True)]
    write_sheet(path, [*rows, named])


def _small(picture: Image.Image) -> Image.Image:
    size = _WIDTH, max(1, round(_WIDTH * picture.height / picture.width))
    return picture.convert("RGB").resize(size, Image.Resampling.NEAREST)
