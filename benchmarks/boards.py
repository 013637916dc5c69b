"""Errors of whole-frame methods on scenes of this project.

`python benchmarks/boards.py OUT.csv ramp20 shadow` measures undisturbed light and, if named, these
disturbances (`megalopta.benchmark.disturbances`), and prints both tables of
docs/results/whole-frames.md.

Four sets: dead leaves in affine motion with three disks in front, views of the shipped forest
panoramas from a camera that turns, pictures of scikit-image in layers whose disks move by up to
18 px, and its stereo pair. No method is tuned on them; `benchmarks/tune.py` has those for tuning.
"""

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import tune
from skimage import data

from megalopta.assets_gen import generator
from megalopta.assets_gen.surface_textures import dead_leaves
from megalopta.benchmark.clips import FlowClip
from megalopta.benchmark.disturbances import disturbance
from megalopta.benchmark.panoramas import NATURAL_PANORAMAS, natural_template
from megalopta.benchmark.table import FAR, MEAN, MEDIAN
from megalopta.benchmark.whole_frames import UNDISTURBED, frame_errors, write_board
from megalopta.flow.stimuli.known_flow import Layer, MovingLayers
from megalopta.scenes.spectra.color import LUMINANCE_SHARES, linear_of_srgb

METHODS = "PF", "PF-fast", "DeepFlow √", "DIS √"
PHOTONS_PER_PX = (1, 10, 100, 1000)
SHAPE = tune.SHAPE = (240, 240)
BAR = "\xa0\\|\xa0"


def clips() -> Iterator[FlowClip]:
    """Yield the scenes of all sets."""
    for seed in range(3000, 3006):
        rng = generator(seed, "board, leaves")
        texture = dead_leaves((700, 700), rng, (6.0, 160.0))
        yield moving(f"leaves {seed}", rng, texture, 4.0, "dead leaves")
    for number, name in enumerate(NATURAL_PANORAMAS):
        rng = generator(number, "board, forests")
        panorama = np.pad(natural_template(name), ((0, 251), (0, 0)), "symmetric")
        turn = Layer(panorama, (rng.uniform(1, 6), rng.uniform(-2, 2)), np.zeros((2, 2)))
        yield clip(name, MovingLayers([turn]), "forests, turning camera")
    for number, name in enumerate(("brick", "gravel", "moon", "page", "text", "cell")):
        rng = generator(number, "board, layers")
        gray = getattr(data, name)() / 255
        texture = np.pad(linear_of_srgb(gray), [(0, side) for side in gray.shape], "symmetric")
        yield moving(name, rng, texture + 0.05, 18.0, "pictures in layers")
    left, right, disparity = data.stereo_motorcycle()
    light = np.stack([linear_of_srgb(view / 255) @ LUMINANCE_SHARES for view in (left, right)])
    halved = light[..., :740].reshape(2, 250, 2, 370, 2).mean(axis=(2, 4))
    to_left = -np.where(np.isfinite(disparity), disparity, np.nan)[::2, :740:2] / 2
    flow = np.stack((to_left, 0 * to_left), axis=-1)
    yield FlowClip("motorcycle", halved / halved.mean(), flow, set_name="stereo")


def moving(
    name: str, rng: np.random.Generator, texture: np.ndarray, fastest_px: float, set_name: str
) -> FlowClip:
    """Return a texture in affine motion, and three disks of it in others."""
    scene = tune.in_layers(name, rng, texture, fastest_px)
    return FlowClip(name, scene.light[3:5], scene.flow, scene.hidden, set_name=set_name)


def clip(name: str, scene: MovingLayers, set_name: str) -> FlowClip:
    """Return two frames of a scene in which nothing is hidden."""
    light = scene.light(SHAPE, range(2))
    return FlowClip(name, light / light.mean(), scene.flow(SHAPE, 0), set_name=set_name)


def print_sets(errors: pd.DataFrame) -> None:
    """Print mean, median and share beyond 3 px by set, method and photons; the lowest are bold."""
    for name, pairs in [("all", errors), *errors.groupby("set", sort=False)]:
        means = pairs.groupby(["photons", "method"])[[MEAN, MEDIAN, FAR]].mean()
        lowest, label = means.groupby("photons").min(), f" {name}, {pairs['unit'].nunique()}"
        for method in METHODS:
            cells = [
                BAR.join(
                    cell(means.loc[(photons, method), of], lowest.loc[photons, of], form)
                    for of, form in ((MEAN, "{:.2f}"), (MEDIAN, "{:.2f}"), (FAR, "{:.0%}"))
                )
                for photons in PHOTONS_PER_PX
            ]
            print(f"|{label} | {method} | {' | '.join(cells)} |".replace("%", ""))
            label = ""


def print_disturbed(errors: pd.DataFrame) -> None:
    """Print the mean errors of the slower methods by disturbance and photons."""
    for name, pairs in errors[errors["method"] != "PF-fast"].groupby("group", sort=False):
        means = pairs.groupby(["photons", "method"], sort=False)[MEAN].mean().unstack()
        cells = [
            BAR.join(cell(value, row.min(), "{:.2f}") for value in row)
            for _, row in means.iterrows()
        ]
        print(f"| {name} | {' | '.join(cells)} |")


def cell(value: float, lowest: float, form: str) -> str:
    """Format a value, bold if no other is lower."""
    return f"**{form.format(value)}**" if value == lowest else form.format(value)


def main(path: str, *disturbances: str) -> None:
    chosen = list(map(disturbance, disturbances))
    board = frame_errors(list(clips()), METHODS, PHOTONS_PER_PX, disturbances=chosen)
    write_board(Path(path), board)
    errors = board.by_draw
    print_sets(errors[errors["group"] == UNDISTURBED])
    print_disturbed(errors)


if __name__ == "__main__":
    main(*sys.argv[1:])
