"""Pairs of pictures with true flow, from files: two pictures and a flow, or a dataset's folder.

Layouts: Middlebury's (NAME/flow10.flo beside or in another folder than NAME/frame10.png and
frame11.png), Sintel's, which is also that of a dataset of megalopta, and KITTI's. Pictures are read
as sRGB and taken back to light; of color the luminance counts.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from megalopta.benchmark.pairing import pictures_of, true_flows
from megalopta.benchmark.whole_frame_scenes import Clip
from megalopta.core.arrays import Floats
from megalopta.core.errors import UserError
from megalopta.core.pictures import read_picture
from megalopta.flow.files.formats import read_flow
from megalopta.scenes.spectra.color import decode_srgb
from megalopta.scenes.spectra.primaries import LUMINANCE_SHARES

Files = tuple[Path, Path, Path]
"""First picture, second picture, flow"""


def pairs_below(folder: Path) -> dict[str, Files]:
    """Return the files of all pairs of a dataset, by name. Raises UserError without any."""
    if not folder.is_dir():
        raise UserError(f"{folder}: no such folder")
    if middlebury := dict(_middlebury(folder)):
        return middlebury
    truths = true_flows(folder)
    pictures = next(iter(pictures_of(truths).values()))  # of Sintel's passes the clean one
    return {
        "/".join(filter(None, frame)): (*pictures[frame], truths[frame].flow)
        for frame in sorted(truths)
    }


def spread(pairs: dict[str, Files], most: int) -> dict[str, Files]:
    """Return at most so many pairs, evenly spread over all."""
    names = list(pairs)
    chosen = np.unique(np.linspace(0, len(names) - 1, min(most, len(names))).round().astype(int))
    return {names[index]: pairs[names[index]] for index in chosen}


def read_pair(name: str, files: Sequence[Path]) -> Clip:
    """Return a pair as a clip of two frames. Raises UserError when a file is not what it should be.

    Parameters
    ----------
    name
    files
        First picture, second picture, flow.
    """
    first, second, truth = files
    try:
        flow = read_flow(truth).astype(np.float64)
    except OSError as problem:
        reason = (problem.strerror or str(problem)).lower()
        raise UserError(f"{truth} cannot be read ({reason}); give a file of true flow") from None
    except ValueError as problem:
        raise UserError(str(problem)) from None
    frames = [_light(path) for path in (first, second)]
    for path, frame in zip((first, second), frames, strict=True):
        if frame.shape != flow.shape[:2]:
            raise UserError(
                f"{path} has {frame.shape[1]} × {frame.shape[0]} px, {truth} has"
                f" {flow.shape[1]} × {flow.shape[0]}: give pictures and flow of one size"
            )
    light = np.stack(frames)
    if not light.any():
        raise UserError(f"{first} and {second} are black; give pictures with light in them")
    return Clip(name, light / light.mean(), flow)


def _middlebury(folder: Path) -> Iterator[tuple[str, Files]]:
    first_of: dict[str, Path] = {}
    for path in sorted(folder.rglob("frame10.png")):
        if path.with_name("frame11.png").exists():
            first_of.setdefault(path.parent.name, path)
    for flow in sorted(folder.rglob("flow10.flo")):
        if first := first_of.get(flow.parent.name):
            yield flow.parent.name, (first, first.with_name("frame11.png"), flow)


def _light(path: Path) -> Floats:
    """Return the luminance of a picture, (H, W), from 0 to 1."""
    return np.asarray(decode_srgb(read_picture(path, "RGB")) @ LUMINANCE_SHARES)
