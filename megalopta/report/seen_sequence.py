"""View of a dataset of one sequence: panels of its light, readings, motion and depth."""

from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray
from PIL import Image

from megalopta.config.model import LightLevel
from megalopta.core.arrays import Floats
from megalopta.core.bounded import undamaged
from megalopta.dataset.flow_record import FlowRecord
from megalopta.dataset.opened import open_dataset
from megalopta.dataset.picture_light import clean_flow, light_of, photons_per_lux, resized
from megalopta.dataset.sequence import Sequence
from megalopta.dataset.store import Dataset, exposure_name
from megalopta.flow.detectors.blocks import BlockGrid
from megalopta.flow.detectors.registry import METHODS, velocity_method
from megalopta.flow.formats import read_flo
from megalopta.plotting.text import level_name, number
from megalopta.report.images import evenly_spaced, fastest_of, map_scale, rgb_picture
from megalopta.report.readings import ShownReadings, Treatment
from megalopta.report.seen import (
    SAMPLED,
    Exposed,
    Panel,
    Seen,
    flow_panel,
    kept,
    readings_panel,
    step_of,
)
from megalopta.report.source import finished_stages, read_records, title
from megalopta.scenes import Pictures, ToneCurve
from megalopta.scenes.lighting.levels import illuminance_of
from megalopta.scenes.spectra.color import encode_srgb, linear_srgb
from megalopta.sensor import ImageSensor, StoredFrames
from megalopta.stages.flow import responses_path
from megalopta.stages.ledger import Ledger

_CAVEAT = " Their true motion is unknown; the flow of the clean pictures is a stand-in for it."


def seen_sequence(root: Path, treatment: Treatment) -> Seen:
    """Return the view of a dataset of one sequence, with its finished stages.

    Raises UserError if it is damaged, not rendered yet, or does not allow the treatment.
    """
    sequence = open_dataset(root)[0]
    name, caveat = "flow of the clean pictures", _CAVEAT
    if sequence.configuration.scene.has_truth:
        Ledger(sequence.dataset).require("render")
        name, caveat = "true flow", ""
    # the last frame has no next frame, and so no motion
    end = min(len(sequence) - 1, len(sequence) - treatment.summed + 1)
    (height, width), step = sequence.shape, step_of(sequence.shape)
    frames = range(0, max(end, 1), treatment.summed)
    motion = partial(motion_of, sequence, step=step)
    rim = fastest_of(map(motion, evenly_spaced(frames, SAMPLED))) if len(sequence) > 1 else None
    return Seen(
        title=title(sequence.configuration),
        summary=f"{len(sequence)} frames of {width} × {height} pixels.{caveat}",
        shape=sequence.shape,
        frames=frames,
        step=step,
        times_s=sequence.times_s,
        treatment=treatment,
        light=light_panel(sequence, frames, step),
        exposed=tuple(_exposures(sequence, treatment, frames, rim)),
        motion=flow_panel(name, motion, rim) if rim else None,
        rim=rim,
        sequence=sequence,
    )


def _exposures(
    sequence: Sequence, treatment: Treatment, frames: range, rim: float | None
) -> Iterator[Exposed]:
    """Yield readings of all sensors, the darkest light first, with the best flow from them."""
    dataset, finished = sequence.dataset, finished_stages(Ledger(sequence.dataset))
    pairs = sequence.configuration.exposures if "sense" in finished else ()
    records = read_records(dataset) if "flow" in finished else []
    step = step_of(sequence.shape)
    for sensor, level in sorted(pairs, key=lambda pair: illuminance_of(pair[1])):
        readings = exposure_readings(sequence, exposure_name(sensor, level), sensor)
        drawn = readings_panel(readings.treated(treatment), frames, step)
        found = best_flow(dataset, records, sensor, level, step)
        flow = flow_panel(f"flow by {found[0]}", found[1], rim) if found and rim else None
        yield Exposed(drawn, flow, sensor.name, _level(sequence, level))


def _level(sequence: Sequence, level: LightLevel) -> str:
    """Return the name of a level; for pictures, with the photons of the first sensor."""
    settings = sequence.configuration
    if not isinstance(settings.scene, Pictures):
        return level_name(level)
    mean, bands = sequence.dataset.read_scene_record()["pictures"]["mean"], settings.render.bands_nm
    sensor = settings.sensors[0]
    per_lux = photons_per_lux(settings.scene, settings.light, bands, sensor, mean)
    return f"{level_name(level)}, {number(per_lux * illuminance_of(level))} photons"


FlowOf: TypeAlias = Callable[[int], NDArray[Any]]
"""Flow (h, w, 2) of a frame, px"""


