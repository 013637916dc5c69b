"""Where the noise of radiance comes from, what frames of an error cost, and whether that is stated.

- `first`: CPU-seconds until frames come, and memory, in a process with empty caches.
- `speeds`: error and cost of a sample of split paths and of Mitsuba's path tracer, whose variants
  run in processes of their own; the faster is the baseline.
- `costs`: CPU-seconds of a frame for median errors on surfaces, of single frames and of 30, by
  Mitsuba's faster variant, split paths and baked light. Errors of samples fall as the root of their
  number; costs and variances are those of one frame, measured in the same run.
- `accuracy`: stated error of baked frames over the true one, against converged split paths.

Errors are those of the sum over bands, on pixels without sky, over the mean (RMS) or the pixel's
own light (median over blocks).
"""

import argparse
import gc
import math
import os
import resource
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from multiprocessing import get_context
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import trimesh

from megalopta.config.model import Configuration, load
from megalopta.render import MeasuredPass, RunningMean, SceneRenderer, frame_seed, mi
from megalopta.render.baking.light import BakedLight
from megalopta.render.film import Film
from megalopta.render.noise import RegionNoise
from megalopta.scenes.build import build_scene

PRESETS, LIGHTS = ("open", "dense", "rainforest", "room"), ("daylight", "twilight", "starlight")
VARIANTS = {"scalar": "scalar_spectral", "llvm": "llvm_ad_spectral"}
SIZES_SAMPLES = ((64, 64), (320, 16), (640, 4))
"""Widths of frames of `speeds`, and samples per pixel."""
FRAMES, SAMPLES, BAKE_ERROR = 30, 64, 0.1
_REFERENCE = 32
UNSEEN = (
    ("clearing", "daylight"),
    ("clearing", "full_moon"),
    ("understorey", "twilight"),
    ("understorey", "airglow"),
    ("trail", "daylight"),
    ("trail", "overcast_night"),
    ("trail", "quarter_moon"),
    ("room", "daylight"),
    ("room", "full_moon"),
    ("rainforest", "moonless_forest_floor"),
)
"""Presets and lights that nothing was set on."""


_FOLDER = tempfile.TemporaryDirectory()
_BOXES = (
    *(((0, 0, -0.05), (6, 4, 0.1)), ((0, 0, 2.75), (6, 4, 0.1)), ((-3.05, 0, 1.35), (0.1, 4, 2.8))),
    *(((0, 2.05, 1.35), (6, 0.1, 2.8)), ((0, -2.05, 1.35), (6, 0.1, 2.8))),
    *(((3.05, 0, 0.45), (0.1, 4, 0.9)), ((3.05, 0, 2.4), (0.1, 4, 0.6))),
    *(((3.05, -1.3, 1.5), (0.1, 1.4, 1.2)), ((3.05, 1.3, 1.5), (0.1, 1.4, 1.2))),
    *(((-1, 0.8, 0.4), (1.2, 0.8, 0.8)), ((0.8, -1, 0.5), (0.5, 0.5, 1.0))),
)
"""Middles and sizes (m) of walls with one window of 1.2 by 1.2 m, and of furniture."""


@cache
def room() -> Path:
    """File of a pale room that the sky lights through its window."""
    boxes = [trimesh.creation.box(size).apply_translation(middle) for middle, size in _BOXES]
    whole = trimesh.util.concatenate(boxes)
    whole.apply_transform(trimesh.transformations.rotation_matrix(-np.pi / 2, (1, 0, 0)))
    paint = trimesh.visual.material.PBRMaterial(baseColorFactor=[225] * 3, metallicFactor=0)
    uv = np.zeros((len(whole.vertices), 2))
    whole.visual = trimesh.visual.TextureVisuals(uv=uv, material=paint)
    whole.export(Path(_FOLDER.name) / "room.glb")
    return Path(_FOLDER.name) / "room.glb"


