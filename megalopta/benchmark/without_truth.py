"""Methods on pictures of unknown true flow: distances from a stand-in, and from each other.

The stand-in is the flow by one method, the reference, between the pictures without photon noise. It
is not the truth: the reference and similar methods repeat its errors on counts, so it favors them.
The other measure favors no method: of three or more methods, the distance from the median of all
others on the same photons. Methods that agree may share an error, and one that is right alone is
far from the rest.

Both are given like errors: of blocks of 24 × 24 px, by photons per pixel and frame.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import TypeAlias

import numpy as np

from megalopta.benchmark.clips import FlowClip
from megalopta.benchmark.methods import block_detector, methods_and_baselines
from megalopta.benchmark.pairs_on_disk import evenly_spread
from megalopta.benchmark.table import Samples, gathered, measure_samples
from megalopta.benchmark.whole_frames import (
    FAR,
    MEAN,
    MEDIAN,
    Board,
    answers,
    blocks_of,
    distances,
    measures,
    write_board,
)
from megalopta.core.arrays import Floats
from megalopta.core.bounded import check_decoded
from megalopta.core.errors import UserError, refused_as
from megalopta.core.pictures import SENSED_BYTES
from megalopta.core.progress import progress, say
from megalopta.flow.detectors.base import Frames
from megalopta.flow.detectors.blocks import BlockDetector
from megalopta.flow.detectors.registry import Method
from megalopta.render import Footage, open_footage
from megalopta.scenes.stimuli.pictures import Unit

FROM_STAND_IN, FROM_OTHERS = (
    {MEDIAN: f"median_px_{of}", MEAN: f"mean_px_{of}", FAR: f"{FAR}_{of}"}
    for of in ("from_stand_in", "from_others")
)
"""Metrics against the stand-in, and against the median of the other methods, by the corresponding
metric of an error."""

_CLEAN_PHOTONS = 1000.0
"""Photons per pixel of the noise-free light that the reference sees."""
_PAIR_FRAMES = 2
_KEY = "pairs without truth"

_Light: TypeAlias = Callable[[], Floats]
"""Returns the luminance (H, W) of a picture when needed."""


def pairs_without_truth(
    stack: ExitStack, paths: Sequence[Path], most: int, unit: Unit | None = None
) -> dict[str, tuple[_Light, _Light]]:
    """Return two pictures, or at most `most` evenly spaced pairs of successive frames, by name.

    The stack closes opened files. Raises UserError if there are not two frames.
    """
    opened = [stack.enter_context(open_footage(path, unit)) for path in paths]
    for footage in opened:
        check_decoded(footage.path, footage.shape, SENSED_BYTES)
    for note in dict.fromkeys(note for each in opened for note in each.notes):
        say(note)
    if len(opened) == 2:
        return {paths[0].stem: _two(*opened)}
    if len(opened) != 1:
        raise UserError(
            f"benchmark pairs: {len(paths)} paths; without truth, give two pictures, a folder of "
            "pictures or a video"
        )
    (footage,) = opened
    if len(footage) < _PAIR_FRAMES:
        raise UserError(f"{footage.path} has one frame; give two pictures, or a video")
    lights: list[_Light] = [partial(_luminance, footage, k) for k in range(len(footage))]
    steps = {f"{paths[0].stem} {k}": pair for k, pair in enumerate(pairwise(lights))}
    return evenly_spread(steps, most)


def distances_of_pairs(
    pairs: Mapping[str, tuple[_Light, _Light]],
    fluxes: Sequence[float],
    reference: Method,
    methods: Sequence[Method] | None = None,
    draws: int = 1,
) -> Board:
    """Return distances of methods, by default all two-frame methods, from both references.

    Metrics are those of `FROM_STAND_IN` and, for three or more methods, of `FROM_OTHERS`. Raises
    UserError if pictures or methods cannot be used, or no picture has any contrast.
    """
    with progress("Drawing photons", len(pairs), "pair") as advance, refused_as():
        detectors = tuple(map(block_detector, methods or methods_and_baselines(_PAIR_FRAMES)))
        standing_in = block_detector(reference)
        found: dict[str, Samples] = {}
        for name, lights in pairs.items():
            if (clip := _clip(name, lights, standing_in)) is not None:
                draw, apart = (
                    partial(clip.counts, key=(_KEY,)),
                    partial(_distances, detectors, clip),
                )
                found[name] = measure_samples(draw, apart, fluxes, draws)
            advance()
    if not found:
        raise UserError(f"{', '.join(pairs)}: no contrast; give pictures with texture")
    return Board(tuple(found), detectors, tuple(fluxes), gathered(found.values()))


def has_others(board: Board) -> bool:
    """Return True if each method has several others, which have a median."""
    return len(board.detectors) > 2


def write_distances(path: Path, board: Board, reference: Method) -> None:
    """Write a row per pair, method and flux, as CSV: means over the draws of the pair."""
    metrics = [*FROM_STAND_IN.values(), *(FROM_OTHERS.values() if has_others(board) else ())]
    name = block_detector(reference).name
    stand_in = f"not the truth but {name} on the pictures without noise, which favors {name}"
    write_board(path, board, metrics, stand_in)


def _distances(
    detectors: Sequence[BlockDetector], clip: FlowClip, counts: Frames, _: float
) -> Iterator[tuple[str, str, Floats]]:
    """Yield the distances of methods from both references, px per frame."""
    stand_in = blocks_of(clip)
    known = np.isfinite(stand_in).all(axis=-1)
    given = {each.name: answers(each, clip, counts) for each in detectors}
    for name, own in given.items():
        references = [(FROM_STAND_IN, stand_in)]
        others = [each for other, each in given.items() if other != name]
        if len(others) > 1:
            references.append((FROM_OTHERS, np.median(others, axis=0)))
        for names, reference in references:
            for measure, values in measures(distances(own, reference)[known]):
                yield names[measure], name, values


def _two(first: Footage, second: Footage) -> tuple[_Light, _Light]:
    for each in (first, second):
        if len(each) > 1:
            raise UserError(f"{each.path} has {len(each)} frames; give it alone, or two pictures")
    if first.shape != second.shape:
        sizes = (f"{each.shape[1]} × {each.shape[0]}" for each in (first, second))
        raise UserError(
            f"{first.path} and {second.path} have {' and '.join(sizes)} px; give one size"
        )
    return partial(_luminance, first, 0), partial(_luminance, second, 0)


def _luminance(footage: Footage, index: int) -> Floats:
    return np.asarray(footage.frame(index) @ footage.luminance_shares, np.float64)


def _clip(name: str, lights: tuple[_Light, _Light], reference: BlockDetector) -> FlowClip | None:
    """Return a pair with the stand-in for its flow; None, with a message, if it has no contrast."""
    light = np.stack([each() for each in lights])
    if light.min() == light.max():
        say(f"{name}: both pictures are uniform; skipping the pair")
        return None
    light /= light.mean()
    return FlowClip(name, light, reference.dense(*light * _CLEAN_PHOTONS))