def light_panel(sequence: Sequence, frames: range, step: int) -> Panel:
    """Return the light that sensors see, every `step`-th pixel of a line.

    Some of the frames set the exposure.
    """
    settings, bands = sequence.configuration, sequence.bands_nm
    white = settings.scene.white(settings.light)

    def linear(frame: int) -> Floats:
        return linear_srgb(sequence.radiance[frame][::step, ::step], bands, white)

    curve = ToneCurve.of(map(linear, evenly_spaced(frames, SAMPLED)))
    caption = "as the eye would see it in bright light"

    def picture(frame: int) -> Image.Image:
        return rgb_picture(encode_srgb(curve(linear(frame))))

    return Panel("light", caption, kept(picture), Markup(f", {caption}"))


def exposure_readings(
    sequence: Sequence, exposure: str | None = None, sensor: ImageSensor | None = None
) -> ShownReadings:
    """Return readings of an exposure of a sequence, by default the first."""
    counts, full = (sequence.counts(exposure, each) for each in ("counts", "saturated"))
    unit = counts.unit.split()[0]
    return ShownReadings(counts.shape, lambda part: (counts[part], full[part]), unit, sensor)


def motion_of(sequence: Sequence, frame: int, step: int) -> NDArray[np.floating]:
    """Return the motion from a frame to the next, px, NaN where undefined.

    (h, w, 2), of every `step`-th pixel of a line: the true motion; for pictures, whose true motion
    is unknown, the flow between the noise-free pictures, reduced by `step`.
    """
    if not sequence.configuration.scene.has_truth:
        frames, (rows, columns) = light_of(sequence.dataset).frames, sequence.shape
        small = -(-rows // step), -(-columns // step)
        first, second = (resized(frames.at(each), small) for each in (frame, frame + 1))
        return step * clean_flow(first, second)
    path = sequence.dataset.frame("training/flow", frame)
    with undamaged(path, "regenerate the sequence"):
        return read_flo(path)[::step, ::step]


def best_flow(
    dataset: Dataset,
    records: Iterable[FlowRecord],
    sensor: ImageSensor,
    level: LightLevel,
    step: int,
) -> tuple[str, FlowOf] | None:
    """Return the best method on an exposure and its flow, of every `step`-th pixel of a line.

    None if no velocity method ran. Raises UserError if its responses cannot be read.
    """
    own = [each for each in records if (each.sensor, each.level) == (sensor.name, level)]
    method = _best_method(own)
    if method is None:
        return None
    path = responses_path(dataset, sensor, level)
    with undamaged(path, "run flow again"):
        stored = StoredFrames.open(path, method)
    grid = velocity_method(method).grid(dataset.configuration.camera.shape)
    return method, lambda frame: _found_flow(stored, grid, frame)[::step, ::step]


def _found_flow(found: StoredFrames, grid: BlockGrid, frame: int) -> Floats:
    """Return a method's motion of each block at all pixels (H, W, 2), px."""
    stored: Any = found.array  # NaN where a block has no velocity
    blocks = np.asarray(stored[min(frame, len(found) - 1)], np.float64)
    flow, size = np.full((*grid.shape, 2), np.nan), grid.block_px
    bottom, right = grid.top + grid.rows * size, grid.left + grid.columns * size
    flow[grid.top : bottom, grid.left : right] = blocks.repeat(size, axis=0).repeat(size, axis=1)
    return flow


def depth_panel(sequence: Sequence, frames: range, step: int) -> Panel:
    """Return depth in logarithmic colors, the sky gray."""

    def depth(frame: int) -> NDArray[np.floating]:
        values = sequence.depth[frame][::step, ::step].astype(np.float64)
        return np.where(np.isinf(values), np.nan, values)

    known = np.concatenate([depth(each).ravel() for each in evenly_spaced(frames, SAMPLED)])
    known = known[~np.isnan(known)]
    near, far = np.percentile(known, [1, 99]).tolist() if known.size else (1.0, 2.0)
    far = max(far, near * 1.01)
    scale = map_scale("viridis_r", near, far, logarithmic=True)
    caption = f"yellow {number(near)} m to violet {number(far)} m, the sky gray"
    return Panel("depth", caption, lambda frame: scale.picture(depth(frame)))


def _best_method(records: Iterable[FlowRecord]) -> str | None:
    """Return the velocity method of least median error, the first one without truth.

    None if no method gives velocities.
    """
    able = [each for each in records if METHODS[each.method].gives == "velocity"]
    return min(able, key=lambda each: each.median_error).method if able else None