def flight(preset: str, level: str, width: int, frames: int, **more: str) -> Configuration:
    """Flight through a forest of 300 trees, or a slow one in a room, in frames of 4:3."""
    place = {"scene": f"{{kind: forest, preset: {preset}, trees: 300}}", "render.max_depth": "16"}
    if preset == "room":
        place = {
            "scene": f"{{kind: meshes, files: ['{room()}']}}",
            "trajectory.position_m": "[-2.6, -1.2, 1.5]",
            "trajectory.look_at_m": "[1, 1, 1]",
            "trajectory.velocity_m_s": "[0.1, 0, 0]",
            "render.max_depth": "64",
        }
    changes = {
        **place,
        "light.level": level,
        "camera.width": str(width),
        "camera.height": str(width * 3 // 4),
        "trajectory.frames": str(frames),
        "render.samples_per_pixel": str(SAMPLES),
        "render.bake_error": str(BAKE_ERROR),
        **more,
    }
    return load("demo", changes)


def renderer(configuration: Configuration, integrator: str, frames: int = 0) -> SceneRenderer:
    scene = build_scene(
        configuration.scene, configuration.light, configuration.camera, configuration.trajectory
    )
    settings = configuration.render.model_copy(update={"integrator": integrator})
    poses = configuration.trajectory.poses()[: frames or None]
    return SceneRenderer(scene, configuration.camera, settings, poses)


def cpu_seconds(work: Callable[[], Any]) -> tuple[float, Any]:
    start = time.process_time()
    result = work()
    return time.process_time() - start, result


@dataclass
class Sample:
    """Error of one sample, as RMS and median, and its CPU-seconds."""

    rms: float
    median: float
    cpu_s: float

    def work(self, error: float, is_rms: bool = False) -> float:
        """CPU-seconds of a pixel for a median error, or RMS."""
        return self.cpu_s * ((self.rms if is_rms else self.median) / error) ** 2


def sampled(take: Callable[[int], Any], seen: MeasuredPass, samples: int) -> Sample:
    """Error and cost of a sample of frames `take(seed)`, with the sky of a measured one."""
    take(0)
    passes, spent = RunningMean(), []
    for seed in (1, 2, 3, 4):
        cpu_s, image = cpu_seconds(lambda seed=seed: take(seed))
        passes.add(image)
        spent.append(cpu_s)
    surface = passes.noise(1, without_standing(seen)).surface
    assert surface is not None
    cost = float(np.median(spent)) / seen.sky.size / samples
    return Sample(surface.rms * samples**0.5, surface.median * samples**0.5, cost)


def closely_seen(rendering: SceneRenderer, pose: Any, samples: int = SAMPLES) -> MeasuredPass:
    """Measured frame at a local pose, with the sky of many samples.

    A pixel that shows a thousandth of sky has an error of its own.
    """
    view = rendering._view
    film = Film(rendering.camera, view._settings, samples)

    def trace(_: Any, sensor: Any, seed: int, spp: int) -> Any:
        return view._integrator.measured(rendering._loaded, sensor, seed, spp)

    bands = len(view._settings.bands_nm)
    taken = np.mean([film.expose(trace, rendering._loaded, pose, seed) for seed in range(8)], 0)
    radiance = taken[..., :bands].astype(np.float32)
    return MeasuredPass(radiance, taken[..., bands])


def without_standing(seen: MeasuredPass) -> MeasuredPass:
    return replace(seen, standing=None, differences=None)


def mitsubas(
    backend: str, preset: str, level: str, width: int, samples: int, seen: MeasuredPass
) -> Sample:
    """Sample of Mitsuba's own path tracer in a variant."""
    configuration = flight(preset, level, width, 2, **{"render.backend": backend})
    rendering = renderer(configuration, "plain")
    pose, settings = rendering._local(configuration.trajectory.poses()[0]), configuration.render
    path = mi.load_dict({"type": "path", "max_depth": settings.max_depth})
    film = Film(rendering.camera, settings, samples)

    def trace(scene: Any, sensor: Any, seed: int, spp: int) -> Any:
        return np.array(path.render(scene, sensor, seed=seed, spp=spp), np.float32)

    return sampled(lambda seed: film.expose(trace, rendering._loaded, pose, seed), seen, samples)


def of_variants(*job: Any) -> dict[str, Sample]:
    """Samples of Mitsuba's path tracer; a process has one variant."""
    with get_context("spawn").Pool(1, maxtasksperchild=1) as pool:
        return {name: pool.apply(mitsubas, (backend, *job)) for backend, name in VARIANTS.items()}


def speeds(preset: str, level: str) -> None:
    """Rows of the table of one scene and light."""
    for width, samples in SIZES_SAMPLES:
        more = {"render.samples_per_pixel": str(samples)}
        configuration = flight(preset, level, width, 2, **more)
        rendering, pose = renderer(configuration, "path"), configuration.trajectory.poses()[0]
        seen = closely_seen(rendering, rendering._local(pose), samples)
        rows = of_variants(preset, level, width, samples, seen)
        best = min(one.work(0.1, is_rms=True) for one in rows.values())
        rows["split paths"] = sampled(lambda s: rendering.radiance(pose, s), seen, samples)  # noqa: B023
        for name, one in rows.items():
            median, rms = one.work(0.1) * seen.sky.size, one.work(0.1, is_rms=True)
            print(
                f"  {preset:10} {level:9} {width} px, {samples} samples, {name:16} error of a "
                f"sample {one.rms:.2f} RMS, {one.median:.2f} median; {1e6 * one.cpu_s:.2f} CPU-us; "
                f"CPU-s for 10 %: {median:.2f} median, {rms * seen.sky.size:.2f} RMS "
                f"({rms / best:.2f} of Mitsuba's fastest)",
                flush=True,
            )


def first(preset: str, level: str, number: int) -> None:
    """Row of one scene and light, in a process of its own with a new home."""
    trees = {}
    if preset != "room":
        trees = {"scene": f"{{kind: forest, preset: {preset}, trees: {number}}}"}
    given = [
        flight(preset, level, width, 2, **{**trees, "render.samples_per_pixel": samples})
        for width, samples in ((96, "16"), (128, "16"), (128, "1"))
    ]
    scene = build_scene(given[0].scene, given[0].light, given[0].camera, given[0].trajectory)
    built_s, pose, row = time.process_time(), given[0].trajectory.poses()[0], []
    for each in given:
        settings = each.render.model_copy(update={"integrator": "path"})
        begun = time.process_time()
        rendering = SceneRenderer(scene, each.camera, settings)
        loaded_s = time.process_time() - begun
        spent = [cpu_seconds(lambda r=rendering, n=n: r.radiance(pose, n))[0] for n in range(6)]
        row.append((loaded_s, spent[0], float(np.median(spent[1:]))))
        del rendering  # the next gets the same kernels if none of this is left
        gc.collect()
    print(
        f"  {preset:10} {level:9} imported and built in {built_s:.1f} CPU-s; loaded in "
        f"{row[0][0]:.1f}; first frame {row[0][1]:.1f}; first of another size {row[1][1]:.1f}; "
        f"with one sample {row[2][2]:.3f}; {scene.triangle_count / 1e6:.1f} million triangles, "
        f"{resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9:.2f} GB",
        flush=True,
    )


def costs(preset: str, level: str, width: int, lengths: list[int]) -> None:
    """Rows of the table of one forest and light, baked for sequences of some lengths."""
    configuration = flight(preset, level, width, FRAMES)
    first = configuration.trajectory.poses()[0]
    path = renderer(configuration, "path")
    pose = path._local(first)
    seen, pixels = closely_seen(path, pose), width * (width * 3 // 4)
    variants = of_variants(preset, level, width, 16, seen)
    name = min(variants, key=lambda variant: variants[variant].work(0.1))
    plain = variants[name]
    split = sampled(lambda seed: path.radiance(first, seed), seen, SAMPLES)
    kinds = {number: baked(configuration, first, number, seen.sky) for number in lengths}
    for error in (0.2, 0.1, 0.05):
        row = [pixels * each.work(error) for each in (plain, split)]
        row += [kind.cpu_s(error, pixels) for kind in kinds.values()]
        shares = "".join(f" {each:8.1f} ({each / row[0]:.3f})" for each in row[1:])
        print(
            f"  {preset:10} {level:9} median {error:4.0%}: {name} {row[0]:8.1f}; split, "
            f"baked for {' and '.join(map(str, lengths))} frames:{shares}",
            flush=True,
        )
    last = kinds[lengths[-1]].sample
    print(
        f"    RMS over median: path {plain.rms / plain.median:.2f}, split "
        f"{split.rms / split.median:.2f}, samples of baked frames {last.rms / last.median:.2f}",
        flush=True,
    )


@dataclass
class Baked:
    """Cost of baked light for a number of frames."""

    sample: Sample
    standing: float
    """Median error that all frames share."""
    survey_s: float
    bake_s: float
    frames: int
    light: BakedLight
    density: float

    def cpu_s(self, error: float, pixels: int) -> float:
        """CPU-seconds of a frame, with the split between bake and samples that costs least."""
        ray_s = self.bake_s / self.light.rays(self.density)

        def cost(share: float) -> float:
            wanted = self.light.density_for(error * share / self.standing, self.density)
            samples = pixels * self.sample.work(error * math.sqrt(1 - share**2))
            return (self.survey_s + ray_s * self.light.rays(wanted)) / self.frames + samples

        return min(cost(share) for share in (0.3, 0.45, 0.6, 0.75, 0.9))


def baked(configuration: Configuration, pose: Any, frames: int, sky: np.ndarray) -> Baked:
    bakes, compute_all = [], BakedLight.compute_all

    def timed(light: BakedLight, density: float) -> None:
        bakes.append((light, density, cpu_seconds(lambda: compute_all(light, density))[0]))

    with patch.object(BakedLight, "compute_all", timed):
        whole_s, rendering = cpu_seconds(lambda: renderer(configuration, "baked", frames))
    ((light, density, bake_s),) = bakes
    seen = replace(rendering.measured(pose, 1), sky=sky)
    sample = sampled(lambda seed: rendering.radiance(pose, seed), seen, SAMPLES)
    noise = passes_of(rendering, pose, seen)
    left = max(noise.median**2 - sample.median**2 / SAMPLES, 1e-6)
    return Baked(sample, math.sqrt(left), whole_s - bake_s, bake_s, frames, light, density)


def passes_of(rendering: SceneRenderer, pose: Any, seen: MeasuredPass) -> RegionNoise:
    passes = RunningMean()
    passes.add(seen.radiance)
    passes.add(rendering.radiance(pose, 2))
    surface = passes.noise(1, seen).surface
    assert surface is not None
    return surface


def accuracy(preset: str, level: str) -> None:
    """Stated against true error of a baked frame."""
    configuration = flight(preset, level, 80, 100)
    pose = configuration.trajectory.poses()[50]
    path, quick = (renderer(configuration, name) for name in ("path", "baked"))
    measured = quick.measured(pose, frame_seed(0, 1))
    surface, part = passes_of(quick, pose, measured), measured.sky == 0
    paths, images = (
        np.array([each.radiance(pose, seed).sum(axis=-1) for seed in range(_REFERENCE)], float)
        for each in (path, quick)
    )
    light, off = paths.mean(axis=0), images.mean(axis=0) - paths.mean(axis=0)
    left = (images.var(axis=0, ddof=1) + paths.var(axis=0, ddof=1)) / _REFERENCE
    fixed2 = off**2 - left
    error2, level_of_light = fixed2 + images.var(axis=0, ddof=1), light[part].mean()
    rms, standing = (
        math.sqrt(max(each[part].mean(), 0)) / level_of_light for each in (error2, fixed2)
    )
    median = median_of_blocks(error2, light, part)
    print(
        f"  {preset:12} {level:15} stated over true (required: 0.8 to 1.25): RMS "
        f"{surface.rms / rms:.2f}, median {surface.median / median:.2f}; RMS {rms:.2%}, median "
        f"{median:.2%}; fixed: stated {surface.standing:.2%}, true {standing:.2%}; mean "
        f"{off[part].mean() / level_of_light:+.2%}",
        flush=True,
    )


def median_of_blocks(error2: np.ndarray, light: np.ndarray, part: np.ndarray) -> float:
    """Median over blocks of 4 x 4 px of the error of their pixels in a part, over their light."""

    def sums(values: np.ndarray) -> np.ndarray:
        rows, columns = (side // 4 for side in values.shape)
        inside = np.where(part, values, 0.0)[: 4 * rows, : 4 * columns]
        return inside.reshape(rows, 4, columns, 4).sum(axis=(1, 3))

    pixels, total, lights = sums(np.ones_like(light)), sums(error2), sums(light)
    lit = lights > 0
    return float(np.median(np.sqrt(np.maximum(total * pixels, 0))[lit] / lights[lit]))


def in_new_home(work: Callable[..., None], *job: Any) -> None:
    """Do some work in a process of its own, with empty caches."""
    with tempfile.TemporaryDirectory() as folder:
        new = {"HOME": folder, "XDG_CACHE_HOME": folder}
        with patch.dict(os.environ, new):
            process = get_context("spawn").Process(target=work, args=job)
            process.start()
            process.join()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", nargs="*", default=["first", "speeds", "costs"])
    parser.add_argument("--width", type=int, default=320)
    parser.add_argument("--trees", type=int, default=100, help="of the forest of `first`")
    parser.add_argument("--lengths", nargs="+", type=int, default=[1, FRAMES])
    parser.add_argument("--presets", nargs="+", default=PRESETS)
    parser.add_argument("--lights", nargs="+", default=LIGHTS)
    given = parser.parse_args()
    for preset in given.presets:
        for level in given.lights:
            if "first" in given.what:
                in_new_home(first, preset, level, given.trees)
            if "speeds" in given.what:
                speeds(preset, level)
            if "costs" in given.what:
                costs(preset, level, given.width, given.lengths)
    if "accuracy" in given.what:
        for preset, level in UNSEEN:
            accuracy(preset, level)


if __name__ == "__main__":
    main()
