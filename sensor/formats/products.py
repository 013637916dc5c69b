"""What can be written of an exposure, frame after frame, in flat memory."""

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from functools import partial
from pathlib import Path
from typing import Any, Literal, TypeAlias

from megalopta.sensor.event_stream import Events
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
    if product == "burst_npy":
        shape = shape[0] * burst_frames, *shape[1:]
    return _WRITERS[product](path, origin, shape, frame_period_s)


def kind_of(product: ProductName) -> Kind:
    """What the writer of a product takes."""
    if product in ("counts", "tiff"):
        return "readings"
    return "burst" if product == "burst_npy" else "events" if "events" in product else "bits"


@contextmanager
def _counts(path: Path, origin: Origin, shape: tuple[int, int, int], _: float) -> Iterator[Write]:
    with counts_writer(path, origin, shape[0]) as write:
        yield write


@contextmanager
def _tiff(path: Path, origin: Origin, shape: tuple[int, int, int], _: float) -> Iterator[Write]:
    most_bytes = math.prod(shape) * 4
    with tiff_writer(path, most_bytes, exposure_s=origin.sensor.exposure_s) as write:
        yield lambda exposure: write(exposure.counts)


@contextmanager
def _events(
    writer: Callable[[Path, EventOrigin], AbstractContextManager[Callable[[Events], None]]],
    path: Path,
    origin: Origin,
    shape: tuple[int, int, int],
    frame_period_s: float,
) -> Iterator[Write]:
    described = {
        "sensor": origin.sensor.model_dump(mode="json"),
        "seed": origin.seed,
        "sequence": origin.sequence,
        "illuminance_lux": origin.illuminance_lux,
        **origin.extra,
    }
    of_events = EventOrigin(
        shape=shape,
        frame_period_s=frame_period_s,
        exposure_s=origin.sensor.exposure_s,
        extra=described,
    )
    with writer(path, of_events) as write:
        yield write


@contextmanager
def _npy(path: Path, _: Origin, shape: tuple[int, int, int], __: float) -> Iterator[Write]:
    frames, rows, columns = shape
    with binary_npy_writer(path, (frames, rows, -(-columns // 8))) as write:
        yield write


@contextmanager
def _spad512(path: Path, _: Origin, __: tuple[int, int, int], ___: float) -> Iterator[Write]:
    with spad512_writer(path) as write:
        yield write


_WRITERS: Mapping[ProductName, Callable[..., AbstractContextManager[Write]]] = {
    "counts": _counts,
    "events_hdf5": partial(_events, events_hdf5_writer),
    "events_npz": partial(_events, events_npz_writer),
    "binary_npy": _npy,
    "binary_spad512": _spad512,
    "burst_npy": _npy,
    "tiff": _tiff,
}
