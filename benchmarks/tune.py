"""Find the settings in `megalopta/benchmark/tuned.yaml`: `python benchmarks/tune.py DIS`.

For each number of photons per pixel: the stretch of counts, the blur and the main parameter of
least error on scenes that no table of results shows, the geometric mean over scenes of the mean
over blocks. Noise settings and main parameter are varied in turn until neither improves, from the
settings for the next brighter light. The scenes: dead leaves and pictures of scikit-image, both in
layers, whose disks move by up to 4 px in half of them and by up to 12 px in the others.
"""

import sys
from collections.abc import Iterator
from functools import cache
from itertools import product

import numpy as np
import yaml
from skimage import data

from megalopta.assets_gen import generator
from megalopta.benchmark.clips import FlowClip, layers_clip, leaves_clip
from megalopta.benchmark.table import MEAN
from megalopta.benchmark.whole_frames import PHOTONS_PER_PX, frame_errors
from megalopta.flow import METHODS
from megalopta.scenes.spectra.color import LUMINANCE_SHARES, decode_srgb

SHAPE, FASTEST_PX = (168, 168), (4.0, 12.0)
BLURS_PX = (0.0, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0)
WINDOWS = (0.25, 0.35, 0.5, 0.75, 1.0, 1.5)
PARAMETERS = {
    "TV-L1": ("attachment", (3.0, 5.0, 8.0, 12.0, 18.0)),
    "DIS": ("preset", ("ultrafast", "fast", "medium")),
    "FB": ("window_blocks", WINDOWS),
    "LK": ("window_blocks", (0.75, 1.0, 1.5, 2.0, 3.0, 4.0)),
    "ILK": ("window_blocks", WINDOWS),
}


def tuning_clips() -> Iterator[FlowClip]:
    """Yield the tuning scenes; those at odd places have large motion."""
    for number, seed in enumerate((1000, 1001, 1002, 1003)):
        yield leaves_clip(seed, SHAPE, FASTEST_PX[number % 2])
    for number, name in enumerate(("grass", "hubble_deep_field", "coins", "retina")):
        light = decode_srgb(getattr(data, name)() / 255)
        gray = light if light.ndim == 2 else light @ LUMINANCE_SHARES
        sides = [(0, side) for side in gray.shape]
        texture = np.pad(gray, sides, mode="symmetric")  # tiles the plane without a seam
        rng = generator(number, "tuning", name)
        yield layers_clip(f"tuning {name}", rng, texture, SHAPE, FASTEST_PX[number % 2])


def main(name: str) -> None:
    parameter, values = PARAMETERS[name]
    clips = list(tuning_clips())

    @cache
    def error(photons: float, stretch: str, blur_px: float, value: object) -> float:
        settings = {"stretch": stretch, "blur_px": blur_px, parameter: value}
        board = frame_errors(clips, [METHODS[name].model_copy(update=settings)], (photons,))
        return float(np.exp(np.log(board.by_scene()[MEAN]).mean()))

    noise, value, found = ("anscombe", 3.0), getattr(METHODS[name], parameter), {}
    for photons in sorted(PHOTONS_PER_PX, reverse=True):
        before = None
        while before != (noise, value):
            before = noise, value
            choices = product(("none", "anscombe"), BLURS_PX)
            noise = min(choices, key=lambda each: error(photons, *each, value))
            value = min(values, key=lambda each: error(photons, *noise, each))
        least = round(error(photons, *noise, value), 4)
        names = ("stretch", "blur_px", parameter, "error_px")
        found[photons] = dict(zip(names, (*noise, value, least), strict=True))
    print(yaml.safe_dump({name: dict(sorted(found.items()))}, sort_keys=False))


if __name__ == "__main__":
    main(sys.argv[1])
