"""The flow stage: motion detectors on the readings of every sensor at every light level."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path

import numpy as np
import zarr

from megalopta.config.model import Configuration, LightLevel
from megalopta.core import files
from megalopta.core.bounded import open_store, undamaged
from megalopta.core.freshness import code_digest
from megalopta.core.progress import progress
from megalopta.dataset.flow_record import FlowRecord
from megalopta.dataset.frames import frames_at_once, read_motion, write_frames
from megalopta.dataset.store import Dataset, exposure_name
from megalopta.flow.benchmark import default_warm_up
from megalopta.flow.detectors.blocks import BlockDetector, BlockGrid
from megalopta.flow.detectors.registry import METHODS
from megalopta.flow.metrics.endpoint_error import block_flow, block_share
from megalopta.sensor import ContrastSensor, ImageSensor, OpenedCounts, StoredFrames
from megalopta.sensor.formats.counts_store import format_attribute
from megalopta.stages.correction import open_corrected
from megalopta.stages.declaration import Stage
from megalopta.stages.measurement import BlockTruth, Record, Scaled, SeenFrames, SequenceMeasurement
from megalopta.stages.sense import open_exposure, require_expectation


def measure_flow(dataset: Dataset) -> None:
    """Run the detectors; writes responses/SENSOR-LEVEL.zarr and results/SEQ/flow.json.

    Responses and errors of one sensor at one light level are written at once and not measured
    again.
    """
    require_expectation(dataset)
    pairs = dataset.configuration.exposures
    missing = [pair for pair in pairs if not responses_path(dataset, *pair).exists()]
    if missing:
        _measure(dataset, missing)
    records: list[Record] = []
    for pair in pairs:
        path = responses_path(dataset, *pair)
        with undamaged(path, "remove it and run the command again"):
            records += map(dict, open_store(path).attributes["records"])
    files.write_json(dataset.result("flow.json"), records)


def _measure(dataset: Dataset, pairs: Sequence[tuple[ImageSensor, LightLevel]]) -> None:
    settings = dataset.configuration
    truths = _block_truths(dataset)
    work = len(pairs) * len(settings.methods) * settings.trajectory.frames
    with progress("Detecting motion", work, "frame") as advance:
        for sensor, level in pairs:
            with files.atomic_write(responses_path(dataset, sensor, level)) as temporary:
                group = zarr.open_group(temporary, mode="w", zarr_format=3)
                opened = open_exposure(dataset, sensor, level)
                corrected = open_corrected(dataset, sensor, level)
                errors = _measure_exposure(settings, opened, corrected, truths, group, advance)
                named = ({"sensor": sensor.name, "level": level, **record} for record in errors)
                checked = map(FlowRecord.model_validate, named)
                records = [record.model_dump(mode="json", exclude_unset=True) for record in checked]
                group.attrs.update(format_attribute())
                group.attrs.update({"model": _model(), "records": records})


def _measure_exposure(
    settings: Configuration,
    opened: OpenedCounts,
    corrected: StoredFrames | None,
    truths: Mapping[str, BlockTruth],
    group: zarr.Group,
    advance: Callable[[int], object],
) -> list[Record]:
    """Write the responses of all methods and return their errors."""
    shape = opened["counts"].shape
    measurements = {
        name: SequenceMeasurement(
            METHODS[name],
            (shape[1], shape[2]),
            truths.get(name),
            default_warm_up(shape[0], [METHODS[name]]),
            settings.flow.saturated == "leave_out",
            opened.sensor,
        )
        for name in settings.methods
    }
    saturated = 0
    for first, frames in _seen_frames(opened, corrected, settings):
        saturated += int(frames.saturated.sum())
        for name, measurement in measurements.items():
            ideal, noisy = measurement.add(frames)
            missing = name in truths  # one velocity fewer than frames
            for key, values in ((name, noisy), (f"{name}-ideal", ideal)):
                start, length = max(first - missing, 0), shape[0] - missing
                write_frames(group, key, start, values.astype(np.float32), length)
            advance(len(frames.saturated))
    share = {"saturated_fraction": saturated / math.prod(shape)}
    return [share | measurement.record() for measurement in measurements.values()]


def _seen_frames(
    opened: OpenedCounts, corrected: StoredFrames | None, settings: Configuration
) -> Iterator[tuple[int, SeenFrames]]:
    """Yield chunks of frames, each with the number of its first frame."""
    photons = opened["photons"] if "perfect" in settings.flow.references else None
    # net events have no mean
    readings = None if isinstance(opened.sensor, ContrastSensor) else opened["mean_reading"]
    means = (seen.mean() if seen else 0.0 for seen in (readings, photons, corrected))
    to_one, photons_to_one, corrected_to_one = (1 / mean if mean else 1.0 for mean in means)

    def scaled(frames: StoredFrames | None, chunk: slice, scale: float) -> Scaled | None:
        return None if frames is None else (frames[chunk].astype(np.float64), scale)

    at_once = frames_at_once(settings)
    for first in range(0, opened["counts"].shape[0], at_once):
        chunk = slice(first, first + at_once)
        seen = SeenFrames(
            (opened["counts"][chunk], to_one),
            (opened["mean_reading"][chunk].astype(np.float64), to_one),
            scaled(photons, chunk, photons_to_one),
            scaled(corrected, chunk, corrected_to_one),
            opened["saturated"][chunk],
        )
        yield first, seen


def _block_truths(dataset: Dataset) -> dict[str, BlockTruth]:
    """True velocities of the blocks of every method that returns velocities."""
    settings = dataset.configuration
    shape = settings.camera.height, settings.camera.width
    detectors = [METHODS[name] for name in settings.methods]
    grids = {
        detector.name: detector.grid(shape)
        for detector in detectors
        if isinstance(detector, BlockDetector)
    }
    parts: dict[BlockGrid, list[BlockTruth]] = {grid: [] for grid in grids.values()}
    pairs = settings.trajectory.frames - 1
    for index in range(pairs) if parts else ():
        motion = read_motion(dataset, index)
        flow, hidden = motion.flow[np.newaxis], motion.hidden[np.newaxis]
        purity = motion.purity[np.newaxis]
        ways = None, (purity >= settings.flow.least_purity).astype(np.float64)
        for grid, truths in parts.items():
            every, pure = (block_flow(flow, grid, hidden, weights=way) for way in ways)
            truths.append(BlockTruth(every, pure, block_share(hidden, grid)))
    joined = {}
    for grid, truths in parts.items():
        columns = zip(*(vars(truth).values() for truth in truths), strict=True)
        joined[grid] = BlockTruth(*(np.concatenate(column) for column in columns))
    return {name: joined[grid] for name, grid in grids.items()}


def responses_path(dataset: Dataset, sensor: ImageSensor, level: LightLevel) -> Path:
    """Zarr group with arrays METHOD (from counts) and METHOD-ideal (from their mean)."""
    return dataset.result("responses") / f"{exposure_name(sensor, level)}.zarr"


@cache
def _model() -> str:
    return code_digest(
        "megalopta.flow", __name__, "megalopta.stages.measurement", "megalopta.sensor.information"
    )


def _check(settings: Configuration) -> None:
    frames = settings.trajectory.frames
    contrast = [sensor.name for sensor in settings.sensors if isinstance(sensor, ContrastSensor)]
    for name in settings.methods:
        if contrast and METHODS[name].takes_counts:
            raise ValueError(
                f"methods: {name} takes counts of photons, but sensor {contrast[0]!r} gives net "
                "events; use a method of pictures, such as DIS, or remove the sensor"
            )
        METHODS[name].start((settings.camera.height, settings.camera.width))
        warm_up = default_warm_up(frames, [METHODS[name]])
        if frames - warm_up < 2:
            raise ValueError(
                f"trajectory.frames {frames} leaves fewer than two to score after the {warm_up} "
                f"in which {name} settles: use at least {warm_up + 2}, or remove it from methods"
            )


STAGE: Stage = Stage(
    name="flow",
    command="flow",
    fields=("methods", "flow"),
    needs=("render", "sense"),
    outputs=lambda dataset: [dataset.result("flow.json"), dataset.result("responses")],
    work=measure_flow,
    made_with=lambda _: {"model": _model()},
    is_derived=True,
    check=_check,
)
