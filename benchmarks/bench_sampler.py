"""Which sampler, split and depth give the least error per CPU-second on the demo's forest.

Error: RMS difference of two renderings with other seeds, over √2 and the mean (sum over bands). An
error e after t CPU-seconds has the efficiency 1/(e²·t), given as a ratio to independent sampling at
the same depth. Depth: the light of surfaces that paths of no more hits leave out.
"""

import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from megalopta.config.model import Configuration, load
from megalopta.render import RenderSettings, SceneRenderer
from megalopta.scenes import build_scene
from megalopta.scenes.scene import Scene

# Sampler, samples of a pass, passes averaged.
SPLITS = (
    ("independent", 49, 1),
    ("multijitter", 16, 1),
    ("multijitter", 49, 1),
    ("multijitter", 25, 2),
    ("multijitter", 100, 1),
    ("multijitter", 49, 2),
    ("ldsampler", 64, 1),
    ("ldsampler", 16, 4),
    ("orthogonal", 49, 1),
    ("orthogonal", 25, 2),
)
DEPTHS = (2, 3, 4, 6, 8, 16)
INFRARED = ((900.0, 1300.0), (1300.0, 1700.0))
PAIRS = 3


@dataclass(frozen=True)
class Efficiency:
    error: float
    median: float
    seconds: float

    @property
    def value(self) -> float:
        return 1 / (self.error**2 * self.seconds)


class Forest:
    def __init__(self) -> None:
        self.settings: Configuration = load("demo")
        parts = self.settings
        self.scene: Scene = build_scene(parts.scene, parts.light, parts.camera, parts.trajectory)
        self.poses = parts.trajectory.poses()[:: parts.trajectory.frames // PAIRS]

    def renderer(self, **changes: Any) -> SceneRenderer:
        values = self.settings.render.model_dump() | changes
        return SceneRenderer(self.scene, self.settings.camera, RenderSettings(**values))


def rendered(renderer: SceneRenderer, pose: Any, seeds: range) -> tuple[Any, float]:
    start = time.process_time()
    image = np.mean([renderer.radiance(pose, seed).sum(axis=-1) for seed in seeds], axis=0)
    return image, time.process_time() - start


def measure(forest: Forest, sampler: str, samples: int, passes: int) -> Efficiency:
    renderer = forest.renderer(sampler=sampler, samples_per_pixel=samples)
    renderer.radiance(forest.poses[0], 0)  # kernels are compiled
    rows = [pair(renderer, pose, passes) for pose in forest.poses[:PAIRS]]
    return Efficiency(*np.mean(rows, axis=0))


def pair(renderer: SceneRenderer, pose: Any, passes: int) -> tuple[float, float, float]:
    (a, before), (b, after) = (
        rendered(renderer, pose, range(first, first + passes)) for first in (1, 1 + passes)
    )
    difference, mean = np.abs(a - b) / np.sqrt(2), (a + b) / 2
    median = np.median(difference / mean) / 0.6745  # of |N(0, 1)|
    return np.sqrt((difference**2).mean()) / mean.mean(), median, (before + after) / 2


def depths(forest: Forest, **changes: Any) -> Iterator[tuple[int, float, float]]:
    for depth in DEPTHS:
        renderer = forest.renderer(max_depth=depth, samples_per_pixel=100, **changes)
        renderer.radiance(forest.poses[0], 0)
        _, seconds = rendered(renderer, forest.poses[0], range(1, 2))
        left_out = renderer.light_left_out(forest.poses[0])
        assert left_out is not None
        yield depth, float(left_out.max()), seconds


def main() -> None:
    forest = Forest()
    print("sampler      samples × passes   RMS error  median   efficiency over independent")
    reference = None
    for sampler, samples, passes in SPLITS:
        found = measure(forest, sampler, samples, passes)
        reference = reference or found.value
        ratio = found.value / reference
        print(
            f"{sampler:<12} {samples:>7} × {passes}          {found.error:>7.4f}  "
            f"{found.median:>7.4f}   {ratio:>6.2f}",
            flush=True,
        )
    for name, changes in (("visible", {}), ("infrared", {"bands_nm": INFRARED})):
        print(f"depth, {name:<9} left out of the worst band   CPU-seconds over depth 2")
        first = None
        for depth, left_out, seconds in depths(forest, **changes):
            first = first or seconds
            print(f"{depth:>5} {left_out:>35.2%} {seconds / first:>26.2f}", flush=True)


if __name__ == "__main__":
    main()
