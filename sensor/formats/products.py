"""Products of an exposure, written frame by frame, and their file names.

Settings need only the names; writers are loaded on use.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, get_args

if TYPE_CHECKING:
    from megalopta.sensor.formats.counts_store import Origin
    from megalopta.sensor.image_sensors import ImageSensor

ProductName: TypeAlias = Literal[
    "counts", "events_hdf5", "events_npz", "binary_npy", "burst_npy", "tiff",
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
        elif max(shape) > MOST_PIXELS_A_SIDE:
            raise ValueError(f"{max(shape)} pixels a side; events have up to {MOST_PIXELS_A_SIDE}")
    except ValueError as problem:
        raise ValueError(f"{product}: {problem}") from None


@contextmanager
def product_writer(
    product: ProductName,
    path: Path,
    origin: "Origin",
    shape: tuple[int, int, int],
    frame_period_s: float,
    burst_frames: int = 1,
) -> Iterator[Write]:
    """Yield a function that appends frames to a product, which appears once complete.

    `shape`: frames, rows and columns; `frame_period_s`: time between the starts of frames, s;
    `burst_frames`: binary frames per burst in that time.
    """
    from megalopta.sensor.formats import counts_store, events, packed, recorded_frames
    from megalopta.sensor.optics import demosaiced
    from megalopta.sensor.spad.model import Sensor

    (frames, rows, columns), sensor = shape, origin.sensor
    writer: AbstractContextManager[Write]
    if product == "counts":
        writer = counts_store.counts_writer(path, origin, frames)
    elif product == "tiff":
        writer = recorded_frames.tiff_writer(path, math.prod(shape) * 4, sensor.exposure_s)
    elif product == "color_npy":
        writer = packed.npy_writer(path, (*shape, 3), "<f4")
    elif product == "histograms_npy":
        assert isinstance(sensor, Sensor)
        writer = packed.npy_writer(path, (*shape, sensor.tcspc.bins), "<u4")
    elif product in ("binary_npy", "burst_npy"):
        frames *= burst_frames if product == "burst_npy" else 1
        writer = packed.npy_writer(path, (frames, rows, -(-columns // 8)))
    else:
        notes = {
            "sensor": sensor.model_dump(mode="json"),
            "seed": origin.seed,
            "sequence": origin.sequence,
            "illuminance_lux": origin.illuminance_lux,
            **origin.extra,
        }
        of_events = events.EventOrigin(
            shape=shape, frame_period_s=frame_period_s, exposure_s=sensor.exposure_s, extra=notes
        )
        is_hdf5 = product == "events_hdf5"
        open_writer = events.events_hdf5_writer if is_hdf5 else events.events_npz_writer
        writer = open_writer(path, of_events)
    with writer as write:

        def write_product(drawn: Any) -> None:
            if product == "tiff":
                drawn = drawn.counts
            elif product == "color_npy":
                drawn = demosaiced(drawn.counts, sensor.filters)
            write(drawn)

        yield write_product
