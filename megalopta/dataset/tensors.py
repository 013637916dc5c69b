"""Pairs of frames as a dataset of PyTorch; only where it is installed can this be imported."""

from typing import Any

import numpy as np
import torch

from megalopta.dataset.pairs import FlowPairs


class TensorPairs(torch.utils.data.Dataset):  # type: ignore[misc]
    """`FlowPairs` whose arrays are tensors, also for the processes of a DataLoader."""

    def __init__(self, pairs: FlowPairs) -> None:
        self._pairs = pairs

    def __len__(self) -> int:
        """Return the number of pairs."""
        return len(self._pairs)

    def __getitem__(self, index: int) -> dict[str, Any]:
        """Read a pair."""
        return {
            name: torch.from_numpy(np.array(value)) if isinstance(value, np.ndarray) else value
            for name, value in self._pairs[index].items()
        }
