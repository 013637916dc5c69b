"""Pairs of frames and the flow between them, to train and to test on."""

from bisect import bisect_right
from collections.abc import Sequence as Listed
from itertools import accumulate
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.core.errors import UserError
from megalopta.dataset.lazy import LazyFrames
from megalopta.dataset.sequence import Sequence
from megalopta.flow.flo import read_flo

Pair = dict[str, Any]


class FlowPairs:
    """All pairs of frames, so many apart, of some sequences.

    A pair is a dictionary: `first` and `second` (C, H, W) float32, readings, or light of all bands;
    `flow` (2, H, W) float32, px, 0 where it is undefined; `valid` (H, W), where it is defined;
    `occluded` (H, W); `sequence`, `frame`.
    """

    def __init__(self, sequences: Listed[Sequence], exposure: str | None, step: int) -> None:
        if step < 1:
            raise UserError(f"step {step}: give a whole number, 1 or more")
        self._sequences, self._exposure, self._step = list(sequences), exposure, step
        counts = (max(len(sequence) - step, 0) for sequence in self._sequences)
        self._ends = list(accumulate(counts))

    def __len__(self) -> int:
        """Return the number of pairs."""
        return self._ends[-1] if self._ends else 0

    def __getitem__(self, index: int) -> Pair:
        """Read a pair."""
        if not -len(self) <= index < len(self):
            raise IndexError(f"pair {index} of {len(self)}")
        place = bisect_right(self._ends, index % len(self))
        before = self._ends[place - 1] if place else 0
        return self._pair(self._sequences[place], index % len(self) - before)

    def _pair(self, sequence: Sequence, first: int) -> Pair:
        frames = self._frames(sequence)
        flow = self._flow(sequence, first)
        valid = np.asarray(~np.isnan(flow).any(axis=-1))
        return {
            "first": _planes(frames[first]),
            "second": _planes(frames[first + self._step]),
            "flow": np.moveaxis(np.where(valid[..., np.newaxis], flow, 0), -1, 0),
            "valid": valid,
            "occluded": self._occluded(sequence, first),
            "sequence": sequence.name,
            "frame": first,
        }

    def _frames(self, sequence: Sequence) -> LazyFrames:
        is_light = self._exposure == "radiance"
        return sequence.radiance if is_light else sequence.counts(self._exposure)

    def _flow(self, sequence: Sequence, first: int) -> NDArray[np.float32]:
        if self._step == 1:  # the small file is read in a tenth of the time
            return read_flo(sequence.dataset.frame("training/flow", first, "flo"))
        return sequence.flow(first, first + self._step)

    def _occluded(self, sequence: Sequence, first: int) -> NDArray[np.bool_]:
        if self._step == 1:
            from PIL import Image

            with Image.open(sequence.dataset.frame("training/occlusions", first, "png")) as image:
                return np.asarray(image) > 0
        return sequence.occlusion(first, first + self._step)


def _planes(frame: NDArray[Any]) -> NDArray[np.float32]:
    """A frame (H, W) or (H, W, B) as (C, H, W)."""
    planes = frame[np.newaxis] if frame.ndim == 2 else np.moveaxis(frame, -1, 0)
    return np.ascontiguousarray(planes, np.float32)


class TensorPairs:
    """`FlowPairs` whose arrays are tensors, for a DataLoader and its processes."""

    def __init__(self, pairs: FlowPairs) -> None:
        self._pairs = pairs

    def __len__(self) -> int:
        """Return the number of pairs."""
        return len(self._pairs)

    def __getitem__(self, index: int) -> Pair:
        """Read a pair."""
        import torch

        return {
            name: torch.from_numpy(np.array(value)) if isinstance(value, np.ndarray) else value
            for name, value in self._pairs[index].items()
        }
