"""Pairs of pictures with true flow, on disk: light, motion and photons.

A frame is identified by its sequence (the folders above its file) and its name. Sintel submissions
have a folder per pass (clean, final) above the sequences; any such folder is scored separately. A
dataset of megalopta has Sintel's layout. Flow of Spring has twice the size of its frames and is in
their pixels: that at every second row and column is used. Flow beside its pictures may have masks,
named as it is with `occlusions`, `invalid` or `flow_noc` for `flow`.
"""

import re
from bisect import bisect_left
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from itertools import takewhile
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from megalopta.benchmark.disturbances import Disturbance, disturbed_means
from megalopta.core.arrays import Floats, Mask
from megalopta.core.errors import UserError
from megalopta.core.pictures import read_codes
from megalopta.dataset.index import read_lists
from megalopta.dataset.store import Tree
from megalopta.flow.formats import FLOW_SUFFIXES, KITTI_SCALE, read_flow
from megalopta.flow.stimuli.photons import Counts, draw_counts
from megalopta.render import Footage, open_footage
from megalopta.render.footage.pictures import KINDS
from megalopta.sensor.sampling.streams import generator


@dataclass(frozen=True)
class FlowClip:
    """A few frames of light and their motion."""

    name: str
    light: Floats
    """(T, H, W), T even, of mean 1"""
    flow: Floats
    """(H, W, 2), px, between the two frames in the middle, on the pixels of the first"""
    hidden: Mask | None = None
    """(H, W), pixels that something else hides in the second of them; None: unknown"""
    foreground: Mask | None = None
    """(H, W), pixels of moving objects; None: unknown"""
    set_name: str = ""
    """Name of the set of clips that this one belongs to"""
    sequence: str = ""
    """Name of the sequence whose frames they are; if empty, no other clip is of it"""
    notes: tuple[str, ...] = ()
    """What was supposed of its files"""

    def counts(self, flux: float, draw: int, disturbance: Disturbance | None = None) -> Counts:
        """Return a draw (T, H, W) of `flux` photons per pixel, which the name seeds.

        Patterns of a disturbance are the same at every flux.
        """
        means = self.light * flux
        if disturbance:
            rng = generator(0, "disturbance", _BOARD, disturbance.kind, self.name, draw)
            means = disturbed_means(means, disturbance, rng)
        return draw_counts(means, 0, _BOARD, self.name, f"{flux:.6g}", draw)


_BOARD = "whole frames"
"""A part of the seeds"""
_UNCERTAINTY = ".uncertainty.npy"
_NUMBERED = re.compile(r"frame_?(\d{1,9})")
_OF_FLOW = re.compile("flow|(^|[-_])(occlusions|invalid)$")
LAYOUTS = (
    "the layouts of Sintel, KITTI, Middlebury, Spring or FlyingChairs, NAME.flo beside two pictures"
    " NAME_1.png and NAME_2.png, or a folder for each pair (NAME/flow.flo, NAME/first.png,"
    " NAME/second.png)"
)
"""Known layouts, for messages."""


class FrameName(NamedTuple):
    """Identity of a frame: Sintel's `frame0001`, megalopta's `frame_0001`, KITTI's `000000_10`."""

    sequence: str
    name: str


class TrueFlow(NamedTuple):
    """Files of the truth of one frame."""

    flow: Path
    png_scale: float = KITTI_SCALE
    """Codes of a pixel in flow as PNG"""
    masks: Mapping[str, Path] = MappingProxyType({})
    """Pictures by word of `MASKS`"""

    def files(self) -> list[Path]:
        """Return all files of which scores depend."""
        return [self.flow, *(path for word, path in self.masks.items() if word != "obj_map")]


MASKS = ("occlusions", "invalid", "flow_noc", "obj_map")
"""Words for pixels that are hidden in the next frame, that are not scored, for flow of those that
are visible in the next frame (KITTI), and for numbers of moving objects (KITTI 2015)"""
_PICTURES = (
    ("other-gt-flow/(.+)/flow", "", r"other-data/\2/frame"),
    ("other-gt-flow/(.+)/flow", "gray", r"other-data-gray/\2/frame"),
    (r"flow_[FB]W_(\w+)/flow_\w+_", "", r"frame_\2/frame_\2_"),
    ("flow_(?:occ|noc)/(.*)", "", r"image_2/\2"),
    ("flow_(?:occ|noc)/(.*)", "", r"colored_0/\2"),
    ("flow_(?:occ|noc)/(.*)", "", r"image_0/\2"),
    ("flow/(.+)", "clean", r"clean/\2"),
    ("flow/(.+)", "final", r"final/\2"),
)
"""Path of flow up to its number, pass, and path of its pictures up to theirs"""

