"""Panels of a sequence of a dataset: its light, readings, motion and depth; and the view of one."""

from collections.abc import Callable, Iterable, Iterator, Sequence as Listed
from dataclasses import replace
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray
from PIL import Image
from pydantic import TypeAdapter
from pydantic_core import from_json

from megalopta.config.model import LightLevel, level_text
from megalopta.core import bounded
from megalopta.core.arrays import Floats
from megalopta.core.bounded import undamaged
from megalopta.core.errors import UserError, shell_command
from megalopta.core.progress import say
from megalopta.dataset.flow_record import FlowRecord
from megalopta.dataset.opened import open_dataset
from megalopta.dataset.picture_light import clean_flow, light_of, photons_per_lux, resized
from megalopta.dataset.sequence import Sequence
from megalopta.dataset.store import exposure_name
from megalopta.flow.detectors.blocks import BlockGrid
from megalopta.flow.detectors.registry import METHODS, velocity_method
from megalopta.flow.formats import read_flo
from megalopta.plotting.text import level_name, number, title
from megalopta.report.images import evenly_spaced, fastest_of, map_scale, rgb_picture
from megalopta.report.readings import ShownReadings, Treatment
from megalopta.report.seen import (
    SAMPLED,
    WHITE_PERCENTILE,
    Panel,
    Seen,
    film_of,
    flow_panel,
    kept,
    readings_panel,
    step_of,
)
from megalopta.scenes import Pictures, ToneCurve
from megalopta.scenes.levels import illuminance_of
from megalopta.scenes.spectra.color import encode_srgb, linear_srgb
from megalopta.sensor import ImageSensor, StoredFrames
from megalopta.stages.flow import responses_path
from megalopta.stages.registry import STAGES
from megalopta.stages.run import finished, has_output, require

_Read = TypeVar("_Read")
_FLOW = TypeAdapter(list[FlowRecord])
_CAVEAT = " Their true motion is unknown; the flow of the clean pictures is a stand-in for it."


def seen_sequence(root: Path, treatment: Treatment) -> Seen:
    """Return the view of a dataset of one sequence, with its finished stages.

    Raises UserError if it is damaged, not rendered yet, or does not allow the treatment.
    """
    sequence = open_dataset(root)[0]
    if sequence.configuration.scene.has_truth:
        require(sequence.dataset, "render")
    # the last frame has no next frame, and so no motion
    end = min(len(sequence) - 1, len(sequence) - treatment.summed + 1)
    frames, (height, width) = range(0, max(end, 1), treatment.summed), sequence.shape
    shown = ShownSequence(sequence, frames, step_of(sequence.shape), treatment)
    caveat = "" if sequence.configuration.scene.has_truth else _CAVEAT
    return Seen(
        title=title(sequence.configuration),
        summary=f"{len(sequence)} frames of {width} × {height} pixels.{caveat}",
        shape=sequence.shape,
        frames=frames,
        step=shown.step,
        times_s=sequence.times_s,
        treatment=treatment,
        panels=tuple(_panels(shown)),
        rim=shown.rim,
        sequence=sequence,
    )


def _panels(shown: "ShownSequence") -> Iterator[Panel]:
    """Yield the panels of all finished stages, the darkest light of a sensor first."""
    settings = shown.sequence.configuration
    exposures = settings.exposures if "sense" in shown.finished else ()
    pairs = sorted(exposures, key=lambda pair: illuminance_of(pair[1]))
    name = "true flow" if settings.scene.has_truth else "flow of the clean pictures"
    yield shown.light
    yield from (shown.readings(*pair) for pair in pairs)
    yield from filter(None, (shown.found_flow(*pair) for pair in pairs))
    if shown.rim:
        yield shown.motion(name)


