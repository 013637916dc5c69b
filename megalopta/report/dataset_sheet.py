"""`megalopta dataset view`: a contact sheet, with short clips of light, counts, flow and depth."""

import base64
import io
from collections.abc import Iterator, Sequence as Listed
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from markupsafe import Markup
from PIL import Image

from megalopta.core.errors import UserError
from megalopta.core.progress import progress
from megalopta.dataset.opened import open_dataset
from megalopta.dataset.sequence import Sequence
from megalopta.flow.color_wheel import flow_to_rgb
from megalopta.plotting.sections import Section, block, captioned, image, write_sections
from megalopta.plotting.text import level_name, number
from megalopta.report.images import gray_scale, map_scale

_FRAMES = 12
"""Frames of a clip, at most; the first ones of the sequence."""
_FRAME_MS = 120
_COLORS = 64


@dataclass(frozen=True)
class ShortClip:
    """Successive pictures, and what they show."""

    name: str
    scale: str
    """What its colors mean"""
    frames: Listed[Image.Image]

    @property
    def gif(self) -> str:
        """Data URI of a GIF that repeats."""
        data = io.BytesIO()
        reduced = [each.convert("RGB").quantize(_COLORS) for each in self.frames]
        reduced[0].save(
            data, "GIF", save_all=True, append_images=reduced[1:], duration=_FRAME_MS, loop=0
        )
        return f"data:image/gif;base64,{base64.b64encode(data.getvalue()).decode('ascii')}"


def write_view(root: Path, most: int) -> Path:
    """Write index.html into a dataset, with clips of so many sequences; return its path.

    Raises UserError where no sequence is finished.
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
    write_sections(root / "index.html", root.resolve().name, summary, sections)
    return root / "index.html"


def _section(sequence: Sequence) -> Section:
    settings, camera = sequence.configuration, sequence.configuration.camera
    clips = (
        captioned(
            block("pixels", image(clip.gif, f"{clip.name} of sequence {sequence.name}")),
            Markup("<b>{}</b>, {}").format(clip.name, clip.scale),
        )
        for clip in clips_of(sequence)
    )
    scene = settings.scene.kind.replace("_", " ")
    return Section(
        f"{sequence.name} ({sequence.split})",
        f"{scene} in {level_name(settings.light.level)}; the camera {settings.trajectory}; "
        f"{len(sequence)} frames of {camera.width} × {camera.height}",
        charts=tuple(clips),
    )


def clips_of(sequence: Sequence) -> Iterator[ShortClip]:
    """Yield clips of the first frames of a sequence."""
    frames = range(min(len(sequence), _FRAMES))
    yield ShortClip(
        "light", "rendered radiance, exposed for its own light", _light(sequence, frames)
    )
    yield _counts(sequence, frames)
    yield _flow(sequence, frames)
    yield _depth(sequence, frames)


def _light(sequence: Sequence, frames: range) -> list[Image.Image]:
    found = []
    for index in frames:
        path = sequence.dataset.frame("training/clean", index, "png")
        try:
            with Image.open(path) as image:
                found.append(image.convert("RGB"))
        except (OSError, ValueError, SyntaxError, Image.DecompressionBombError):
            raise UserError(f"{path} is missing or no picture; make the sequence again") from None
    return found


def _counts(sequence: Sequence, frames: range) -> ShortClip:
    counts = sequence.counts()[frames.start : frames.stop].astype(np.float64)
    white = max(float(np.percentile(counts, 99)), 1.0)
    scale = gray_scale(white)
    unit = sequence.counts().unit
    told = f"{sequence.exposures[0]}: black 0, white {number(white)} {unit}"
    return ShortClip("counts", told, [scale.picture(each) for each in counts])


def _flow(sequence: Sequence, frames: range) -> ShortClip:
    flows = [sequence.flow(index) for index in frames if index + 1 < len(sequence)]
    speed = np.hypot(*np.moveaxis(np.stack(flows), -1, 0))
    known = speed[~np.isnan(speed)]
    fastest = max(float(np.percentile(known, 99)) if known.size else 0.0, 1e-3)
    told = f"hue is direction (red to the right), full color {number(fastest)} px a frame"
    return ShortClip("flow", told, [Image.fromarray(flow_to_rgb(each, fastest)) for each in flows])


def _depth(sequence: Sequence, frames: range) -> ShortClip:
    depths = sequence.depth[frames.start : frames.stop].astype(np.float64)
    depths[np.isinf(depths)] = np.nan
    known = depths[~np.isnan(depths)]
    near, far = np.percentile(known, [1, 99]).tolist() if known.size else (1.0, 2.0)
    far = max(far, near * 1.01)
    scale = map_scale("viridis_r", near, far, logarithmic=True)
    told = f"yellow {number(near)} m to violet {number(far)} m, the sky gray"
    return ShortClip("depth", told, [scale.picture(each) for each in depths])
