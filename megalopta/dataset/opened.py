"""A dataset opened: its sequences by number, name or split."""

from collections.abc import Iterator
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from megalopta.core.errors import UserError
from megalopta.dataset.index import read_lists
from megalopta.dataset.layout import Tree
from megalopta.dataset.pairs import FlowPairs, TensorPairs
from megalopta.dataset.sequence import Sequence
from megalopta.dataset.store import exposure_name

_KEPT = 64


class OpenedDataset:
    """Sequences of a dataset, opened when they are asked for.

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
        if not self._tree.lone:
            self._tree.plan()
        self.names = tuple(self._tree.names())
        self._open = lru_cache(maxsize=_KEPT)(self._opened)

    def __repr__(self) -> str:
        """Say what it is."""
        return f"OpenedDataset({str(self.root)!r}, {len(self)} sequences)"

    def __len__(self) -> int:
        """Return the number of sequences."""
        return len(self.names)

    def __iter__(self) -> Iterator[Sequence]:
        """Yield one sequence after another."""
        return map(self._open, self.names)

    def __getitem__(self, key: int | str) -> Sequence:
        """Return a sequence by its place or name. Raises UserError where there is none."""
        if isinstance(key, int):
            if not -len(self) <= key < len(self):
                raise IndexError(f"sequence {key} of {len(self)}")
            return self._open(self.names[key])
        if key not in self.names:
            raise UserError(f"{self.root}: no sequence {key!r}; there are {_brief(self.names)}")
        return self._open(key)

    @property
    def splits(self) -> dict[str, tuple[str, ...]]:
        """Names of the sequences of every split, "sample" among them. Raises UserError."""
        return read_lists(self.root, self.names) or {"all": self.names}

    def of_split(self, split: str) -> list[Sequence]:
        """Return the sequences of a split. Raises UserError where there is none."""
        if split not in self.splits:
            raise UserError(f"{self.root}: no split {split!r}; there are {_brief(self.splits)}")
        return [self._open(name) for name in self.splits[split]]

    def pairs(
        self, split: str | None = None, exposure: str | None = None, step: int = 1
    ) -> FlowPairs:
        """Pairs of frames with the flow between them, as NumPy arrays.

        Parameters
        ----------
        split : str or None
            All sequences by default.
        exposure : str or None
            Readings of that exposure; by default the first. "radiance" gives the light.
        step : int
            Frames from the first of a pair to the second.
        """
        return FlowPairs(list(self) if split is None else self.of_split(split), exposure, step)

    def torch(
        self, split: str | None = None, exposure: str | None = None, step: int = 1
    ) -> TensorPairs:
        """`pairs` of tensors, which a DataLoader takes. Raises UserError without PyTorch."""
        if find_spec("torch") is None:
            raise UserError("PyTorch is not installed; run: pip install torch")
        return TensorPairs(self.pairs(split, exposure, step))

    def _opened(self, name: str) -> Sequence:
        record, dataset = self._tree.opened(name)
        units = {each.name: each.unit for each in record.exposures}
        if self._tree.lone:
            pairs = dataset.configuration.exposures
            units = {exposure_name(*pair): pair[0].unit for pair in pairs}
        return Sequence(dataset, record.split, units)


def open_dataset(root: str | Path) -> OpenedDataset:
    """Open a dataset, of one sequence or of many; nothing is read yet.

    Raises UserError when there is none.
    """
    return OpenedDataset(Path(root))


def _brief(names: Any) -> str:
    shown = list(names)
    return ", ".join(shown[:5]) + (f" and {len(shown) - 5} more" if len(shown) > 5 else "")
