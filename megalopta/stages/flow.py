"""The flow stage: motion detectors on the counts of every sensor at every light level.

Each detector answers twice, to the counts and to their noise-free twin; the difference is the error
that photon noise makes. Detectors that give a velocity are also compared with the true flow, and
those that tell directions give the camera's yaw rate.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import Any, cast

import numpy as np
import zarr
from numpy.typing import NDArray

from megalopta import files
from megalopta.config import Configuration, LightLevel
from megalopta.dataset import Dataset, FlowRecord, exposure_name, read_truth_frames
from megalopta.errors import UserError
from megalopta.flow.benchmark import default_warm_up
from megalopta.flow.detectors import METHODS, BlockDetector, Detector
from megalopta.flow.egomotion import rotation_error, yaw_rates_deg_s
from megalopta.flow.metrics import (
    METRICS,
    TruthError,
    block_flow,
    block_share,
    error_sums,
    truth_error,
    truth_splits,
)
from megalopta.freshness import code_digest
from megalopta.progress import progress
from megalopta.sensor import ImageSensor, StoredCounts
from megalopta.stages.declaration import Stage
from megalopta.stages.sense import exposures, read_exposure

Record = dict[str, Any]


def measure_flow(dataset: Dataset) -> None:
    """Run the detectors; writes responses/SENSOR-LEVEL.zarr and results/SEQ/flow.json.

    What is measured on one sensor at one light level is written at once, responses and errors, and
    is not measured again.
    """
    pairs = exposures(dataset)
    missing = [pair for pair in pairs if not _is_there(responses_path(dataset, *pair))]
    if missing:
        _measure(dataset, missing)
    records = [each for pair in pairs for each in _stored_records(responses_path(dataset, *pair))]
    files.write_json(dataset.result("flow.json"), records)


def _measure(dataset: Dataset, pairs: Sequence[tuple[ImageSensor, LightLevel]]) -> None:
    flow, occluded = true_flow(dataset)
    rates = yaw_rates_deg_s(dataset.configuration.trajectory)
    methods = dataset.configuration.methods
    with progress("Detecting motion", len(pairs) * len(methods), "response") as advance:
        for sensor, level in pairs:
            stored = read_exposure(dataset, sensor, level)
            records: list[Record] = []
            responses: dict[str, NDArray[np.float64]] = {}
            for name in methods:
                ideal, noisy = _respond(METHODS[name], stored)
                record = _compare(METHODS[name], ideal, noisy, flow, occluded, rates)
                named = {"sensor": sensor.name, "level": level, **record}
                checked = FlowRecord.model_validate(named)
                records.append(checked.model_dump(mode="json", exclude_unset=True))
                responses |= {name: noisy, f"{name}-ideal": ideal}
                advance()
            _write_responses(responses_path(dataset, sensor, level), responses, records)


def responses_path(dataset: Dataset, sensor: ImageSensor, level: LightLevel) -> Path:
    """Zarr group with one array METHOD (to counts) and METHOD-ideal (to their twin) per method."""
    return dataset.result("responses") / f"{exposure_name(sensor, level)}.zarr"


def true_flow(dataset: Dataset) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Forward flow (T − 1, H, W, 2) in px and where its pixels are hidden in the next frame."""
    frames = list(read_truth_frames(dataset))[:-1]
    return (
        np.stack([truth.flow_forward for truth in frames]),
        np.stack([truth.occluded_forward for truth in frames]),
    )


def _respond(
    detector: Detector, stored: StoredCounts
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Responses to the noise-free twin and to the counts, both brought to a mean of 1."""
    assert stored.exposure.expectation is not None
    twin = stored.exposure.expectation.mean_reading
    mean = float(twin.mean())
    scale = 1 / mean if mean else 1.0
    ideal = detector.respond(twin, scale)
    return ideal, detector.respond(stored.exposure.counts, scale)


def _compare(
    detector: Detector,
    ideal: NDArray[np.float64],
    noisy: NDArray[np.float64],
    flow: NDArray[np.float32],
    occluded: NDArray[np.bool_],
    rates: NDArray[np.float64],
) -> Record:
    warm_up = default_warm_up(len(flow) + 1, [detector])
    sums = error_sums(detector, ideal[warm_up:], noisy[warm_up:])
    record: Record = {
        "method": detector.name,
        "warm_up_frames": warm_up,
        "error": {metric: _number(sums.of_sequence(metric)) for metric in METRICS},
    }
    if isinstance(detector, BlockDetector):
        grid = detector.grid(flow.shape[1:3])
        truth, hidden = block_flow(flow, grid, occluded), block_share(occluded, grid)
        pair = (truth_error(ideal, truth), truth_error(noisy, truth))
        groups = (truth_splits(ideal, truth, hidden), truth_splits(noisy, truth, hidden))
        record["truth"] = _ideal_and_counts(*pair)
        record["truth_splits"] = {
            name: _ideal_and_counts(groups[0][name], groups[1][name]) for name in groups[0]
        }
    if found := rotation_error(detector, ideal, noisy, rates, warm_up):
        record["rotation"] = _numbers(asdict(found))
    return record


def _ideal_and_counts(ideal: TruthError, counts: TruthError) -> Record:
    return {"ideal": ideal.to_dict(), "counts": counts.to_dict()}


def _numbers(values: Mapping[str, float]) -> Record:
    return {name: _number(value) for name, value in values.items()}


def _number(value: float) -> float | None:
    """JSON has no NaN."""
    return None if math.isnan(value) else value


def _write_responses(
    path: Path, responses: Mapping[str, NDArray[np.float64]], records: Sequence[Record]
) -> None:
    with files.atomic_write(path) as temporary:
        group = zarr.open_group(temporary, mode="w", zarr_format=3)
        group.attrs.update({"model": _model(), "records": list(records)})
        for name, values in responses.items():
            chunks = (min(len(values), 16), *values.shape[1:])
            group.create_array(name, data=values.astype(np.float32), chunks=chunks)


def _is_there(path: Path) -> bool:
    """Whether responses are there; those of other code, of which a kill left some, are removed."""
    try:
        is_current = zarr.open_group(path, mode="r").attrs.get("model") == _model()
    except (OSError, ValueError, KeyError):  # nothing, or damaged
        is_current = False
    if not is_current:
        files.remove(path)
    return is_current


def _stored_records(path: Path) -> list[Record]:
    try:
        records = zarr.open_group(path, mode="r").attrs["records"]
        return [dict(each) for each in cast("list[Record]", records)]
    except (OSError, ValueError, KeyError, TypeError) as problem:
        raise UserError(
            f"{path} cannot be read ({problem}); remove it and run the command again"
        ) from None


@cache
def _model() -> str:
    return code_digest("megalopta.flow", __name__)


def _check(settings: Configuration) -> None:
    frames = settings.trajectory.frames
    for name in settings.methods:
        METHODS[name].start((settings.camera.height, settings.camera.width))
        warm_up = default_warm_up(frames, [METHODS[name]])
        if frames - warm_up < 2:
            raise ValueError(
                f"trajectory.frames {frames} leaves fewer than two to score after the {warm_up} "
                f"in which {name} settles: use at least {warm_up + 2}, or leave it out of methods"
            )


STAGE = Stage(
    name="flow",
    fields=("methods",),
    needs=("render", "sense"),
    outputs=lambda dataset: [dataset.result("flow.json"), dataset.result("responses")],
    work=measure_flow,
    model=_model,
    is_derived=True,
    check=_check,
)