Truths = Mapping[FrameName, TrueFlow]

Files = tuple[Path, Path, TrueFlow]
"""First picture, second picture, truth"""


def true_flows(root: Path, png_scale: float = KITTI_SCALE) -> Truths:
    """Find the true flow below a folder, in one of `LAYOUTS`, or a folder of flow files.

    Raises UserError if there is none, or a dataset's files differ from its record.
    """
    for home in (root.resolve(), *root.resolve().parents):
        if (home / "dataset.yaml").is_file():
            tree = Tree(home)
            tree.check()
            read_lists(home, tree.names())  # refuses a name without a record
            for sequence in tree.names():
                tree.opened(sequence).compare_all("training/")
    homes: dict[Path, bool] = {}  # folders of flow, and whether pictures may be among it
    for folder in sorted(path for path in [root, *root.glob("*")] if path.is_dir()):
        named = [folder / name for name in ("flow_occ", "flow_noc", "flow")]
        if stored := [home for home in named if home.is_dir()]:
            homes[stored[0]] = False
        elif any(path.is_dir() for path in folder.glob("*/flow_[FB]W_*")):
            homes[folder] = True
    truths = {
        frame: _with_masks(path, png_scale)
        for home, among_pictures in (homes or {root: True}).items()
        for frame, path in _frames_below(home, among_pictures).items()
        if not path.stem.endswith("flow_noc")
    }
    if not truths:
        raise UserError(f"{root}: no true flow; give a dataset, or a folder in {LAYOUTS}")
    return truths


def _with_masks(flow: Path, png_scale: float) -> TrueFlow:
    """Return a flow with its masks, whose folder or name has another word for flow."""
    words = re.fullmatch("(.*)flow(?:_occ|_noc)?(/.*)?", flow.with_suffix("").as_posix())
    start, end = words.groups("") if words else ("", "")
    paths = {word: Path(f"{start}{word}{end}.png") for word in MASKS if words}
    masks = {word: path for word, path in paths.items() if path != flow and path.exists()}
    return TrueFlow(flow, png_scale, masks)


def uncertainty_of(flow: Path) -> Path:
    """Return the path of the expected error of a flow file, (H, W) px, which may not exist."""
    return flow.with_name(f"{flow.stem}{_UNCERTAINTY}")


def submitted_flows(root: Path, truths: Truths) -> Mapping[str, Mapping[FrameName, Path]]:
    """Pair the flow files below a folder with the truth, by pass; "" if there is no pass folder.

    Raises UserError if a frame of the truth has no file, or a file has no frame.
    """
    sequences = {frame.sequence for frame in truths}
    passes: dict[str, dict[FrameName, Path]] = {}
    for frame, path in _frames_below(root).items():
        name, _, sequence = frame.sequence.partition("/")
        is_within = frame.sequence not in sequences and sequence in sequences
        flows = passes.setdefault(name if is_within else "", {})
        flows[FrameName(sequence, frame.name) if is_within else frame] = path
    if not passes:
        raise UserError(f"{root}: no flow files; give {', '.join(FLOW_SUFFIXES)}")
    for name, flows in passes.items():
        if unknown := sorted(flows.keys() - truths.keys()):
            raise UserError(
                f"{flows[unknown[0]]} matches no frame of the truth, whose sequences are"
                f" {', '.join(sorted(sequences)[:3])}: remove it, or give the folder above the"
                " sequences"
            )
        if missing := sorted(truths.keys() - flows.keys()):
            raise UserError(
                f"{root / name} lacks {len(missing)} of {len(truths)} frames, the first is"
                f" {'/'.join(filter(None, missing[0]))}: every frame must be there to be compared"
            )
    return passes


