"""The rendered forests: their statistics, and whether their noise matters to the benchmark.

Beside each forest the photons for an error of 25 % (`ratio`) are those of the same forest rendered
with half of the samples and another seed. Noise that mattered would move them. Names of files are
panoramas to compare with: `python benchmarks/bench_panoramas.py forest.hdr`.
"""

import sys
import time
from dataclasses import asdict
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from megalopta.assets_gen.dead_leaves_model import dead_leaves
from megalopta.benchmark.panoramas import (
    NATURAL_PANORAMAS,
    natural_templates,
    panorama_file,
    template_from_file,
)
from megalopta.dataset.rendering_noise import ATTRIBUTE
from megalopta.flow import METHODS, BenchmarkSettings, photon_benchmark
from megalopta.flow.stimuli.statistics import image_statistics
from megalopta.render.exr import read_attributes
from megalopta.render.noise import RenderNoise

POOLED, VELOCITY, FRAMES = 60, 5, 70
NAMES = ("BM", "IIA", "NDM", "NDS")


def frames(template: NDArray[np.float64]) -> NDArray[np.float64]:
    """Windows of 251 columns of a template that moves to the right."""
    columns = np.arange(251) - VELOCITY * np.arange(FRAMES)[:, np.newaxis]
    return np.moveaxis(template[:, columns % template.shape[1]], 1, 0)


def photons(template: NDArray[np.float64]) -> dict[str, float]:
    """N_2b of every method."""
    settings = BenchmarkSettings(
        sizes=(POOLED,), flux_min=3e4, flux_max=3e8, repeats=2, metrics=("ratio",), bits=(2,)
    )
    methods = [METHODS[name] for name in NAMES]
    result = photon_benchmark(frames(template), methods, settings, seed=0, sequence="noise")
    return {curve.method: curve.thresholds[2].flux or np.nan for curve in result.curves}


def main() -> None:
    halved = {
        name: recipe.model_copy(
            update={"samples_per_pass": recipe.samples_per_pass // 2, "seed": recipe.seed + 1}
        )
        for name, recipe in NATURAL_PANORAMAS.items()
    }
    start = time.process_time()
    forests, noisier = natural_templates(), natural_templates(panoramas=halved)
    print(f"rendered or read in {time.process_time() - start:.0f} CPU-seconds")
    others = {"dead leaves": dead_leaves((251, 753), np.random.default_rng(1))}
    others |= {name: template_from_file(Path(name)) for name in sys.argv[1:]}
    for name, template in {**forests, **others}.items():
        values = asdict(image_statistics(template)).items()
        print(f"{name:14s}", "  ".join(f"{field} {value:.3g}" for field, value in values))
    for name, recipe in NATURAL_PANORAMAS.items():
        noise = RenderNoise.from_json(read_attributes(panorama_file(name, recipe))[ATTRIBUTE])
        full, half = photons(forests[name]), photons(noisier[name])
        print(
            f"{name:14s} noise of a pixel {noise.median_relative:.1%}; N_2b, over that with half "
            "of the samples:",
            "  ".join(f"{m} {full[m]:.3g}, {full[m] / half[m]:.3f}" for m in NAMES),
        )


if __name__ == "__main__":
    main()
