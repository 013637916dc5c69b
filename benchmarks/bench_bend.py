"""Does baked light bend a benchmark? Flow errors, rankings and N_2b on converged and baked light.

Four flights of 96 × 96 px are rendered with split paths, twice half of the samples, whose mean is
the reference, and with baked light of about 10 % error. Photons are drawn from each with the same
seeds. Reported for each method and number of photons: mean and median endpoint error on visible
surfaces, their change by baked light with a 95 % interval over pairs of frames, the order of
methods, and N_2b with its interval. The change from one half of the samples to the other is what
remains of noise.

Light is kept in a folder (`--folder`), so that a second run takes minutes.
"""

import argparse
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from megalopta.config.model import Configuration, load
from megalopta.flow import BenchmarkSettings, optical_flow, photon_benchmark
from megalopta.render import SceneRenderer, Truth, frame_seed
from megalopta.scenes.build import build_scene
from megalopta.sensor import photon_rate, preset

SIZE, FRAMES, DRAWS = 96, 6, 3
METHODS = ("BM", "DIS", "TV-L1", "PM", "PF")
DETECTORS = ("BM", "IIA", "DIS", "PF")
PHOTONS = (3.0, 30.0, 300.0)


class Flight(NamedTuple):
    """Flight with the samples of its frames: converged ones, and of a usable frame."""

    preset: str
    level: str
    converged: int
    baked: int


FLIGHTS = (
    Flight("open", "daylight", 3200, 64),
    Flight("open", "starlight", 4800, 64),
    Flight("dense", "daylight", 9600, 3600),
    Flight("dense", "starlight", 9600, 256),
)
KINDS = ("converged", "half", "other half", "baked")


def configuration(flight: Flight) -> Configuration:
    changes = {
        "scene": f"{{kind: forest, preset: {flight.preset}, trees: 300, seed: 5}}",
        "light.level": flight.level,
        "camera.width": str(SIZE),
        "camera.height": str(SIZE),
        "trajectory.frames": str(FRAMES),
        "render.bake_error": "0.07",
        "render.max_depth": "16",
    }
    return load("demo", changes)


@dataclass
class Rendered:
    """Light of a flight by kind, each (T, H, W), and the truth of its frames."""

    light: Mapping[str, NDArray[np.float32]]
    truths: list[Truth]


def rendered(flight: Flight, folder: Path) -> Rendered:
    """Light of a flight, from the folder if it is there."""
    asked = configuration(flight)
    file = folder / f"{flight.preset}-{flight.level}.npz"
    if not file.exists():
        light = dict(_kinds(flight, asked))
        light["converged"] = (light["half"] + light["other half"]) / 2
        np.savez(file, **light)
    with np.load(file) as stored:
        light = {name: stored[name] for name in stored.files}
    tracer = _renderer(asked, "path", 1)
    poses = asked.trajectory.poses()
    return Rendered(light, [tracer.truth(poses, frame) for frame in range(FRAMES - 1)])


def _kinds(flight: Flight, asked: Configuration) -> Iterator[tuple[str, NDArray[np.float32]]]:
    half = flight.converged // 2
    ways = (("half", half), ("other half", half), ("baked", flight.baked))
    for number, (name, samples) in enumerate(ways):
        integrator = "baked" if name == "baked" else "path"
        yield name, _taken(_renderer(asked, integrator, samples), asked, number)


def _renderer(asked: Configuration, integrator: str, samples: int) -> SceneRenderer:
    scene = build_scene(asked.scene, asked.light, asked.camera, asked.trajectory)
    settings = asked.render.model_copy(
        update={"integrator": integrator, "samples_per_pixel": samples}
    )
    return SceneRenderer(scene, asked.camera, settings, asked.trajectory.poses())


def _taken(renderer: SceneRenderer, asked: Configuration, seed: int) -> NDArray[np.float32]:
    poses = asked.trajectory.poses()
    frames = [renderer.radiance(each, frame_seed(seed, n)) for n, each in enumerate(poses)]
    rate = photon_rate(np.stack(frames), asked.render.bands_nm, preset("ideal"))
    return np.asarray(rate, np.float32)


