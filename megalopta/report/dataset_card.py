"""A dataset of many sequences: README.md with statistics, and a page of short films."""

import base64
import html
import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import groupby
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
from markupsafe import Markup
from PIL import Image

from megalopta import __version__
from megalopta.core import files
from megalopta.core.bounded import printable, undamaged
from megalopta.core.errors import UserError
from megalopta.core.progress import progress
from megalopta.core.quantities import number
from megalopta.dataset.index import table_path
from megalopta.dataset.opened import open_dataset
from megalopta.dataset.record import SequenceStatistics
from megalopta.dataset.sequence import Sequence
from megalopta.dataset.store import LICENSE, Tree, exposure_name
from megalopta.report import images
from megalopta.report.panels import Panel, SequencePanels
from megalopta.report.sections import Section, block, captioned, image, write_sections
from megalopta.report.text import level_name
from megalopta.stages.limits import size

SHOWN = 24
"""Default number of sequences of a contact sheet"""
_FRAMES, _FRAME_MS = 12, 120
"""Most frames of a clip, and how long one is shown"""
_STRIP, _WIDTH_PX, _MOST_LEVELS = 6, 160, 12
_SPECIAL = re.compile(r"[\\`*_{}\[\]#|~!$]")


def write_contact_sheet(root: Path, most: int, folder: Path | None = None) -> Path:
    """Write index.html, with clips of `most` sequences, into the dataset or another folder.

    Returns its path. Raises UserError if no sequence is finished.
    """
    dataset = open_dataset(root)
    if not len(dataset):
        raise UserError(f"{root}: no finished sequence to show; run megalopta dataset make")
    names = dataset.names[:: math.ceil(len(dataset) / most)]
    sections = []
    with progress("Drawing clips", len(names), "sequence") as advance:
        for name in names:
            sections.append(_section(dataset[name]))
            advance()
    summary = f"{len(names)} of {len(dataset)} sequences; each clip repeats the first frames."
    return write_sections((folder or root) / "index.html", root.resolve().name, summary, sections)


def _section(sequence: Sequence) -> Section:
    settings, clips = sequence.configuration, []
    for panel in _panels(sequence):
        clip = images.gif([panel.picture(frame) for frame in _first_frames(sequence)], _FRAME_MS)
        source = f"data:image/gif;base64,{base64.b64encode(clip).decode('ascii')}"
        shown = block("pixels", image(source, f"{panel.name} of {sequence.name}"))
        caption = Markup("<b>{}</b>, {}").format(panel.name, panel.caption)
        clips.append(captioned(shown, caption))
    return Section(
        f"{sequence.name} ({sequence.split})",
        f"{settings.scene.kind.replace('_', ' ')} in {level_name(settings.light.level)}; the "
        f"camera {settings.trajectory}; {len(sequence)} frames of {settings.camera.width} × "
        f"{settings.camera.height}",
        body=block("clips", *clips),
    )


def _panels(sequence: Sequence) -> Iterator[Panel]:
    """Yield light, readings, flow and depth of the first frames of a sequence."""
    shown, settings = SequencePanels(sequence, _first_frames(sequence), 1), sequence.configuration
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


def write_card(root: Path) -> Path:
    """Write README.md and its picture into a dataset; return its path. Raises UserError."""
    if not (plan := Tree(root).plan):
        raise UserError(f"{root}: a dataset without a plan; give one of `megalopta dataset make`")
    sequences, exposures = (_rows(root, name) for name in ("sequences", "exposures"))
    if not sequences:
        raise UserError(f"{root}: no finished sequence to show; run megalopta dataset make")
    dataset = open_dataset(root)
    columns = []
    for name in dataset.names[:: math.ceil(len(dataset) / _STRIP)]:
        pictures = [panel.picture(0).convert("RGB") for panel in _panels(dataset[name])]
        height_px = max(1, round(_WIDTH_PX * pictures[0].height / pictures[0].width))
        small_px = _WIDTH_PX, height_px
        small = [picture.resize(small_px, Image.Resampling.NEAREST) for picture in pictures]
        columns.append([*(("", picture) for picture in small[:-1]), (name, small[-1])])
    strip = images.sheet(list(zip(*columns, strict=True))).quantize(256)
    with files.atomic_write(root / "card" / "sequences.png") as temporary:
        strip.save(temporary, "PNG", optimize=True)
    splits = Counter(row["split"] for row in sequences)
    kinds = (
        (f"{name}: {plain_text(value)}", str(count))
        for name in ("scene", "light", "trajectory")
        for value, count in sorted(Counter(row[name] for row in sequences).items())
    )
    statistics = {
        name: " | ".join(_percentiles(row[name] for row in sequences))
        for name in SequenceStatistics.model_fields.keys() - {"exposures"}
    }
    sensors = []
    are_few = len({row["level"] for row in exposures}) <= _MOST_LEVELS
    for (sensor, level), grouped in groupby(
        sorted(exposures, key=itemgetter("sensor", "level")),
        lambda row: (row["sensor"], row["level"] if are_few else "all"),
    ):
        rows = list(grouped)
        times = sorted({row["exposure_s"] for row in rows})
        exposed = " to ".join(f"{time:g}" for time in dict.fromkeys((times[0], times[-1])))
        photons = _percentiles(row["photons_per_pixel"] for row in rows)
        light, snr, saturated = (
            _percentiles(row.get(name) for row in rows)[1]
            for name in ("light_fraction", "snr", "saturated_fraction")
        )
        names = plain_text(sensor), plain_text(level)
        sensors.append((*names, exposed, *photons, light, snr, saturated))
    template = Path(__file__).with_name("dataset_card.md").read_text("utf-8")
    text = template.format(
        name=plain_text(plan.name), description=plain_text(plan.description), version=__version__,
        license=LICENSE, sequences=len(sequences), frames=sum(row["frames"] for row in sequences),
        bytes=size(sum(row["bytes"] for row in sequences)),
        sizes=", ".join(sorted({f"{row['width']} × {row['height']}" for row in sequences})),
        splits=", ".join(f"`{name}` {splits[name]}" for name in plan.splits), sample=plan.sample,
        kinds=_lines(kinds), exposures=_lines(sensors), **statistics,
    )  # fmt: skip
    path = root / "README.md"
    files.write_text(path, text)
    return path


def _rows(root: Path, table: str) -> list[dict[str, Any]]:
    path = table_path(root, table)
    with undamaged(path, "run megalopta check files"):
        return list(pq.read_table(path).to_pylist())


def plain_text(text: object) -> str:
    """Return untrusted text on one line, without Markdown or HTML markup."""
    line = printable(" ".join(str(text).split()))
    return html.escape(_SPECIAL.sub(r"\\\g<0>", line), quote=False)


def _percentiles(values: Iterable[float | None]) -> tuple[str, ...]:
    known = np.array([*values], float)
    if np.isnan(known).all():
        return ("–",) * 3
    return tuple(number(float(value)) for value in np.nanpercentile(known, (5, 50, 95)))


def _lines(rows: Iterable[Iterable[str]]) -> str:
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)
