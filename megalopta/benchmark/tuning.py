"""Settings of gray methods for each light, chosen by one routine on scenes that no board reports.

`tuned.yaml` holds, for each method and photons per pixel, the stretch of counts, the blur and the
main parameter of least error on the tuning scenes: the geometric mean over scenes, so that each
counts alike, of the mean over blocks. Stretch and blur together, and the main parameter, are varied
in turn until neither improves, from the settings for the next brighter light. Other methods, such
as a network in an ONNX file, have stretch and blur alone, and a `tuned.yaml` of the user's. The
scenes: dead leaves of other seeds than those of the boards, and pictures of scikit-image that no
benchmark shows (grass, galaxies, coins, a retina), both in layers, whose disks move by up to 4 px
in half of them and by up to 12 px in the others.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from megalopta.assets_gen import generator
from megalopta.benchmark.clips import FlowClip, layers_clip, leaves_clip
from megalopta.benchmark.methods import identity
from megalopta.benchmark.tuned_method import ERROR, PARAMETERS, Settings, gray_method
from megalopta.benchmark.whole_frames import MEAN, frame_errors
from megalopta.config.yaml_model import mapping, yaml_text
from megalopta.core import files, strict_yaml
from megalopta.core.array_store import ArrayStore
from megalopta.core.errors import refused_as
from megalopta.core.freshness import code_digest, digest
from megalopta.core.progress import progress
from megalopta.flow.detectors.gray_detector import GrayDetector
from megalopta.scenes.spectra.color import LUMINANCE_SHARES, decode_srgb

SHAPE = (168, 168)
LEAVES = (1000, 1001, 1002, 1003)
"""Seeds"""
PICTURES = ("grass", "hubble_deep_field", "coins", "retina")
_FASTEST_PX = (4.0, 12.0)

_BLURS_PX = (0.0, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0)
NOISE = tuple(
    {"stretch": stretch, "blur_px": blur}
    for stretch, blur in product(("none", "anscombe"), _BLURS_PX)
)
"""Stretches and blurs"""
_MOST_BYTES = 10**7
"""Size limit of the kept errors"""


def tune(
    name: str,
    fluxes: Sequence[float],
    scenes: Sequence[FlowClip] | None = None,
    after_light: Callable[[], object] = lambda: None,
    folder: Path | None = None,
) -> dict[float, Settings]:
    """Return the best settings of a method for each flux, with their error.

    Errors are kept in a folder, if there is one, from which an interrupted run resumes.
    """
    gray, clips = gray_method(name), list(tuning_clips()) if scenes is None else scenes
    parameter, values = PARAMETERS.get(gray.name, ("", ()))
    choices = NOISE, *([tuple({parameter: value} for value in values)] if values else [])
    best: Settings = NOISE[-1] | ({parameter: getattr(gray, parameter)} if values else {})
    error, found = _kept_errors(gray, clips, folder), {}
    for flux in sorted(fluxes, reverse=True):
        best, least = _least(partial(error, flux), best, choices)
        found[flux] = {**best, ERROR: round(least, 4)}
        after_light()
    return dict(sorted(found.items()))


def write_tuned(path: Path, name: str, fluxes: Sequence[float]) -> dict[float, Settings]:
    """Tune a method and write its settings to a YAML file; other methods of the file stay.

    An interrupted run resumes from the errors in the folder `NAME-errors` next to `NAME.yaml`.
    Raises UserError if the method cannot be tuned.
    """
    kept = mapping(yaml_text(path, "file of settings"), str(path)) if path.exists() else {}
    with refused_as():
        key = gray_method(name).name
    folder = path.with_name(f"{path.stem}-errors")
    with progress(f"Tuning {key}", len(fluxes), "light level") as advance:
        found = tune(name, fluxes, after_light=lambda: advance(1), folder=folder)
    files.write_text(path, strict_yaml.dump({**kept, key: found}))
    return found


def tuning_clips() -> Iterator[FlowClip]:
    """Yield the tuning scenes; those at odd places have large motion."""
    from skimage import data

    for number, seed in enumerate(LEAVES):
        yield leaves_clip(seed, SHAPE, _FASTEST_PX[number % 2])
    for number, name in enumerate(PICTURES):
        codes = getattr(data, name)() / 255
        light = decode_srgb(codes)
        gray = light if light.ndim == 2 else light @ LUMINANCE_SHARES
        sides = [(0, side) for side in gray.shape]
        texture = np.pad(gray, sides, mode="symmetric")  # tiles the plane without a seam
        rng = generator(number, "tuning", name)
        yield layers_clip(f"tuning {name}", rng, texture, SHAPE, _FASTEST_PX[number % 2])


def _kept_errors(
    method: GrayDetector, clips: Sequence[FlowClip], folder: Path | None
) -> Callable[[float, Settings], float]:
    """Return a function of flux and settings, the error of which is kept in a folder."""
    code = code_digest("megalopta.flow", "megalopta.sensor.sampling", __package__)
    scenes = digest(code, *(each.tobytes() for clip in clips for each in (clip.light, clip.flow)))

    def error(flux: float, settings: Settings) -> float:
        detector = method.model_copy(update=settings)
        store = ArrayStore(folder, digest(scenes, identity(detector), repr(flux)), _MOST_BYTES)
        kept = store.read([ERROR])
        if kept is None:
            store.write(kept := {ERROR: np.array(_error(clips, detector, flux))})
        return float(kept[ERROR])

    return error


def _error(clips: Sequence[FlowClip], detector: GrayDetector, flux: float) -> float:
    """Return the geometric mean over scenes of the mean error over blocks, px."""
    board = frame_errors(clips, [detector], (flux,))
    return float(np.exp(np.log(board.of_scenes(MEAN, board.detectors[0], flux)).mean()))


def _least(
    error: Callable[[Settings], float], start: Settings, choices: Iterable[Sequence[Settings]]
) -> tuple[Settings, float]:
    """Return the settings that no choice of one kind improves, and their error."""
    known: dict[tuple[Any, ...], float] = {}

    def measured(settings: Settings) -> float:
        values = tuple(settings.values())
        if values not in known:
            known[values] = error(settings)
        return known[values]

    best, before = start, None
    while best != before:
        before = best
        for kind in choices:
            best = min(({**best, **each} for each in kind), key=measured)
    return best, measured(best)
