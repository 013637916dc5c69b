"""Pairs of frames as tensors, for PyTorch."""

from typing import Any

import numpy as np
import torch
from torch.utils.data import Dataset

from megalopta.dataset.opened import FlowPairs, Pair


class TensorPairs(FlowPairs, Dataset[Pair]):  # type: ignore[misc] # PyTorch may be missing
    """Map-style dataset of FlowPairs whose arrays are tensors."""

    def __getitem__(self, index: int) -> dict[str, Any]:
        """Read a pair."""
        return {
            name: torch.from_numpy(np.array(value)) if isinstance(value, np.ndarray) else value
            for name, value in super().__getitem__(index).items()
        }
