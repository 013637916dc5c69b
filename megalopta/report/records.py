"""The JSON files that the report reads, checked whole before anything is made of them."""

from collections.abc import Callable, Mapping
from itertools import product
from pathlib import Path
from typing import Any, NotRequired, TypeVar

from pydantic import FiniteFloat, NonNegativeInt, TypeAdapter, ValidationError
from pydantic_core import from_json
from typing_extensions import TypedDict

from megalopta.config.model import level_text
from megalopta.core import bounded
from megalopta.core.errors import UserError
from megalopta.dataset.flow_record import FlowRecord
from megalopta.dataset.store import Dataset
from megalopta.flow.benchmark.sequence import BenchmarkResult
from megalopta.flow.detectors.registry import METHODS

Record = Mapping[str, Any]
_Read = TypeVar("_Read")


class _Region(TypedDict):
    share: FiniteFloat
    rms: FiniteFloat
    median: FiniteFloat
    p95: FiniteFloat
    bands: list[FiniteFloat]
    gradient: FiniteFloat
    standing: FiniteFloat
    standing_gradient: FiniteFloat


class _MonteCarlo(TypedDict):
    median_relative: FiniteFloat | None
    rms_over_mean: FiniteFloat
    equivalent_photons_per_pixel: FiniteFloat | None
    mean: NotRequired[list[FiniteFloat]]
    covariance: NotRequired[list[list[FiniteFloat]]]
    detail: NotRequired[list[list[FiniteFloat]]]
    surface: NotRequired[_Region | None]
    sky: NotRequired[_Region | None]


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
    light_left_out: NotRequired[list[FiniteFloat] | None]


_FLOW = TypeAdapter(list[FlowRecord])
_SCENE: TypeAdapter[Any] = TypeAdapter(_Scene)


def read_records(dataset: Dataset) -> list[FlowRecord]:
    """Errors of every method on every sensor at every light level, in the dataset's order.

    Raises
    ------
    UserError
        When flow.json is damaged or lacks something.
    """
    path, remedy = dataset.result("flow.json"), f"run: megalopta flow {dataset.root} --redo"
    records = {
        (each.sensor, each.level, each.method): each
        for each in _read(path, _FLOW.validate_python, remedy)
    }
    settings = dataset.configuration
    expected = [
        (sensor.name, level, method)
        for sensor in settings.sensors
        for level in settings.light_levels
        for method in settings.methods
    ]
    for key in expected:
        found = records.get(key)
        if not found or (METHODS[key[2]].gives == "velocity" and not found.truth):
            sensor, level, method = key
            raise UserError(
                f"{path} lacks the errors of {method} on {sensor} at {level_text(level)}; {remedy}"
            )
    return [records[key] for key in expected]


def read_benchmark(dataset: Dataset, name: str = "benchmark.json") -> BenchmarkResult:
    """The photon benchmark. Raises UserError when its file is damaged or lacks something."""
    path, remedy = dataset.result(name), f"run: megalopta benchmark photons {dataset.root} --redo"
    benchmark = _read(path, BenchmarkResult.from_dict, remedy)
    found = {(curve.method, curve.shape, curve.metric) for curve in benchmark.curves}
    shapes: set[tuple[int, ...]] = {curve.shape for curve in benchmark.curves} or {()}
    for method, shape, metric in product(
        dataset.configuration.methods, shapes, benchmark.settings.metrics
    ):
        if (method, shape, metric) not in found:
            raise UserError(f"{path} lacks a {metric} error curve of {method}; {remedy}")
    if unknown := {method for method, *_ in found} - METHODS.keys():
        raise UserError(f"{path} is damaged at the curve of {min(unknown)}; {remedy}")
    return benchmark


def read_scene_record(dataset: Dataset) -> Record:
    """Return the notes of the render stage. Raises UserError when they are damaged or missing."""
    remedy = f"run: megalopta render {dataset.root} --out {dataset.root} --redo"
    record: Record = _read(dataset.scene_record, _SCENE.validate_python, remedy)
    return record


def _read(path: Path, check: Callable[[Any], _Read], remedy: str) -> _Read:
    try:
        return check(from_json(bounded.read_bytes(path)))
    except OSError as problem:
        raise UserError(f"{path} cannot be read ({problem.strerror}); {remedy}") from None
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        where = f" at {'.'.join(map(str, first['loc']))}" if first["loc"] else ""
        raise UserError(f"{path} is damaged{where} ({first['msg']}); {remedy}") from None
    except (ValueError, LookupError, TypeError, AttributeError) as problem:
        raise UserError(f"{path} is damaged ({problem}); {remedy}") from None
