"""The true flow in files of other layouts, where a plan asks for them."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from megalopta.config.recipe import FlowFile
from megalopta.dataset.store import Dataset
from megalopta.flow.formats import read_flo, write_flo5, write_kitti_png

_WRITERS: Mapping[FlowFile, tuple[str, str, Callable[[Path, NDArray[Any]], None]]] = {
    "kitti_png": ("training/flow_kitti", "png", write_kitti_png),
    "flo5": ("training/flow_flo5", "flo5", write_flo5),
}


def write_flow_files(dataset: Dataset, kinds: Sequence[FlowFile]) -> list[Path]:
    """Write the forward flow in other layouts too; return the folders that they lie in."""
    for index in range(dataset.configuration.trajectory.frames - 1) if kinds else ():
        flow = read_flo(dataset.frame("training/flow", index, "flo"))
        for folder, suffix, write in map(_WRITERS.__getitem__, kinds):
            path = dataset.frame(folder, index, suffix)
            if not path.exists():
                write(path, flow)
    return [dataset.root / _WRITERS[kind][0] / dataset.sequence for kind in kinds]