class ShownSequence:
    """Finished stages of a sequence, and panels of some frames, every `step`-th pixel of a line.

    Eight of the frames set the scales of colors. Raises UserError on use of what is damaged.
    """

    white_percentile = WHITE_PERCENTILE

    def __init__(
        self,
        sequence: Sequence,
        frames: Listed[int],
        step: int,
        treatment: Treatment | None = None,
    ) -> None:
        self.sequence, self.frames, self.step = sequence, frames, step
        self._treatment, self._sampled = treatment or Treatment(), evenly_spaced(frames, SAMPLED)

    @cached_property
    def finished(self) -> list[str]:
        """Finished stages; unfinished output, which is not shown, is reported."""
        dataset = self.sequence.dataset
        stages = finished(dataset)
        for stage in STAGES:
            if stage not in stages and has_output(dataset, stage):
                what = f"{dataset.root}: stage {stage!r}"
                say(f"{what} is not finished with this configuration, and not shown")
        return stages

    @cached_property
    def records(self) -> list[FlowRecord]:
        """Errors of every method on every exposure, in the dataset's order; none without flow.

        Raises UserError if flow.json is damaged or incomplete.
        """
        if "flow" not in self.finished:
            return []
        dataset, settings = self.sequence.dataset, self.sequence.configuration
        path = dataset.result("flow.json")
        remedy = f"run: {shell_command('flow', dataset.root, '--redo')}"
        found = checked_json(path, _FLOW.validate_python, remedy)
        records = {(each.sensor, each.level, each.method): each for each in found}
        expected = list(product(settings.sensors, settings.light_levels, settings.methods))
        for sensor, level, method in expected:
            own = records.get((sensor.name, level, method))
            if not own or (METHODS[method].gives == "velocity" and not own.truth):
                raise UserError(
                    f"{path} lacks the errors of {method} on {sensor.name} at {level_text(level)}; "
                    f"{remedy}"
                )
        return [records[sensor.name, level, method] for sensor, level, method in expected]

    @cached_property
    def rim(self) -> float | None:
        """Speed of the full color, px per frame; None without a second frame."""
        has_motion = len(self.sequence) > 1
        return fastest_of(map(self.motion_of, self._sampled)) if has_motion else None

    @cached_property
    def light(self) -> Panel:
        """Light that sensors see."""
        settings, bands = self.sequence.configuration, self.sequence.bands_nm
        white = settings.scene.white(settings.light)

        def linear(frame: int) -> Floats:
            return linear_srgb(self.pixels(self.sequence.radiance[frame]), bands, white)

        curve = ToneCurve.of(map(linear, self._sampled))
        caption = "as the eye would see it in bright light"

        def picture(frame: int) -> Image.Image:
            return rgb_picture(encode_srgb(curve(linear(frame))))

        return Panel("light", "light", caption, kept(picture), Markup(f", {caption}"))

    def readings(self, sensor: ImageSensor, level: LightLevel) -> Panel:
        """Return the readings of a sensor. Raises UserError if they cannot be treated as asked."""
        name = exposure_name(sensor, level)
        counts, full = (self.sequence.counts(name, each) for each in ("counts", "saturated"))
        unit = counts.unit.split()[0]
        found = ShownReadings(counts.shape, lambda part: (counts[part], full[part]), unit, sensor)
        treated, white = found.treated(self._treatment), self.white_percentile
        panel = readings_panel(treated, self.frames, self.step, white)
        return replace(panel, sensor=sensor.name, level=self._level(level))

    def found_flow(self, sensor: ImageSensor, level: LightLevel) -> Panel | None:
        """Return the flow by the best method on an exposure; None if no velocity method ran."""
        own = [each for each in self.records if (each.sensor, each.level) == (sensor.name, level)]
        method = _best_method(own)
        if method is None or self.rim is None:
            return None
        path = responses_path(self.sequence.dataset, sensor, level)
        with undamaged(path, "run flow again"):
            stored = StoredFrames.open(path, method)
        grid = velocity_method(method).grid(self.sequence.shape)

        def flow(frame: int) -> Floats:
            return self.pixels(_found_flow(stored, grid, frame))

        panel = flow_panel("flow", f"flow by {method}", flow, self.rim)
        return replace(panel, sensor=sensor.name, level=self._level(level))

    def motion(self, name: str) -> Panel:
        """Return the motion to the next frame; of pictures, the flow of the clean ones."""
        return flow_panel("motion", name, self.motion_of, self.rim or 1.0)

    @property
    def depth(self) -> Panel:
        """Depth in logarithmic colors, the sky gray."""

        def depth(frame: int) -> NDArray[np.floating]:
            values = self.pixels(self.sequence.depth[frame]).astype(np.float64)
            return np.where(np.isinf(values), np.nan, values)

        seen = np.concatenate([depth(each).ravel() for each in self._sampled])
        known = seen[~np.isnan(seen)]
        near, far = np.percentile(known, [1, 99]).tolist() if known.size else (1.0, 2.0)
        far = max(far, near * 1.01)
        scale = map_scale("viridis_r", near, far, logarithmic=True)
        caption = f"yellow {number(near)} m to violet {number(far)} m, the sky gray"
        legend = scale.legend(number(near), f"{number(far)} m", "sky" * (known.size < seen.size))
        return Panel("depth", "depth", caption, lambda frame: scale.picture(depth(frame)), legend)

    def pixels(self, image: NDArray[Any]) -> NDArray[Any]:
        """Return the shown pixels of an image (H, W, ...)."""
        return image[:: self.step, :: self.step]

    def film(self, panel: Panel, title: str = "") -> Markup:
        """Return the frames of a panel as a film of a page (`film_of`)."""
        return film_of(panel, self.frames, title)

    def motion_of(self, frame: int) -> NDArray[np.floating]:
        """Return the motion from a frame to the next (h, w, 2), px, NaN where undefined.

        Of pictures, whose true motion is unknown, it is the flow between the noise-free pictures,
        reduced by `step`.
        """
        sequence = self.sequence
        if frame + 1 == len(sequence):
            return np.full((*self.pixels(np.empty(sequence.shape)).shape, 2), np.nan)
        if not sequence.configuration.scene.has_truth:
            frames, (rows, columns) = light_of(sequence.dataset).frames, sequence.shape
            small = -(-rows // self.step), -(-columns // self.step)
            first, second = (resized(frames.at(each), small) for each in (frame, frame + 1))
            return self.step * clean_flow(first, second)
        if sequence.configuration.shutter.readout_s:  # the small files have that of whole frames
            return self.pixels(sequence.flow(frame))
        path = sequence.dataset.frame("training/flow", frame)
        with undamaged(path, "regenerate the sequence"):
            return self.pixels(read_flo(path))

    def _level(self, level: LightLevel) -> str:
        """Return the name of a level; for pictures, with the photons of the first sensor."""
        settings, name = self.sequence.configuration, level_name(level)
        if not isinstance(settings.scene, Pictures):
            return name
        mean = self.sequence.dataset.read_scene_record()["pictures"]["mean"]
        bands, sensor = settings.render.bands_nm, settings.sensors[0]
        of_unit = light_of(self.sequence.dataset).radiance_of_unit
        per_lux = photons_per_lux(of_unit, settings.light, bands, sensor, mean)
        return f"{name}, {number(per_lux * illuminance_of(level))} photons"


def checked_json(path: Path, check: Callable[[Any], _Read], remedy: str) -> _Read:
    """Return the content of a JSON file once it is checked. Raises UserError if it is damaged."""
    with undamaged(path, remedy):
        return check(from_json(bounded.read_bytes(path)))


def _found_flow(found: StoredFrames, grid: BlockGrid, frame: int) -> Floats:
    """Return a method's motion of each block at all pixels (H, W, 2), px."""
    blocks = found.read([min(frame, len(found) - 1)])[0].astype(np.float64)
    flow, size = np.full((*grid.shape, 2), np.nan), grid.block_px
    bottom, right = grid.top + grid.rows * size, grid.left + grid.columns * size
    flow[grid.top : bottom, grid.left : right] = blocks.repeat(size, axis=0).repeat(size, axis=1)
    return flow


def _best_method(records: Iterable[FlowRecord]) -> str | None:
    """Return the velocity method of least median error, the first one without truth.

    None if no method gives velocities.
    """
    able = [each for each in records if METHODS[each.method].gives == "velocity"]
    return min(able, key=lambda each: each.median_error).method if able else None
