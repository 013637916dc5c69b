"""Names of what is written of an exposure, and of the files.

Apart from the writers, as settings need the names and load nothing else.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Literal, TypeAlias, get_args

ProductName: TypeAlias = Literal[
    "counts", "events_hdf5", "events_npz", "binary_npy", "binary_spad512", "burst_npy", "tiff"
]
PRODUCTS: tuple[ProductName, ...] = get_args(ProductName)

_SUFFIXES: Mapping[ProductName, str] = {
    "counts": ".zarr",
    "events_hdf5": ".events.h5",
    "events_npz": ".events.npz",
    "binary_npy": ".binary.npy",
    "binary_spad512": ".spad512",
    "burst_npy": ".burst.npy",
    "tiff": ".tiff",
}


def product_path(counts: Path, product: ProductName) -> Path:
    """Return where a product lies, given the path of the counts, which ends in `.zarr`."""
    return counts.with_name(counts.name.removesuffix(".zarr") + _SUFFIXES[product])


def product_stem(path: Path) -> str:
    """Name of the exposure that a product is of, such as "spadcam-0.1lux"; "" for other files."""
    suffixes = (each for each in _SUFFIXES.values() if path.name.endswith(each))
    return path.name.removesuffix(next(suffixes, path.name))
