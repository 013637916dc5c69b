"""Short clips of a sequence: light, counts, flow and depth."""

import base64
import io
from collections.abc import Iterator, Sequence as Listed
from dataclasses import dataclass

import numpy as np
from PIL import Image

from megalopta.core.errors import UserError
from megalopta.dataset.sequence import Sequence
from megalopta.flow.files.color_wheel import flow_to_rgb
from megalopta.plotting.text import number
from megalopta.report.images import gray_scale, map_scale

_FRAMES = 12
"""Frames of a clip, at most; the first ones of the sequence."""
_FRAME_MS = 120
_COLORS = 64


@dataclass(frozen=True)
class Clip:
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


def clips_of(sequence: Sequence) -> Iterator[Clip]:
    """Clips of the first frames of a sequence."""
    frames = range(min(len(sequence), _FRAMES))
    yield Clip("light", "rendered radiance, exposed for its own light", _light(sequence, frames))
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


def _counts(sequence: Sequence, frames: range) -> Clip:
    counts = sequence.counts()[frames.start : frames.stop].astype(np.float64)
    white = max(float(np.percentile(counts, 99)), 1.0)
    scale = gray_scale(white)
    unit = sequence.counts().unit
    told = f"{sequence.exposures[0]}: black 0, white {number(white)} {unit}"
    return Clip("counts", told, [scale.picture(each) for each in counts])


def _flow(sequence: Sequence, frames: range) -> Clip:
    flows = [sequence.flow(index) for index in frames if index + 1 < len(sequence)]
    speed = np.hypot(*np.moveaxis(np.stack(flows), -1, 0))
    known = speed[~np.isnan(speed)]
    fastest = max(float(np.percentile(known, 99)) if known.size else 0.0, 1e-3)
    told = f"hue is direction (red to the right), full color {number(fastest)} px a frame"
    return Clip("flow", told, [Image.fromarray(flow_to_rgb(each, fastest)) for each in flows])


def _depth(sequence: Sequence, frames: range) -> Clip:
    depths = sequence.depth[frames.start : frames.stop].astype(np.float64)
    depths[np.isinf(depths)] = np.nan
    known = depths[~np.isnan(depths)]
    near, far = np.percentile(known, [1, 99]).tolist() if known.size else (1.0, 2.0)
    far = max(far, near * 1.01)
    scale = map_scale("viridis_r", near, far, logarithmic=True)
    told = f"yellow {number(near)} m to violet {number(far)} m, the sky gray"
    return Clip("depth", told, [scale.picture(each) for each in depths])
