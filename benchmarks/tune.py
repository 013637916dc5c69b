"""Find the settings in `megalopta/benchmark/tuned.yaml`: `python benchmarks/tune.py DIS`.

For each number of photons per pixel: the stretch of counts, the blur and the main parameter of
least error on scenes that no table of results shows, the geometric mean over scenes of the mean
over blocks. Noise settings and main parameter, if any, are varied in turn until neither improves,
from the settings for the next brighter light; where settings of before are better, as in four rows
of ILK, they stay. The scenes: dead leaves and pictures of scikit-image, both in layers, whose disks
move by up to 4 px in half of them and by up to 12 px in the others.
"""

import math
import sys
from collections.abc import Iterator
from functools import cache
from itertools import product

import numpy as np
import yaml
from skimage import data

from megalopta.assets_gen import generator
from megalopta.assets_gen.surface_textures import dead_leaves
from megalopta.benchmark.clips import FlowClip
from megalopta.benchmark.table import MEAN
from megalopta.benchmark.whole_frames import PHOTONS_PER_PX, frame_errors
from megalopta.flow import METHODS
from megalopta.flow.stimuli.known_flow import Layer, MovingLayers
from megalopta.scenes.spectra.color import LUMINANCE_SHARES, linear_of_srgb

SHAPE, FASTEST_PX = (168, 168), (4.0, 12.0)
STEEPEST = 0.008  # largest change of velocity between neighboring pixels, px per frame
BLURS_PX = (0.0, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0)
FEW_BLURS_PX = {"DualTVL1": (0.5, 0.7, 1.0, 1.5)}  # slow
WINDOWS = (0.25, 0.35, 0.5, 0.75, 1.0, 1.5)
PARAMETERS: dict[str, tuple[str, tuple[object, ...]]] = {
    "TV-L1": ("attachment", (3.0, 5.0, 8.0, 12.0, 18.0)),
    "DualTVL1": ("attachment", (0.02, 0.03, 0.04, 0.06, 0.09)),
    "DeepFlow": ("stretch", ()),
    "DIS": ("preset", ("ultrafast", "fast", "medium")),
    "PCAFlow": ("stretch", ()),
    "RLOF": ("window_px", (None, 15, 21, 31, 41)),
    "FB": ("window_blocks", WINDOWS),
    "LK": ("window_blocks", (0.75, 1.0, 1.5, 2.0, 3.0, 4.0)),
    "ILK": ("window_blocks", WINDOWS),
}


def tuning_clips() -> Iterator[FlowClip]:
    """Yield the tuning scenes; those at odd places have large motion."""
    for number, seed in enumerate((1000, 1001, 1002, 1003)):
        rng = generator(seed, "whole frames, leaves")
        texture = dead_leaves((640, 640), rng, (6.0, 160.0))
        yield in_layers(f"leaves {seed}", rng, texture, FASTEST_PX[number % 2])
    for number, name in enumerate(("grass", "hubble_deep_field", "coins", "retina")):
        light = linear_of_srgb(getattr(data, name)() / 255)
        gray = light if light.ndim == 2 else light @ LUMINANCE_SHARES
        sides = [(0, side) for side in gray.shape]
        texture = np.pad(gray, sides, mode="symmetric")  # tiles the plane without a seam
        rng = generator(number, "tuning", name)
        yield in_layers(f"tuning {name}", rng, texture, FASTEST_PX[number % 2])


def in_layers(
    name: str, rng: np.random.Generator, texture: np.ndarray, fastest_px: float
) -> FlowClip:
    """Return eight frames of a texture in an affine motion, and three disks of it in others."""

    def layer(disk: tuple[float, float, float] | None, fastest_px: float) -> Layer:
        elsewhere = np.roll(texture, rng.integers(texture.shape), axis=(0, 1))
        speed, angle = rng.uniform(0.5, fastest_px), rng.uniform(0, 2 * math.pi)
        velocity = speed * math.cos(angle), speed * math.sin(angle)
        return Layer(elsewhere, velocity, rng.uniform(-STEEPEST, STEEPEST, (2, 2)), disk)

    layers = [layer(None, FASTEST_PX[0])]
    for _ in range(3):
        x, y = ((rng.random() - 0.5) * 0.8 * side for side in SHAPE[::-1])
        layers.append(layer((x, y, rng.uniform(30, 55)), fastest_px))
    scene = MovingLayers(layers)
    light = scene.light(SHAPE, range(-3, 5))  # the flow is that from 0 to 1
    return FlowClip(name, light / light.mean(), scene.flow(SHAPE, 0), scene.hidden(SHAPE, 0))


def main(name: str) -> None:
    parameter, values = PARAMETERS[name]
    clips = list(tuning_clips())

    @cache
    def error(photons: float, stretch: str, blur_px: float, value: object) -> float:
        settings = {parameter: value, "stretch": stretch, "blur_px": blur_px}
        board = frame_errors(clips, [METHODS[name].model_copy(update=settings)], (photons,))
        return float(np.exp(np.log(board.by_draw[MEAN]).mean()))

    noise, value, found = ("anscombe", 3.0), getattr(METHODS[name], parameter), {}
    for photons in sorted(PHOTONS_PER_PX, reverse=True):
        before = None
        while before != (noise, value):
            before = noise, value
            blurs_px = FEW_BLURS_PX.get(name, BLURS_PX)
            choices = product(("none", "anscombe"), blurs_px)
            noise = min(choices, key=lambda each: error(photons, *each, value))
            value = min(values or (noise[0],), key=lambda each: error(photons, *noise, each))
        settings = {"stretch": noise[0], "blur_px": noise[1], parameter: value}
        found[photons] = settings | {"error_px": round(error(photons, *noise, value), 4)}
    print(yaml.safe_dump({name: dict(sorted(found.items()))}, sort_keys=False))


if __name__ == "__main__":
    main(sys.argv[1])
