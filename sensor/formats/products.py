"""What can be written of an exposure, frame after frame, in flat memory."""

import math
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any, Literal, TypeAlias

from megalopta.sensor.exposure import check_binary
from megalopta.sensor.formats.counts_store import Origin, counts_writer
from megalopta.sensor.formats.events import (
    MOST_PIXELS_A_SIDE,
    EventOrigin,
    events_hdf5_writer,
    events_npz_writer,
)
from megalopta.sensor.formats.names import ProductName
from megalopta.sensor.formats.packed import binary_npy_writer, check_spad512_size, spad512_writer
from megalopta.sensor.formats.tiff import tiff_writer
from megalopta.sensor.image_sensors import ImageSensor
from megalopta.sensor.spad.model import Sensor

Kind: TypeAlias = Literal["readings", "events", "bits", "burst"]
"""What is drawn for a product: `Exposure`, `Events`, or packed bits of frames or of bursts."""
Write: TypeAlias = Callable[[Any], None]


def check_product(product: ProductName, sensor: ImageSensor, shape: tuple[int, int]) -> None:
    """Make sure that a sensor of (rows, columns) pixels can give a product.

    Raises
    ------
    ValueError
        With one sentence that says why not.
    """
    if product in ("counts", "tiff"):
        return
    if not isinstance(sensor, Sensor):
        raise ValueError(
            f"{product}: a sensor that integrates has no single events; take the product or the "
            "sensor out"
        )
    try:
        if product.startswith(("binary", "burst")):
            check_binary(sensor)
        if product == "binary_spad512":
            check_spad512_size(*shape)
    except ValueError as problem:
        raise ValueError(f"{product}: {problem}") from None
    if product.startswith("events") and max(shape) > MOST_PIXELS_A_SIDE:
        raise ValueError(f"{product}: {max(shape)} pixels a side; events have up to 65536")


def product_writer(
    product: ProductName,
    path: Path,
    origin: Origin,
    shape: tuple[int, int, int],
    frame_period_s: float,
    burst_frames: int = 1,
) -> AbstractContextManager[Write]:
    """Yield what appends frames to a product, which appears when all are there (see `kind_of`).

    Parameters
    ----------
    product : str
        One of `PRODUCTS`.
    path : Path
    origin : Origin
        What made the exposure.
    shape : (frames, rows, columns)
    frame_period_s : float
        From the beginning of a frame to that of the next, s.
    burst_frames : int
        Binary frames of a burst in that time.
    """
    frames, rows, columns = shape
    if product == "counts":
        return counts_writer(path, origin, frames)
    if product == "tiff":
        return _of_counts(tiff_writer(path, math.prod(shape) * 4, origin.sensor.exposure_s))
    if product == "binary_spad512":
        return spad512_writer(path)
    if product == "events_hdf5":
        return events_hdf5_writer(path, _event_origin(origin, shape, frame_period_s))
    if product == "events_npz":
        return events_npz_writer(path, _event_origin(origin, shape, frame_period_s))
    frames *= burst_frames if product == "burst_npy" else 1
    return binary_npy_writer(path, (frames, rows, -(-columns // 8)))


def kind_of(product: ProductName) -> Kind:
    """What the writer of a product takes."""
    if product in ("counts", "tiff"):
        return "readings"
    return "burst" if product == "burst_npy" else "events" if "events" in product else "bits"


@contextmanager
def _of_counts(writer: AbstractContextManager[Write]) -> Iterator[Write]:
    """Yield what appends the counts of exposures."""
    with writer as write:
        yield lambda exposure: write(exposure.counts)


def _event_origin(
    origin: Origin, shape: tuple[int, int, int], frame_period_s: float
) -> EventOrigin:
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
