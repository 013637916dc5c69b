"""The JSON files that the report reads, checked whole before anything is made of them.

Each model lists what the report uses; what else stands in a file is left alone.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, NotRequired

from pydantic import (
    FiniteFloat,
    NonNegativeInt,
    PositiveFloat,
    PositiveInt,
    TypeAdapter,
    ValidationError,
)
from typing_extensions import TypedDict

from megalopta.config import level_text
from megalopta.dataset import Dataset
from megalopta.errors import UserError
from megalopta.flow.detectors import METHODS

Record = Mapping[str, Any]
Metric = Literal["literal", "ratio"]


class _Error(TypedDict):
    literal: FiniteFloat | None
    ratio: FiniteFloat | None


class _TruthError(TypedDict):
    blocks: NonNegativeInt
    endpoint_error_px: FiniteFloat | None
    relative_error_median: FiniteFloat | None
    outlier_fraction: FiniteFloat | None


class _Truth(TypedDict):
    ideal: _TruthError
    counts: _TruthError


class _Splits(TypedDict):
    slow: _Truth
    medium: _Truth
    fast: _Truth
    clear: _Truth
    occlusion: _Truth


class _Rotation(TypedDict):
    true_deg_s: FiniteFloat
    ideal_deg_s: FiniteFloat | None
    counts_deg_s: FiniteFloat | None


class _Answer(TypedDict):
    sensor: str
    level: float | str
    method: str
    warm_up_frames: NonNegativeInt
    error: _Error
    truth: NotRequired[_Truth]
    truth_splits: NotRequired[_Splits]
    rotation: NotRequired[_Rotation]


class _Threshold(TypedDict):
    kind: Literal["crossing", "above", "below", "undefined"]
    level: PositiveFloat
    range_min: PositiveFloat
    range_max: PositiveFloat
    flux: PositiveFloat | None
    low: PositiveFloat | None
    high: PositiveFloat | None


class _Curve(TypedDict):
    method: str
    shape: tuple[PositiveInt, PositiveInt]
    metric: Metric
    fluxes: list[PositiveFloat]
    errors: list[FiniteFloat | None]
    standard_errors: list[FiniteFloat | None]
    thresholds: dict[str, _Threshold]


class _BenchmarkSettings(TypedDict):
    metrics: list[Metric]
    bits: list[PositiveInt]
    repeats: PositiveInt
    confidence: PositiveFloat
    dark_counts: FiniteFloat


class _Benchmark(TypedDict):
    settings: _BenchmarkSettings
    frames: tuple[PositiveInt, PositiveInt, PositiveInt]
    warm_up: NonNegativeInt
    curves: list[_Curve]


class _MonteCarlo(TypedDict):
    median_relative: FiniteFloat | None
    rms_over_mean: FiniteFloat
    equivalent_photons_per_pixel: FiniteFloat | None
    mean: NotRequired[list[FiniteFloat]]
    covariance: NotRequired[list[list[FiniteFloat]]]
    detail: NotRequired[list[list[FiniteFloat]]]


class _Lux(TypedDict):
    lux: FiniteFloat


class _Illuminance(TypedDict):
    unshaded_lux: FiniteFloat
    ground: list[_Lux]


class _Scene(TypedDict):
    objects: NotRequired[NonNegativeInt]
    triangles: NotRequired[NonNegativeInt]
    variant: NotRequired[str]
    integrator: NotRequired[str]
    illuminance: NotRequired[_Illuminance | None]
    monte_carlo: NotRequired[_MonteCarlo | None]


_ANSWERS: TypeAdapter[Any] = TypeAdapter(list[_Answer])
_BENCHMARK: TypeAdapter[Any] = TypeAdapter(_Benchmark)
_SCENE: TypeAdapter[Any] = TypeAdapter(_Scene)


def read_records(dataset: Dataset) -> list[Record]:
    """Errors of every method on every sensor at every light level, in the dataset's order.

    Raises
    ------
    UserError
        When flow.json is damaged or lacks something.
    """
    path, remedy = dataset.result("flow.json"), f"run: megalopta flow {dataset.root} --redo"
    records = {
        (each["sensor"], each["level"], each["method"]): each
        for each in _read(path, _ANSWERS, remedy)
    }
    settings = dataset.configuration
    expected = [
        (sensor.name, level, method)
        for sensor in settings.sensors
        for level in settings.light_levels
        for method in settings.methods
    ]
    for key in expected:
        lacks_truth = METHODS[key[2]].gives == "velocity" and "truth" not in records.get(key, {})
        if key not in records or lacks_truth:
            sensor, level, method = key
            raise UserError(
                f"{path} lacks the errors of {method} on {sensor} at {level_text(level)}; {remedy}"
            )
    return [records[key] for key in expected]


def read_benchmark(dataset: Dataset) -> Record:
    """The photon benchmark. Raises UserError when benchmark.json is damaged or lacks something."""
    path, remedy = dataset.result("benchmark.json"), f"run: megalopta bench {dataset.root} --redo"
    benchmark: Record = _read(path, _BENCHMARK, remedy)
    curves = benchmark["curves"]
    found = {(curve["method"], curve["shape"], curve["metric"]) for curve in curves}
    for method in dataset.configuration.methods:
        for shape in {curve["shape"] for curve in curves} or {None}:
            for metric in benchmark["settings"]["metrics"]:
                if (method, shape, metric) not in found:
                    raise UserError(f"{path} lacks a {metric} error curve of {method}; {remedy}")
    for curve in curves:
        lengths = {len(curve[name]) for name in ("fluxes", "errors", "standard_errors")}
        if curve["method"] not in METHODS or len(lengths) > 1:
            raise UserError(f"{path} is damaged at the curve of {curve['method']}; {remedy}")
    return benchmark


def read_scene_record(dataset: Dataset) -> Record:
    """What the render stage noted. Raises UserError when it is damaged or missing."""
    remedy = f"run: megalopta render {dataset.root} --out {dataset.root} --redo"
    record: Record = _read(dataset.scene_record, _SCENE, remedy)
    return record


def _read(path: Path, model: TypeAdapter[Any], remedy: str) -> Any:
    try:
        return model.validate_json(path.read_bytes())
    except OSError as problem:
        raise UserError(f"{path} cannot be read ({problem.strerror}); {remedy}") from None
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        where = f" at {'.'.join(map(str, first['loc']))}" if first["loc"] else ""
        raise UserError(f"{path} is damaged{where} ({first['msg']}); {remedy}") from None
