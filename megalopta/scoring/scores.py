"""Scores of a folder of flow: by sequence and overall, for every pass."""

import hashlib
import math
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from pydantic import FiniteFloat, NonNegativeInt, PositiveInt

from megalopta.errors import UserError
from megalopta.flow.files import read_flow
from megalopta.flow.metrics import GROUPS, DenseError, DenseErrors
from megalopta.progress import progress
from megalopta.record import Record
from megalopta.scoring.pairing import Frame, TrueFlow, Truths, submitted_flows, true_flows

Number = FiniteFloat | None
"""None where no pixel is of the group"""


class GroupErrors(Record, frozen=True):
    """Errors of a group of pixels: the fields of `flow.metrics.DenseError`."""

    pixels: NonNegativeInt
    epe_px: Number
    epe_of_images_px: Number
    epe_rms_px: Number
    over_1px_percent: Number
    over_3px_percent: Number
    over_5px_percent: Number
    fl_percent: Number
    wauc_percent: Number
    angular_deg: Number
    missing_percent: Number


Groups = Mapping[str, GroupErrors]
"""By group of pixels, of `flow.metrics.GROUPS`"""


class Entry(Record, frozen=True):
    """A program's flow over one pass, as a line of the leaderboard."""

    program: str
    pass_name: str
    """Sintel's "clean" or "final"; empty where there is none"""
    truth: str
    """Name of the folder of the true flow"""
    truth_hash: str
    """Of all its files: only entries with the same one can be compared"""
    frames: PositiveInt
    overall: Groups


class Scores(Record, frozen=True):
    """An entry for each pass, and the errors of every sequence."""

    entries: tuple[Entry, ...]
    sequences: tuple[Mapping[str, Groups], ...]
    """By name, of each entry"""


def score_submission(flow: str | Path, truth: str | Path, program: str | None = None) -> Scores:
    """Score the flow that a program wrote against the true flow of a dataset.

    Parameters
    ----------
    flow
        Folder of `.flo`, `.flo5`, `.pfm`, `.npy` or KITTI's PNG files (px per frame), in the
        layout of Sintel (with or without a folder for each pass), KITTI or Middlebury.
    truth
        Folder of a dataset of megalopta, of Sintel, KITTI or Middlebury.
    program
        Name of what wrote the flow; that of its folder if left out.

    Raises
    ------
    UserError
        When frames have no file or files no frame, when a file is damaged or of another size.
    """
    flow, truth = Path(flow), Path(truth)
    for folder in (flow, truth):
        if not folder.is_dir():
            raise UserError(f"{folder}: no such folder")
    truths = true_flows(truth)
    passes = submitted_flows(flow, truths)
    digest = _digest(truths)
    entries, sequences = [], []
    with progress("Scoring flow", sum(map(len, passes.values())), "frame") as advance:
        for name, paths in sorted(passes.items()):
            by_sequence = _by_sequence(paths, truths, advance)
            entry = Entry(
                program=program or flow.resolve().name,
                pass_name=name,
                truth=truth.resolve().name,
                truth_hash=digest,
                frames=len(paths),
                overall=_groups(DenseErrors.joined(by_sequence.values())),
            )
            entries.append(entry)
            sequences.append({each: _groups(found) for each, found in by_sequence.items()})
    return Scores(entries=tuple(entries), sequences=tuple(sequences))


def _by_sequence(
    paths: Mapping[Frame, Path], truths: Truths, advance: Callable[[int], object]
) -> dict[str, DenseErrors]:
    found: dict[str, DenseErrors] = {}
    for frame, path in sorted(paths.items()):
        true, occluded = _truth(truths[frame])
        try:
            found.setdefault(frame.sequence, DenseErrors()).add(read_flow(path), true, occluded)
        except ValueError as problem:
            text = str(problem)
            raise UserError(text if str(path) in text else f"{path}: {text}") from None
        advance(1)
    return found


def _truth(files: TrueFlow) -> tuple[NDArray[np.float32], NDArray[np.bool_] | None]:
    try:
        true, occluded = read_flow(files.flow), None
        if files.undefined:
            true[_mask(files.undefined, true.shape)] = np.nan
        if files.occlusion:
            occluded = _mask(files.occlusion, true.shape)
        if files.visible:
            occluded = np.isnan(read_flow(files.visible)[..., 0])
    except (ValueError, OSError) as problem:
        raise UserError(f"the truth cannot be read: {problem}") from None
    return true, occluded


def _mask(path: Path, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    with Image.open(path) as image:
        mask = np.asarray(image.convert("L")) > 0
    if mask.shape != shape[:2]:
        raise ValueError(f"{path} is {mask.shape[1]} × {mask.shape[0]} px, its flow is not")
    return mask


def _groups(errors: DenseErrors) -> dict[str, GroupErrors]:
    return {name: _record(errors.of(name)) for name in GROUPS}


def _record(error: DenseError) -> GroupErrors:
    values = {name: None if math.isnan(value) else value for name, value in asdict(error).items()}
    return GroupErrors.model_validate(values)


def _digest(truths: Truths) -> str:
    digest = hashlib.blake2b(digest_size=8)
    for frame, true in sorted(truths.items()):
        digest.update("/".join(frame).encode())
        for path in filter(None, true):
            with path.open("rb") as file:
                digest.update(hashlib.file_digest(file, "blake2b").digest())
    return digest.hexdigest()