def pictures_of(truths: Truths) -> Mapping[str, Mapping[FrameName, tuple[Path, Path]]]:
    """Find both pictures of every frame, by pass.

    Passes are "clean" and "final" of Sintel, "gray" of Middlebury's pictures without color, and ""
    of all others. Raises UserError if there are none.
    """
    pictures = defaultdict[str, dict[FrameName, tuple[Path, Path]]](dict)
    for frame, files in truths.items():
        for name, pair in _pictures(files.flow).items():
            pictures[name][frame] = pair
    complete = {name: pairs for name, pairs in pictures.items() if len(pairs) == len(truths)}
    if not complete:
        most = max(pictures.values(), key=len, default={})
        lacking = next(files.flow for frame, files in truths.items() if frame not in most)
        raise UserError(
            f"{lacking}: its two pictures are not there, or have other names; known are {LAYOUTS}"
        )
    return complete


def sets_below(folder: Path, png_scale: float = KITTI_SCALE) -> dict[str, dict[str, Files]]:
    """Return the files of all pairs of a folder, by pass and name.

    The folder holds flow and pictures, or only pictures, beside their flow: Sintel's `clean` or
    Middlebury's `other-data`. Raises UserError without pairs.
    """
    if not folder.is_dir():
        raise UserError(f"{folder}: no such folder")
    folder = flows = folder.absolute()
    if folder.name in ("clean", "final") and folder.with_name("flow").is_dir():
        flows = folder.parent
    elif folder.name.startswith("other-data") and folder.with_name("other-gt-flow").is_dir():
        flows = folder.with_name("other-gt-flow")
    truths = true_flows(flows, png_scale)
    return {
        name: {"/".join(filter(None, frame)): (*pairs[frame], truths[frame]) for frame in pairs}
        for name, pairs in pictures_of(truths).items()
        if flows == folder or next(iter(pairs.values()))[0].is_relative_to(folder)
    }


def sequence_of(pair: str) -> str:
    """Return the sequence of a pair's name: its folder, and KITTI's number before the frame's."""
    folder, _, name = pair.rpartition("/")
    folder = re.sub(r"/?flow_[FB]W_\w+$", "", folder)  # of Spring: both directions and cameras
    number = re.fullmatch(r"(?:(?:frame|flow)\D*|(\d+)_)?\d+", name)
    return f"{folder}/{(number[1] or '') if number else name}"


def read_pair(name: str, files: Files, set_name: str = "", sequence: str = "") -> FlowClip:
    """Return a pair as a clip of two frames, from first picture, second picture and truth.

    Raises UserError if a file is damaged or of the wrong size, or no flow is known.
    """
    first, second, truth = files
    flow, hidden = read_true_flow(truth)
    frames, notes = [], list[str]()
    for path in (first, second):
        with open_footage(path) as footage:
            notes += footage.notes
            frames.append(luminance(footage, 0))
    flow, hidden = at_pixels(truth, flow, hidden, frames[0].shape)
    for path, frame in zip((first, second), frames, strict=True):
        if frame.shape != flow.shape[:2]:
            raise UserError(
                f"{path} has {frame.shape[1]} × {frame.shape[0]} px, {truth.flow} has"
                f" {flow.shape[1]} × {flow.shape[0]}: give pictures and flow of one size"
            )
    light = np.stack(frames)
    if not light.any():
        raise UserError(f"{first} and {second} are black; give brighter pictures")
    if not np.isfinite(flow).all(axis=-1).any():
        raise UserError(f"{truth.flow}: no pixel has a known flow; give other flow")
    objects = truth.masks.get("obj_map")
    moving = _mask(objects, flow.shape) if objects else None
    light /= light.mean()
    motion = flow.astype(np.float64)
    return FlowClip(name, light, motion, hidden, moving, set_name, sequence, tuple(notes))


def luminance(footage: Footage, index: int) -> Floats:
    """Return the luminance (H, W) of a frame."""
    return np.asarray(footage.frame(index) @ footage.luminance_shares, np.float64)


def read_true_flow(files: TrueFlow) -> tuple[NDArray[np.float32], Mask | None]:
    """Return the true flow (H, W, 2), NaN where not scored, and where it is hidden, if known.

    Raises UserError if a file is damaged or of another size.
    """
    path, masks = files.flow, files.masks
    try:
        true, hidden = read_flow(path, png_scale=files.png_scale), None
        if "invalid" in masks:
            true[_mask(path := masks["invalid"], true.shape)] = np.nan
        if "occlusions" in masks:
            hidden = _mask(path := masks["occlusions"], true.shape)
        if "flow_noc" in masks:
            hidden = np.isnan(read_flow(path := masks["flow_noc"])[..., 0])
    except OSError as problem:
        reason = (problem.strerror or str(problem)).lower()
        raise UserError(f"{path} cannot be read ({reason}); give a file of true flow") from None
    except ValueError as problem:
        raise UserError(f"the truth cannot be read: {problem}") from None
    return true, hidden


