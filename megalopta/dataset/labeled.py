"""A sequence as xarray shows it: named axes, coordinates, units."""

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from megalopta.core.errors import UserError
from megalopta.dataset.lazy import LazyFrames, frame_by_frame

if TYPE_CHECKING:
    import xarray

    from megalopta.dataset.sequence import Sequence


def labeled(sequence: "Sequence", exposures: Iterable[str]) -> "xarray.Dataset":
    """Return a lazy xarray.Dataset of a sequence. Raises UserError without xarray."""
    try:
        import xarray
    except ImportError:
        raise UserError("xarray is not installed; run: pip install xarray") from None

    arrays = {"radiance": sequence.radiance, "depth": sequence.depth, "flow": _flows(sequence)}
    for name in exposures:
        arrays[f"counts {name}" if len(sequence.exposures) > 1 else "counts"] = sequence.counts(
            name
        )
    variables = {name: _variable(xarray, array) for name, array in arrays.items()}
    poses = xarray.Variable(("frame", "to", "from"), sequence.poses, {"units": "m"})
    return xarray.Dataset(
        {**variables, "camera_to_world": poses},
        coords={
            "time": ("frame", sequence.times_s, {"units": "s"}),
            "band_nm": ("band", np.mean(sequence.bands_nm, axis=1), {"units": "nm"}),
            "component": ["x", "y"],
        },
        attrs={"sequence": sequence.name, "split": sequence.split},
    )


def _flows(sequence: "Sequence") -> LazyFrames:
    """Forward flow of every frame; that of the last is unknown."""

    def read(index: int) -> Any:
        if index + 1 < len(sequence):
            return sequence.flow(index)
        return np.full((*sequence.shape, 2), np.nan, np.float32)

    shape = (len(sequence), *sequence.shape, 2)
    dimensions = ("frame", "row", "column", "component")
    return LazyFrames(shape, np.dtype(np.float32), "px", dimensions, frame_by_frame(read))


def _variable(xarray: Any, array: LazyFrames) -> Any:
    import dask.array

    chunks = (1, *array.shape[1:])
    lazy = dask.array.from_array(array, chunks=chunks, name=False, asarray=False)
    return xarray.Variable(array.dimensions, lazy, {"units": array.unit})
