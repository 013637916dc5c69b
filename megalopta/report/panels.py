"""What is seen of a sequence, or of readings: panels, each drawn a frame at a time."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray
from PIL import Image

from megalopta.core.arrays import Floats
from megalopta.core.errors import UserError
from megalopta.dataset.flow_record import FlowRecord
from megalopta.dataset.frames import read_motion
from megalopta.dataset.sequence import Sequence
from megalopta.flow.color_wheel import flow_to_rgb
from megalopta.flow.detectors.blocks import BlockGrid
from megalopta.flow.detectors.registry import METHODS
from megalopta.flow.formats import read_flo
from megalopta.plotting.text import number, short
from megalopta.report.images import ColorScale, gray_scale, map_scale, rgb_picture
from megalopta.report.readings import Readings
from megalopta.report.source import spread
from megalopta.scenes import ToneCurve
from megalopta.scenes.spectra.color import encode_srgb, linear_srgb
from megalopta.sensor import ImageSensor, StoredFrames

MOST_FRAMES = 80
"""Of a page"""
_SAMPLED = 8
"""Frames, spread evenly, that scales of colors are taken from"""
_WHITE_PERCENTILE = 99.0
_GAMMA = 2.2
_SLOWEST = 1e-3
_kept = lru_cache(maxsize=MOST_FRAMES)
"""Page and film draw the same pictures once, where there are no more."""


@dataclass(frozen=True, eq=False)
class Panel:
    """Pictures of one quantity, drawn when they are asked for."""

    name: str
    told: str
    """What its colors mean"""
    picture: Callable[[int], Image.Image]
    """Of a frame, by its number"""
    legend: Markup = field(default=Markup(""))
    note: str = ""
    """Of a special color, for a film, which has no legend"""


def light_panel(sequence: Sequence, frames: range, step: int) -> Panel:
    """Return the light that sensors see, every so many-th pixel of a line.

    Some of the frames give the exposure.
    """
    settings, bands = sequence.configuration, sequence.bands_nm
    white = settings.scene.white(settings.light)

    def linear(frame: int) -> Floats:
        return linear_srgb(sequence.radiance[frame][::step, ::step], bands, white)

    curve = ToneCurve.of(map(linear, spread(frames, _SAMPLED)))
    told = "as a well-lit eye would see it"

    def picture(frame: int) -> Image.Image:
        return rgb_picture(encode_srgb(curve(linear(frame))))

    return Panel("light", told, _kept(picture), Markup(f", {told}"))


def readings_panel(readings: Readings, frames: range, step: int) -> Panel:
    """Return readings as grays, full pixels in orange; some of the frames give the white."""
    sampled = [readings.frame(each) for each in spread(frames, _SAMPLED)]
    white = _white([values for values, _ in sampled], is_inverted=readings.treatment.is_inverted)
    scale = gray_scale(white)

    def picture(frame: int) -> Image.Image:
        values, full = readings.frame(frame)
        values, full = values[::step, ::step], full[::step, ::step]
        return _colored(values, scale) if values.ndim > 2 else scale.picture(values, full)

    is_full = any(full.any() for _, full in sampled)
    unit = "detections" if readings.treatment.is_inverted else readings.unit
    return Panel(
        unit,
        f"black 0, white {number(white)} {unit}",
        _kept(picture),
        scale.legend("0", f"≥ {short(white)} {unit}", "full" if is_full else ""),
        "orange: full pixels" if is_full else "",
    )


def exposure_readings(
    sequence: Sequence, exposure: str | None = None, sensor: ImageSensor | None = None
) -> Readings:
    """Return readings of an exposure of a sequence, by default the first."""
    counts, full = (sequence.counts(exposure, each) for each in ("counts", "saturated"))
    unit = counts.unit.split()[0]
    return Readings(counts.shape, lambda part: (counts[part], full[part]), unit, sensor)


def motion_of(sequence: Sequence, frame: int) -> NDArray[np.floating]:
    """Return the motion from a frame to the next, (H, W, 2), px, NaN where undefined.

    The true one; of pictures, which tell none, what is found in them without noise.
    """
    if not sequence.configuration.scene.has_truth:
        return read_motion(sequence.dataset, frame).flow
    path = sequence.dataset.frame("training/flow", frame, "flo")
    try:
        return read_flo(path)
    except (OSError, ValueError) as problem:
        raise UserError(f"{problem}; make the sequence again") from None


def found_flow(found: StoredFrames, grid: BlockGrid, frame: int) -> Floats:
    """Return the motion that a method found in each block, at all pixels (H, W, 2), px."""
    blocks = np.asarray(found[[min(frame, len(found) - 1)]][0], np.float64)
    flow, size = np.full((*grid.shape, 2), np.nan), grid.block_px
    bottom, right = grid.top + grid.rows * size, grid.left + grid.columns * size
    flow[grid.top : bottom, grid.left : right] = blocks.repeat(size, axis=0).repeat(size, axis=1)
    return flow


def flow_panel(name: str, flow: Callable[[int], NDArray[np.floating]], fastest: float) -> Panel:
    """Return flow (h, w, 2) of frames as colors; the speed `fastest` has the full one."""
    told = f"hue is direction (red to the right), full color {number(fastest)} px a frame"
    return Panel(name, told, _kept(lambda frame: rgb_picture(flow_to_rgb(flow(frame), fastest))))


def fastest_of(flows: Iterable[NDArray[np.floating]]) -> float:
    """Return the speed that has the full color, two digits: all but a hundredth are slower."""
    speed = np.concatenate([np.hypot(*np.moveaxis(each, -1, 0)).ravel() for each in flows])
    known = speed[np.isfinite(speed)]
    fastest = float(np.percentile(known, _WHITE_PERCENTILE)) if known.size else 0.0
    return float(f"{max(fastest, _SLOWEST):.1e}")


def depth_panel(sequence: Sequence, frames: range, step: int) -> Panel:
    """Return depth in logarithmic colors, the sky gray."""

    def depth(frame: int) -> NDArray[np.floating]:
        values = sequence.depth[frame][::step, ::step].astype(np.float64)
        return np.where(np.isinf(values), np.nan, values)

    known = np.concatenate([depth(each).ravel() for each in spread(frames, _SAMPLED)])
    known = known[~np.isnan(known)]
    near, far = np.percentile(known, [1, 99]).tolist() if known.size else (1.0, 2.0)
    far = max(far, near * 1.01)
    scale = map_scale("viridis_r", near, far, logarithmic=True)
    told = f"yellow {number(near)} m to violet {number(far)} m, the sky gray"
    return Panel("depth", told, lambda frame: scale.picture(depth(frame)))


def best_method(records: Iterable[FlowRecord]) -> str | None:
    """Return the method that gives velocities of the least median error, the first without truth.

    None where no method gives velocities.
    """

    def error(record: FlowRecord) -> float:
        found = record.truth.counts.relative_error_median if record.truth else None
        return np.inf if found is None else found

    able = [each for each in records if METHODS[each.method].gives == "velocity"]
    return min(able, key=error).method if able else None


def _white(values: list[Floats], is_inverted: bool) -> float:
    white = float(np.percentile(np.stack(values), _WHITE_PERCENTILE))
    return max(white, 1e-6 if is_inverted else 1.0)


def _colored(values: Floats, scale: ColorScale) -> Image.Image:
    part = np.clip(values / scale.high, 0, 1) ** (1 / _GAMMA)
    return rgb_picture(np.rint(255 * part).astype(np.uint8))