def at_pixels(
    files: TrueFlow, true: NDArray[np.float32], hidden: Mask | None, shape: tuple[int, ...]
) -> tuple[NDArray[np.float32], Mask | None]:
    """Return true flow at the pixels of frames: that of Spring is finer, of twice the size."""
    if files.flow.suffix.lower() == ".flo5" and true.shape[:2] == (2 * shape[0], 2 * shape[1]):
        return true[::2, ::2], None if hidden is None else hidden[::2, ::2]
    return true, hidden


def _mask(path: Path, shape: tuple[int, ...]) -> Mask:
    mask = read_codes(path, "L") > 0
    if mask.shape != shape[:2]:
        raise ValueError(f"{path} is {mask.shape[1]} × {mask.shape[0]} px, its flow is not")
    return mask


def _pictures(flow: Path) -> dict[str, tuple[Path, Path]]:
    """Return both pictures of a flow, by pass, where they are there."""
    pairs: dict[str, tuple[Path, Path]] = {}
    flow = flow.absolute()
    if numbered := re.fullmatch(r"(.*?)(\d+)", flow.with_suffix("").as_posix()):
        start, number = numbered.groups()
        second = int(number) + (-1 if flow.name.startswith("flow_BW_") else 1)
        for pattern, name, pictures in _PICTURES:
            if name not in pairs and (known := re.fullmatch(f"(.*/){pattern}", start)):
                place = known.expand(rf"\1{pictures}")
                pair = Path(f"{place}{number}.png"), Path(f"{place}{second:0{len(number)}d}.png")
                if all(path.exists() for path in pair):
                    pairs[name] = pair
    if pairs:
        return pairs
    key = re.sub("_?flow_?|(^|[-_])gt$", "", flow.stem)
    pictures_by_name = _pictures_in(flow.parent)
    from_key = pictures_by_name[bisect_left(pictures_by_name, key, key=lambda path: path.name) :]
    beginning = takewhile(lambda path: path.name.startswith(key), from_key)
    beside = [path for path in beginning if not path.name[len(key)].isdigit() or not key]
    return {"": (beside[0], beside[1])} if len(beside) == 2 else {}


@cache
def _pictures_in(folder: Path) -> list[Path]:
    """Return the pictures of a folder by name, without flow and its masks."""
    return sorted(
        path
        for path in folder.iterdir()
        if path.suffix.lower() in KINDS and not _OF_FLOW.search(path.stem)
    )


def _frames_below(root: Path, among_pictures: bool = False) -> dict[FrameName, Path]:
    """Return the flow files below a folder; among pictures, only those PNG files that are flow."""
    paths = [path for path in sorted(root.rglob("*")) if path.suffix.lower() in FLOW_SUFFIXES]
    uncertain = {path for path in paths if path.name.endswith(_UNCERTAINTY)}
    paths = [path for path in paths if path not in uncertain]
    if strays := sorted(uncertain - {uncertainty_of(path) for path in paths}):
        raise UserError(f"{strays[0]} has no flow file of its name: add that, or remove this")
    suffixes = {path.suffix.lower() for path in paths}
    if among_pictures:
        marked = {path.parent for path in paths if path.suffix.lower() != ".png"}
        paths = [
            path
            for path in paths
            if path.suffix.lower() != ".png" or (path.parent not in marked and _may_be_flow(path))
        ]
    elif len(suffixes) > 1:
        raise UserError(f"{root} holds {' and '.join(sorted(suffixes))}: give one format")
    flows: dict[FrameName, Path] = {}
    for path in paths:
        number = _NUMBERED.fullmatch(path.stem)
        name = f"frame_{int(number[1]):04d}" if number else path.stem
        frame = FrameName(path.parent.relative_to(root).as_posix().removeprefix("."), name)
        if frame in flows:
            raise UserError(f"{path} and {flows[frame]} are the same frame: give one")
        flows[frame] = path
    return flows


def _may_be_flow(path: Path) -> bool:
    """Return whether a PNG has 16 bits and three channels, by its header."""
    with path.open("rb") as file:
        return file.read(26)[24:] == b"\x10\x02"
