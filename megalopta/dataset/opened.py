"""An opened dataset: its sequences by number, name or split, and pairs of their frames."""

from bisect import bisect_right
from collections.abc import Iterator, Sequence as Listed
from functools import lru_cache
from importlib.util import find_spec
from itertools import accumulate, groupby
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.core.errors import UserError
from megalopta.core.pictures import read_codes
from megalopta.core.progress import say
from megalopta.dataset.index import read_lists
from megalopta.dataset.sequence import LazyFrames, Sequence
from megalopta.dataset.store import Tree
from megalopta.flow.formats import read_flo

Pair = dict[str, Any]
Exposures = str | Listed[str] | None


class FlowPairs:
    """All pairs of frames of some sequences, `step` frames apart.

    A pair is a dictionary: `first` and `second` (C, H, W) float32, readings, or light of all bands;
    `flow` (2, H, W) float32, px, 0 where undefined; `valid` (H, W), True where defined, which
    includes `occluded` (H, W), bool; `sequence`, `exposure`, `frame`; if all are of stereo pairs,
    `disparity` (H, W) of the first, float32, px, NaN where unknown. It can be pickled.
    """

    def __init__(self, sequences: Listed[Sequence], exposure: Exposures, step: int) -> None:
        if not sequences:
            raise UserError("no sequence, and so no pairs; give a split with some")
        longest = max(map(len, sequences))
        if not 1 <= step < longest:
            remedy = f"s; give 1 to {longest - 1}" if longest > 1 else "; make 2 or more"
            raise UserError(f"step {step}: the longest sequence has {longest} frame{remedy}")
        self._parts, self._step = list[tuple[Sequence, str]](), step
        for sequence in sequences:
            sequence.dataset.require_truth()
            names = sequence.exposures if exposure == "all" else exposure
            for name in [names] if names is None or isinstance(names, str) else names:
                known = name if name == "radiance" else sequence._exposure(name)
                self._parts.append((sequence, known))
        if exposure is None and (others := sequences[0].exposures[1:]):
            say(f'pairs of {self._parts[0][1]}; exposure="all" also gives {", ".join(others)}')
        self._ends = list(accumulate(max(len(sequence) - step, 0) for sequence, _ in self._parts))
        self._has_disparity = all(s.configuration.stereo_with is not None for s in sequences)

    def __repr__(self) -> str:
        """Describe the pairs."""
        first, names = _frames(*self._parts[0]), dict.fromkeys(name for _, name in self._parts)
        shape = (*(first.shape[3:] or (1,)), *first.shape[1:3])
        what = f"{shape}, {first.unit}, exposures {_brief(names)}, step {self._step}"
        return f"{type(self).__name__}({len(self)} pairs of {what})"

    def __len__(self) -> int:
        """Return the number of pairs."""
        return self._ends[-1] if self._ends else 0

    def __getitem__(self, index: int) -> Pair:
        """Read a pair."""
        if not -len(self) <= index < len(self):
            raise IndexError(f"pair {index} of {len(self)}")
        place = bisect_right(self._ends, index % len(self))
        sequence, exposure = self._parts[place]
        first = index % len(self) - (self._ends[place - 1] if place else 0)
        second, frame = first + self._step, sequence.dataset.frame
        frames = _frames(sequence, exposure)
        if self._step > 1 or sequence.configuration.shutter.readout_s:
            flow, occluded = sequence.flow(first, second), sequence.occlusion(first, second)
        else:  # these small files are read ten times faster than the truth
            flow = read_flo(frame("training/flow", first))
            occluded = read_codes(frame("training/occlusions", first), "L") > 0
        valid = np.asarray(~np.isnan(flow).any(axis=-1))
        stereo = {"disparity": sequence.disparity[first]} if self._has_disparity else {}
        return {
            "first": _planes(frames[first]),
            "second": _planes(frames[second]),
            "flow": np.moveaxis(np.where(valid[..., np.newaxis], flow, 0), -1, 0),
            "valid": valid,
            "occluded": occluded,
            "sequence": sequence.name,
            "exposure": exposure,
            "frame": first,
            **stereo,
        }


def _frames(sequence: Sequence, exposure: str) -> LazyFrames:
    return sequence.radiance if exposure == "radiance" else sequence.counts(exposure)


