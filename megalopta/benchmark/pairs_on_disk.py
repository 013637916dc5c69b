"""Pairs of pictures and true flow on disk, in the layouts of Sintel, KITTI and Middlebury.

A frame is identified by its sequence (the folders above its file) and its name. Sintel submissions
have a folder per pass (clean, final) above the sequences; any such folder is scored separately.
Middlebury keeps NAME/flow10.flo with NAME/frame10.png and frame11.png, or in another folder. A
dataset of megalopta has Sintel's layout. Pictures are read as sRGB and converted to light, colors
to luminance.
"""

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from megalopta.benchmark.clips import FlowClip
from megalopta.core.arrays import Floats, Mask
from megalopta.core.errors import UserError
from megalopta.core.pictures import read_codes
from megalopta.dataset.layout import Tree
from megalopta.flow.formats import FLOW_SUFFIXES, read_flow
from megalopta.scenes.spectra.color import LUMINANCE_SHARES, decode_srgb
from megalopta.stages.ledger import Ledger

_NUMBERED = re.compile(r"frame_?(\d{1,9})")


class FrameName(NamedTuple):
    """Identity of a frame: Sintel's `frame0001`, megalopta's `frame_0001`, KITTI's `000000_10`."""

    sequence: str
    name: str


class TrueFlow(NamedTuple):
    """Files of the truth of one frame."""

    flow: Path
    occlusion: Path | None = None
    """Mask, white where hidden in the next frame; Sintel"""
    undefined: Path | None = None
    """Mask, white where not scored; Sintel"""
    visible: Path | None = None
    """Flow of pixels visible in the next frame only; KITTI"""


Truths = Mapping[FrameName, TrueFlow]

Files = tuple[Path, Path, TrueFlow]
"""First picture, second picture, truth"""

Pair = TypeVar("Pair")


def true_flows(root: Path) -> Truths:
    """Find the true flow below a folder: a dataset of megalopta or Sintel, KITTI, or flow files.

    Raises UserError if there is none, or a dataset's files differ from its record.
    """
    _compare_with_record(root)
    found: dict[FrameName, TrueFlow] = {}
    for folder in sorted(path for path in [root, *root.glob("*")] if path.is_dir()):
        if (folder / "flow_occ").is_dir():
            visible = _frames_below(folder / "flow_noc")
            for frame, path in _frames_below(folder / "flow_occ").items():
                found[frame] = TrueFlow(path, visible=visible.get(frame))
        elif (folder / "flow").is_dir():
            for frame, path in _frames_below(folder / "flow").items():
                name = Path(frame.sequence) / f"{frame.name}.png"
                masks = (folder / kind / name for kind in ("occlusions", "invalid"))
                found[frame] = TrueFlow(path, *(mask if mask.exists() else None for mask in masks))
    if not found:
        found = {frame: TrueFlow(path) for frame, path in _frames_below(root).items()}
    if not found:
        raise UserError(
            f"{root}: no true flow; give a dataset, or a folder in the layout of Sintel"
            " (flow/SEQUENCE/frame_0001.flo), KITTI (flow_occ/000000_10.png) or Middlebury"
        )
    return found


def _compare_with_record(root: Path) -> None:
    """Compare the files below `training` of the dataset around a folder, if there is one."""
    above = (root.resolve(), *root.resolve().parents)
    for home in (folder for folder in above if (folder / "dataset.yaml").is_file()):
        tree = Tree(home)
        if tree.lone:
            Ledger(tree.lone).finished()
        elif lost := tree.read_manifest().keys() - set(tree.names()):
            raise UserError(f"{tree.record_path(min(lost))} is missing; run: {tree.make_again}")
        for name in [] if tree.lone else tree.names():
            tree.opened(name).compare_all("training/")


def submitted_flows(root: Path, truths: Truths) -> Mapping[str, Mapping[FrameName, Path]]:
    """Pair the flow files below a folder with the truth, by pass; "" if there is no pass folder.

    Raises UserError if a frame of the truth has no file, or a file has no frame.
    """
    sequences = {frame.sequence for frame in truths}
    passes: dict[str, dict[FrameName, Path]] = {}
    for frame, path in _frames_below(root).items():
        name, _, rest = frame.sequence.partition("/")
        is_within = frame.sequence not in sequences and rest in sequences
        found = passes.setdefault(name if is_within else "", {})
        found[FrameName(rest, frame.name) if is_within else frame] = path
    if not passes:
        raise UserError(f"{root}: no flow files; give {', '.join(FLOW_SUFFIXES)}")
    for name, found in passes.items():
        _check_pairs(root / name, found, truths)
    return passes


def pictures_of(truths: Truths) -> Mapping[str, Mapping[FrameName, tuple[Path, Path]]]:
    """Find both pictures of every frame, by pass: Sintel's clean and final, KITTI's image_2.

    Raises UserError if there are none.
    """
    found: dict[str, dict[FrameName, tuple[Path, Path]]] = {"clean": {}, "final": {}, "": {}}
    for frame, files in truths.items():
        for name, pair in _pictures(frame, files.flow).items():
            if all(path.exists() for path in pair):
                found[name][frame] = pair
    whole = {name: pairs for name, pairs in found.items() if len(pairs) == len(truths)}
    if not whole:
        raise UserError(
            "the truth lacks pictures of some frames (clean/, final/, or KITTI's image_2/): "
            "write the flow to files, and give their folder"
        )
    return whole


