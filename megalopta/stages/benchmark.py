"""The benchmark stage: photons per frame that each detector needs on the rendered sequence."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import cast

import zarr

from megalopta.config.model import Configuration
from megalopta.core import files
from megalopta.core.array_store import ArrayStore
from megalopta.core.arrays import Floats
from megalopta.core.bounded import open_store, undamaged
from megalopta.core.freshness import code_digest
from megalopta.core.progress import progress, say
from megalopta.dataset.frames import read_radiance_frames, write_frames
from megalopta.dataset.store import Dataset
from megalopta.flow.benchmark import checked_warm_up, photon_benchmark, work_units
from megalopta.flow.detectors.base import Frames
from megalopta.flow.detectors.registry import METHODS
from megalopta.sensor import PRESETS, photon_rate
from megalopta.stages.declaration import Stage

_PARTS = "benchmark-parts"


def benchmark(dataset: Dataset) -> None:
    """Measure the photons that each method needs; writes benchmark.json and benchmark.csv."""
    settings = dataset.configuration
    parts = dataset.result(_PARTS)
    path = parts / "light.zarr"
    if not path.exists():
        with files.atomic_write(path) as temporary:
            group = zarr.open_group(temporary, mode="w", zarr_format=3)
            for first, radiance in read_radiance_frames(dataset):
                # photons per second of the ideal sensor, without noise
                photons = photon_rate(radiance, settings.render.bands_nm, PRESETS["ideal"])
                write_frames(group, "photons", first, photons, settings.trajectory.frames)
    with undamaged(path, "remove it"):
        light = cast("Frames", open_store(path).arrays["photons"])
        if light.shape != _shape(settings):
            raise ValueError(f"its frames are {light.shape}, not those of the dataset")
    total = work_units(light.shape, settings.benchmark)
    with progress("Searching photon thresholds", total, "pixel") as advance:
        result = photon_benchmark(
            light,
            [METHODS[name] for name in settings.methods],
            settings.benchmark,
            settings.seed,
            dataset.sequence,
            advance,
            partial(_part, parts / "sums"),
        )
    files.write_json(dataset.result("benchmark.json"), result.to_dict())
    head = ("method", "rows", "columns", "metric", "photons_per_frame", "error", "standard_error")
    rows = (
        (curve.method, *curve.shape, curve.metric, *values)
        for curve in result.curves
        for values in zip(curve.fluxes, curve.errors, curve.standard_errors, strict=True)
    )
    files.write_csv(dataset.result("benchmark.csv"), head, rows)
    files.remove(dataset.result(_PARTS))
    for curve in result.curves:
        if curve.metric == "literal" and 2 in curve.thresholds:
            height, width = curve.shape
            say(f"benchmark: {curve.method:<6} {width} × {height}  N_2b {curve.thresholds[2]}")


def _part(folder: Path, name: str, work: Callable[[], list[Floats]]) -> list[Floats]:
    """Return the sums of every method, from the cache or computed."""
    store = ArrayStore(folder, name)
    if (kept := store.read()) is not None:
        return [kept[str(index)] for index in range(len(kept))]
    sums = work()
    store.write({str(index): total for index, total in enumerate(sums)})
    return sums


def _shape(settings: Configuration) -> tuple[int, int, int]:
    return settings.trajectory.frames, *settings.camera.shape


STAGE: Stage = Stage(
    name="benchmark",
    command="benchmark photons",
    fields=("methods", "benchmark"),
    needs=("render",),
    outputs=lambda dataset: [
        dataset.result(name) for name in ("benchmark.json", "benchmark.csv", _PARTS)
    ],
    work=benchmark,
    made_with=lambda _: {
        "model": code_digest("megalopta.flow", "megalopta.sensor.sampling", __name__)
    },
    is_derived=True,
    check=lambda settings: checked_warm_up(
        _shape(settings), [METHODS[name] for name in settings.methods], settings.benchmark
    ),
)
