"""The bench stage: how many photons per frame each detector needs, on the rendered sequence.

The sums of every size and repeat are kept in results/SEQ/benchmark-parts until all are there.
"""

import csv
import io
from collections.abc import Callable
from dataclasses import fields
from functools import cache, partial
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from megalopta import files
from megalopta.config import Configuration
from megalopta.dataset import Dataset, read_radiance_frames
from megalopta.flow.benchmark import (
    BenchmarkResult,
    checked_warm_up,
    photon_benchmark,
    work_units,
)
from megalopta.flow.detectors import METHODS
from megalopta.flow.metrics import ErrorSums
from megalopta.freshness import code_digest
from megalopta.progress import progress, say
from megalopta.sensor import PRESETS, photon_rate
from megalopta.stages.declaration import Stage

_PARTS = "benchmark-parts"


def bench(dataset: Dataset) -> None:
    """Measure the photons that each method needs; writes benchmark.json and benchmark.csv."""
    settings = dataset.configuration
    light = photon_image(dataset)
    total = work_units(light.shape, settings.benchmark)
    with progress("Searching photon thresholds", total, "pixel") as advance:
        result = photon_benchmark(
            light,
            [METHODS[name] for name in settings.methods],
            settings.benchmark,
            settings.seed,
            dataset.sequence,
            advance,
            partial(_part, dataset.result(_PARTS) / _model()),
        )
    files.write_json(dataset.result("benchmark.json"), result.to_dict())
    files.write_text(dataset.result("benchmark.csv"), _table(result))
    files.remove(dataset.result(_PARTS))
    _say_thresholds(result)


def _part(folder: Path, name: str, work: Callable[[], list[ErrorSums]]) -> list[ErrorSums]:
    path = folder / f"{name}.npz"
    kept = _read_part(path)
    if kept is not None:
        return kept
    sums = work()
    arrays = {
        f"{index}-{field}": value
        for index, each in enumerate(sums)
        for field, value in vars(each).items()
    }
    with files.atomic_write(path) as temporary:
        np.savez(temporary, allow_pickle=False, **arrays)
    return sums


def _read_part(path: Path) -> list[ErrorSums] | None:
    """Read what was kept; None where there is nothing whole."""
    try:
        with np.load(path, allow_pickle=False) as file:
            names = [field.name for field in fields(ErrorSums)]
            count = len(file.files) // len(names)
            return [ErrorSums(*(file[f"{i}-{name}"] for name in names)) for i in range(count)]
    except (OSError, ValueError, KeyError, BadZipFile):
        return None


def _say_thresholds(result: BenchmarkResult) -> None:
    for curve in result.curves:
        if curve.metric == "literal" and 2 in curve.thresholds:
            rows, columns = curve.shape
            say(f"bench: {curve.method:<6} {columns} × {rows}  N_2b {curve.thresholds[2]}")


def photon_image(dataset: Dataset) -> NDArray[np.float64]:
    """Photons per second on each pixel (T, H, W) of the ideal sensor: the light without noise."""
    bands = dataset.configuration.render.bands_nm
    return np.concatenate(
        [
            photon_rate(radiance, bands, PRESETS["ideal"])
            for _, radiance in read_radiance_frames(dataset, chunk=16)
        ]
    )


def _table(result: BenchmarkResult) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(
        ["method", "rows", "columns", "metric", "photons_per_frame", "error", "standard_error"]
    )
    for curve in result.curves:
        for row in zip(curve.fluxes, curve.errors, curve.standard_errors, strict=True):
            writer.writerow(
                [curve.method, *curve.shape, curve.metric, *(f"{value:.6g}" for value in row)]
            )
    return text.getvalue()


@cache
def _model() -> str:
    return code_digest("megalopta.flow", "megalopta.sensor.sampling", __name__)


def _outputs(dataset: Dataset) -> list[Path]:
    return [dataset.result(name) for name in ("benchmark.json", "benchmark.csv", _PARTS)]


def _check(settings: Configuration) -> None:
    shape = settings.trajectory.frames, settings.camera.height, settings.camera.width
    checked_warm_up(shape, [METHODS[name] for name in settings.methods], settings.benchmark)


STAGE = Stage(
    name="bench",
    fields=("methods", "benchmark"),
    needs=("render",),
    outputs=_outputs,
    work=bench,
    model=_model,
    is_derived=True,
    check=_check,
)