def pairs_below(folder: Path) -> dict[str, Files]:
    """Return the files of all pairs of a dataset, by name. Raises UserError without any."""
    if not folder.is_dir():
        raise UserError(f"{folder}: no such folder")
    if middlebury := dict(_middlebury(folder)):
        return middlebury
    truths = true_flows(folder)
    pictures = next(iter(pictures_of(truths).values()))  # of Sintel's passes, the clean one
    return {
        "/".join(filter(None, frame)): (*pictures[frame], truths[frame]) for frame in sorted(truths)
    }


def evenly_spread(pairs: dict[str, Pair], most: int) -> dict[str, Pair]:
    """Return at most `most` pairs, evenly spaced."""
    names = list(pairs)
    chosen = np.unique(np.linspace(0, len(names) - 1, min(most, len(names))).round().astype(int))
    return {names[index]: pairs[names[index]] for index in chosen}


def read_pair(name: str, files: Files) -> FlowClip:
    """Return a pair as a clip of two frames, from first picture, second picture and truth.

    Raises UserError if a file is damaged or of the wrong size.
    """
    first, second, truth = files
    flow, hidden = read_true_flow(truth)
    frames = [_light(path) for path in (first, second)]
    for path, frame in zip((first, second), frames, strict=True):
        if frame.shape != flow.shape[:2]:
            raise UserError(
                f"{path} has {frame.shape[1]} × {frame.shape[0]} px, {truth.flow} has"
                f" {flow.shape[1]} × {flow.shape[0]}: give pictures and flow of one size"
            )
    light = np.stack(frames)
    if not light.any():
        raise UserError(f"{first} and {second} are black; give brighter pictures")
    return FlowClip(name, light / light.mean(), flow.astype(np.float64), hidden)


def read_true_flow(files: TrueFlow) -> tuple[NDArray[np.float32], Mask | None]:
    """Return the true flow (H, W, 2), NaN where not scored, and where it is hidden, if known.

    Raises UserError if a file is damaged or of another size.
    """
    path = files.flow
    try:
        true, hidden = read_flow(path), None
        if files.undefined:
            true[_mask(path := files.undefined, true.shape)] = np.nan
        if files.occlusion:
            hidden = _mask(path := files.occlusion, true.shape)
        if files.visible:
            hidden = np.isnan(read_flow(path := files.visible)[..., 0])
    except OSError as problem:
        reason = (problem.strerror or str(problem)).lower()
        raise UserError(f"{path} cannot be read ({reason}); give a file of true flow") from None
    except ValueError as problem:
        raise UserError(f"the truth cannot be read: {problem}") from None
    return true, hidden


def _mask(path: Path, shape: tuple[int, ...]) -> Mask:
    mask = read_codes(path, "L") > 0
    if mask.shape != shape[:2]:
        raise ValueError(f"{path} is {mask.shape[1]} × {mask.shape[0]} px, its flow is not")
    return mask


def _pictures(frame: FrameName, flow: Path) -> dict[str, tuple[Path, Path]]:
    numbered = re.fullmatch(r"(.*?)(\d+)", flow.stem)
    if not numbered:
        return {}
    start, number = numbered.groups()
    after = f"{start}{int(number) + 1:0{len(number)}d}.png"
    levels = len(Path(frame.sequence).parts)
    root = flow.parents[levels + 1]
    folders = (
        {"": root / "image_2"}
        if flow.parents[levels].name == "flow_occ"
        else {name: root / name for name in ("clean", "final")}
    )
    return {
        name: (folder / frame.sequence / f"{flow.stem}.png", folder / frame.sequence / after)
        for name, folder in folders.items()
    }


def _check_pairs(root: Path, found: Mapping[FrameName, Path], truths: Truths) -> None:
    if unknown := sorted(found.keys() - truths.keys()):
        sequences = ", ".join(sorted({frame.sequence for frame in truths})[:3])
        raise UserError(
            f"{found[unknown[0]]} matches no frame of the truth, whose sequences are"
            f" {sequences}: remove it, or give the folder above the sequences"
        )
    if missing := sorted(truths.keys() - found.keys()):
        raise UserError(
            f"{root} lacks {len(missing)} of {len(truths)} frames, the first is"
            f" {'/'.join(filter(None, missing[0]))}: every frame must be there to be compared"
        )


def _frames_below(root: Path) -> dict[FrameName, Path]:
    paths = [path for path in sorted(root.rglob("*")) if path.suffix.lower() in FLOW_SUFFIXES]
    if len(suffixes := {path.suffix.lower() for path in paths}) > 1:
        raise UserError(f"{root} holds {' and '.join(sorted(suffixes))}: give one format")
    found: dict[FrameName, Path] = {}
    for path in paths:
        number = _NUMBERED.fullmatch(path.stem)
        name = f"frame_{int(number[1]):04d}" if number else path.stem
        frame = FrameName(path.parent.relative_to(root).as_posix().removeprefix("."), name)
        if frame in found:
            raise UserError(f"{path} and {found[frame]} are the same frame: give one")
        found[frame] = path
    return found


def _middlebury(folder: Path) -> Iterator[tuple[str, Files]]:
    first_of: dict[str, Path] = {}
    for path in sorted(folder.rglob("frame10.png")):
        if path.with_name("frame11.png").exists():
            first_of.setdefault(path.parent.name, path)
    for flow in sorted(folder.rglob("flow10.flo")):
        if first := first_of.get(flow.parent.name):
            yield flow.parent.name, (first, first.with_name("frame11.png"), TrueFlow(flow))


def _light(path: Path) -> Floats:
    """Return the luminance of a picture, (H, W), from 0 to 1."""
    return np.asarray(decode_srgb(read_codes(path, "RGB")) @ LUMINANCE_SHARES)
