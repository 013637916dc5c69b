"""The bench stage: how many photons per frame each detector needs, on the rendered sequence."""

import csv
import io

import numpy as np
from numpy.typing import NDArray

from megalopta import files
from megalopta.dataset import Dataset
from megalopta.flow.benchmark import photon_benchmark
from megalopta.flow.benchmark_result import BenchmarkResult
from megalopta.flow.benchmark_settings import work_units
from megalopta.flow.methods import METHODS
from megalopta.frames import read_radiance_frames
from megalopta.progress import progress, say
from megalopta.sensor import PRESETS, photon_rate


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
        )
    files.write_json(dataset.result("benchmark.json"), result.to_dict())
    files.write_text(dataset.result("benchmark.csv"), _table(result))
    _say_thresholds(result)


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