def errors(light: NDArray[np.float32], truths: list[Truth], photons: float) -> NDArray[np.float64]:
    """Mean and median endpoint error (methods, pairs, draws, 2) of one kind of light, px."""
    found = np.empty((len(METHODS), len(truths), DRAWS, 2))
    scaled = light * (photons / light.mean())
    for pair, truth in enumerate(truths):
        known = _known(truth)
        for draw in range(DRAWS):
            rng = np.random.default_rng([pair, draw])
            counts = [rng.poisson(scaled[pair + each]).astype(np.float64) for each in (0, 1)]
            for index, method in enumerate(METHODS):
                flow = np.nan_to_num(optical_flow(*counts, method=method))
                off = np.linalg.norm(flow - truth.flow_forward, axis=-1)[known]
                found[index, pair, draw] = off.mean(), np.median(off)
    return found


def _known(truth: Truth) -> NDArray[np.bool_]:
    hidden = truth.occluded_forward | truth.out_of_view_forward
    return ~hidden & np.isfinite(truth.flow_forward).all(axis=-1) & np.isfinite(truth.depth)


def interval(change: NDArray[np.float64]) -> tuple[float, float]:
    """Mean of changes (pairs, draws), and half of its 95 % interval over pairs."""
    each = change.mean(axis=1)
    half = student.ppf(0.975, len(each) - 1) * each.std(ddof=1) / np.sqrt(len(each))
    return float(each.mean()), float(half)


def table_of_errors(flight: Flight, scene: Rendered) -> None:
    """Print errors on converged light, and their relative change on the others."""
    for photons in PHOTONS:
        taken = {name: errors(scene.light[name], scene.truths, photons) for name in KINDS}
        for measure, name in enumerate(("mean", "median")):
            print(f"  {photons:g} photons, {name} error (px), and its change by kind of light (%)")
            base = taken["converged"][..., measure]
            for index, method in enumerate(METHODS):
                level = base[index].mean()
                line = f"    {method:5} {level:6.3f}"
                pairs = (
                    ("halves", taken["other half"] - taken["half"]),
                    ("baked", taken["baked"] - taken["converged"]),
                )
                for kind, change in pairs:
                    value, half = interval(change[index, ..., measure])
                    line += f"   {kind} {value / level:+6.1%} ± {half / level:5.1%}"
                print(line, flush=True)
            orders = {k: np.argsort(taken[k][..., measure].mean(axis=(1, 2))) for k in KINDS}
            for kind in KINDS[1:]:
                if (orders[kind] != orders["converged"]).any():
                    print(f"    order on {kind}: {[METHODS[i] for i in orders[kind]]}", flush=True)


def table_of_thresholds(flight: Flight, scene: Rendered) -> None:
    """Print N_2b of detectors by kind of light."""
    asked = BenchmarkSettings(
        sizes=(SIZE,), metrics=("literal",), bits=(2,), flux_min=1e2, flux_max=1e8
    )
    for kind in KINDS:
        light = scene.light[kind].astype(np.float64)
        result = photon_benchmark(light, list(DETECTORS), asked, seed=1, sequence=flight.preset)
        line = f"  N_2b, {kind:10}"
        for curve in result.curves:
            line += f"  {curve.method} {curve.thresholds[2]}"
        print(line, flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, default=Path("out/bend"))
    folder = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    for flight in FLIGHTS:
        scene = rendered(flight, folder)
        noise = {
            name: round(float(np.nanmedian(off / scene.light["converged"])), 4)
            for name in KINDS[1:]
            for off in [np.abs(scene.light[name] - scene.light["converged"])]
        }
        print(f"{flight.preset}, {flight.level}; median difference {json.dumps(noise)}", flush=True)
        table_of_errors(flight, scene)
        table_of_thresholds(flight, scene)


if __name__ == "__main__":
    main()