def _planes(frame: NDArray[Any]) -> NDArray[np.float32]:
    """Return a frame (H, W) or (H, W, B) as (C, H, W)."""
    planes = frame[np.newaxis] if frame.ndim == 2 else np.moveaxis(frame, -1, 0)
    return np.ascontiguousarray(planes, np.float32)


class OpenedDataset:
    """Sequences of a dataset, opened on access.

        dataset = megalopta.open_dataset("out/dataset")
        dataset[0], dataset["000003"], dataset.of_split("train")

    Attributes
    ----------
    root : Path
    names : tuple of str
        Names of the sequences, in order.
    """

    def __init__(self, root: Path) -> None:
        self.root, self._tree = root, Tree(root)
        self._tree.check()
        self.names = tuple(self._tree.names())
        self._open = lru_cache(maxsize=64)(lambda name: Sequence(self._tree.opened(name)))

    def __repr__(self) -> str:
        """Describe the dataset."""
        return f"OpenedDataset({str(self.root)!r}, {len(self)} sequences)"

    def __len__(self) -> int:
        """Return the number of sequences."""
        return len(self.names)

    def __iter__(self) -> Iterator[Sequence]:
        """Yield the sequences."""
        return map(self._open, self.names)

    def __getitem__(self, key: int | str) -> Sequence:
        """Return a sequence by number or name. Raises IndexError or, for a name, UserError."""
        if isinstance(key, int):
            if not -len(self) <= key < len(self):
                raise IndexError(f"sequence {key} of {len(self)}")
            return self._open(self.names[key])
        if key not in self.names:
            raise UserError(f"{self.root}: no sequence {key!r}; there are {_brief(self.names)}")
        return self._open(key)

    @property
    def splits(self) -> dict[str, tuple[str, ...]]:
        """Names of the sequences of every split, and of "sample", a few of these again."""
        return read_lists(self.root, self.names) or {"all": self.names}

    @property
    def paths(self) -> list[tuple[str, ...]]:
        """Names of the sequences of every path: those of the cameras of a rig, in its order."""
        cameras = plan.cameras_per_path if (plan := self._tree.plan) else 1
        paths = groupby(self.names, lambda name: int(name) // cameras if plan else name)
        return [tuple(names) for _, names in paths]

    def of_split(self, split: str) -> list[Sequence]:
        """Return the sequences of a split. Raises UserError if there is none."""
        if split not in self.splits:
            raise UserError(f"{self.root}: no split {split!r}; there are {_brief(self.splits)}")
        return [self._open(name) for name in self.splits[split]]

    def pairs(
        self, split: str | None = None, exposure: str | Listed[str] | None = None, step: int = 1
    ) -> FlowPairs:
        """Return pairs of frames with the flow between them, as NumPy arrays.

        Parameters
        ----------
        split : str or None
            Default: all sequences.
        exposure : str, list of str, or None
            Exposures to read, one after another, or "all"; default: the first of each sequence.
            "radiance" gives the light.
        step : int
            Frames between the first and the second of a pair.
        """
        return FlowPairs(list(self) if split is None else self.of_split(split), exposure, step)

    def to_torch(
        self, split: str | None = None, exposure: str | Listed[str] | None = None, step: int = 1
    ) -> FlowPairs:
        """Return `pairs` as a `torch.utils.data.Dataset` of tensors, for workers as well.

        Parameters are those of `pairs`, items those of FlowPairs. Raises UserError without PyTorch.

            pairs = megalopta.open_dataset("DIR").to_torch("train")
            loader = torch.utils.data.DataLoader(pairs, batch_size=4, num_workers=2)
            for batch in loader:
                batch["first"], batch["flow"]  # (4, 1, H, W), (4, 2, H, W)
        """
        if find_spec("torch") is None:
            raise UserError("PyTorch is not installed; run: pip install torch")
        from megalopta.dataset.tensors import TensorPairs

        return TensorPairs(list(self) if split is None else self.of_split(split), exposure, step)


def open_dataset(root: str | Path) -> OpenedDataset:
    """Open a dataset, of one sequence or of many, without reading its data.

    Raises UserError if there is none.
    """
    return OpenedDataset(Path(root))


def _brief(names: Any) -> str:
    shown = list(names)
    return ", ".join(shown[:5]) + (f" and {len(shown) - 5} more" if len(shown) > 5 else "")
