"""Products of an exposure, written frame by frame in constant memory, and their file names.

Settings need only the names; writers are loaded on use.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, get_args

if TYPE_CHECKING:
    from megalopta.sensor.formats.counts_store import Origin
    from megalopta.sensor.formats.events import EventOrigin
    from megalopta.sensor.image_sensors import ImageSensor

ProductName: TypeAlias = Literal[
    "counts", "events_hdf5", "events_npz", "binary_npy", "binary_spad512", "burst_npy", "tiff",
    "histograms_npy", "color_npy",
]  # fmt: skip
PRODUCTS: tuple[ProductName, ...] = get_args(ProductName)

Kind: TypeAlias = Literal["readings", "events", "bits", "burst", "histograms"]
"""Input of a product's writer: `Exposure`, `Events`, packed bits of frames or bursts, or arrays."""
Write: TypeAlias = Callable[[Any], None]


_PRODUCTS: Mapping[ProductName, tuple[str, Kind]] = {
    "counts": (".zarr", "readings"),
    "events_hdf5": (".events.h5", "events"),
    "events_npz": (".events.npz", "events"),
    "binary_npy": (".binary.npy", "bits"),
    "binary_spad512": (".spad512", "bits"),
    "burst_npy": (".burst.npy", "burst"),
    "tiff": (".tiff", "readings"),
    "histograms_npy": (".histograms.npy", "histograms"),
    "color_npy": (".color.npy", "readings"),
}


def product_path(counts: Path, product: ProductName) -> Path:
    """Return the path of a product, given that of the counts, which ends in `.zarr`."""
    return counts.with_name(counts.name.removesuffix(".zarr") + _PRODUCTS[product][0])


def product_stem(path: Path) -> str:
    """Base name of the exposure's files, such as "spadcam-0.1lux"; "" for other files."""
    suffixes = (suffix for suffix, _ in _PRODUCTS.values() if path.name.endswith(suffix))
    return path.name.removesuffix(next(suffixes, path.name))


def kind_of(product: ProductName) -> Kind:
    """Input that the writer of a product takes."""
    return _PRODUCTS[product][1]


def check_product(product: ProductName, sensor: "ImageSensor", shape: tuple[int, int]) -> None:
    """Check that a sensor of (rows, columns) pixels can give a product.

    Raises ValueError if not, with the reason in one sentence.
    """
    from megalopta.sensor.exposure import check_binary
    from megalopta.sensor.formats.events import MOST_PIXELS_A_SIDE
    from megalopta.sensor.formats.packed import check_spad512_size
    from megalopta.sensor.histograms import check_histograms
    from megalopta.sensor.spad.model import Sensor

    kind = kind_of(product)
    if product == "color_npy":
        sensor.filters.check_bayer()
    if kind == "readings":
        return
    if not isinstance(sensor, Sensor):
        raise ValueError(
            f"{product}: an integrating sensor has no single events; remove the product or the "
            "sensor"
        )
    try:
        if kind == "histograms":
            check_histograms(sensor)
        elif kind != "events":
            check_binary(sensor)
        if product == "binary_spad512":
            check_spad512_size(*shape)
    except ValueError as problem:
        raise ValueError(f"{product}: {problem}") from None
    if kind == "events" and max(shape) > MOST_PIXELS_A_SIDE:
        raise ValueError(f"{product}: {max(shape)} pixels a side; events have up to 65536")


def product_writer(
    product: ProductName,
    path: Path,
    origin: "Origin",
    shape: tuple[int, int, int],
    frame_period_s: float,
    burst_frames: int = 1,
) -> AbstractContextManager[Write]:
    """Yield a function that appends frames to a product, which appears once complete.

    Parameters
    ----------
    product : str
        One of `PRODUCTS`.
    origin : Origin
        Origin of the exposure.
    shape : (frames, rows, columns)
    frame_period_s : float
        Time between the starts of consecutive frames, s.
    burst_frames : int
        Binary frames per burst in that time.
    """
    from megalopta.sensor.formats import counts_store, events, packed, recorded_frames
    from megalopta.sensor.optics import demosaiced
    from megalopta.sensor.spad.model import Sensor

    frames, rows, columns = shape
    if product == "counts":
        return counts_store.counts_writer(path, origin, frames)
    if product == "tiff":
        return _of_counts(
            recorded_frames.tiff_writer(path, math.prod(shape) * 4, origin.sensor.exposure_s)
        )
    if product == "binary_spad512":
        return packed.spad512_writer(path)
    if product == "events_hdf5":
        return events.events_hdf5_writer(path, _event_origin(origin, shape, frame_period_s))
    if product == "events_npz":
        return events.events_npz_writer(path, _event_origin(origin, shape, frame_period_s))
    if product == "histograms_npy":
        assert isinstance(origin.sensor, Sensor)
        return packed.npy_writer(path, (*shape, origin.sensor.tcspc.bins), "<u4")
    if product == "color_npy":
        colors = partial(demosaiced, filters=origin.sensor.filters)
        return _of_counts(packed.npy_writer(path, (*shape, 3), "<f4"), colors)
    frames *= burst_frames if product == "burst_npy" else 1
    return packed.npy_writer(path, (frames, rows, -(-columns // 8)))


@contextmanager
def _of_counts(
    writer: AbstractContextManager[Write], change: Callable[[Any], Any] = lambda counts: counts
) -> Iterator[Write]:
    """Yield a function that appends the counts of exposures."""
    with writer as write:
        yield lambda exposure: write(change(exposure.counts))


def _event_origin(
    origin: "Origin", shape: tuple[int, int, int], frame_period_s: float
) -> "EventOrigin":
    from megalopta.sensor.formats.events import EventOrigin

    return EventOrigin(
        shape=shape,
        frame_period_s=frame_period_s,
        exposure_s=origin.sensor.exposure_s,
        extra={
            "sensor": origin.sensor.model_dump(mode="json"),
            "seed": origin.seed,
            "sequence": origin.sequence,
            "illuminance_lux": origin.illuminance_lux,
            **origin.extra,
        },
    )
