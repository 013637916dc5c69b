"""Products of an exposure, written frame by frame, and their file names.

Settings need only the names; writers are loaded on use.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias, get_args

from pydantic import Field

from megalopta.core.record import Record

if TYPE_CHECKING:
    from megalopta.sensor.formats.counts_store import Origin
    from megalopta.sensor.image_sensors import ImageSensor

ProductName: TypeAlias = Literal[
    "counts", "events_hdf5", "events_dsec", "binary_npy", "burst_npy", "tiff",
    "histograms_npy", "color_npy", "sums_npy", "brackets_npy", "changes_hdf5",
]  # fmt: skip
PRODUCTS: tuple[ProductName, ...] = get_args(ProductName)

Kind: TypeAlias = Literal["readings", "events", "bits", "burst", "histograms"]
"""Input of a product's writer: `Exposure`, `Events`, packed bits of frames or bursts, or arrays."""
Write: TypeAlias = Callable[[Any], None]
Number: TypeAlias = Annotated[int, Field(ge=1, le=65535)]


class CubeSettings(Record):
    """What is computed of the binary frames of bursts."""

    sum_frames: Number = 10
    """Binary frames in a sum of `sums_npy`; sums fill the time between rendered frames."""
    bracket_frames: Annotated[tuple[Number, ...], Field(min_length=1, max_length=16)] = (1, 4, 16)
    """Binary frames in each exposure of `brackets_npy`, from a rendered frame on."""
    change_frames: Number = 32
    """Binary frames N in a mean of `changes_hdf5`, and at least between two events of a pixel."""
    change_sigmas: Annotated[float, Field(gt=0, le=1000)] = 4.0
    """Change that is sent, in standard deviations of a mean over N frames."""

    def check(self, products: tuple[str, ...], burst_frames: int) -> None:
        """Raise ValueError if this many binary frames per rendered frame do not suit products."""
        longest = max(self.bracket_frames) if "brackets_npy" in products else 1
        if longest > burst_frames or ("sums_npy" in products and burst_frames % self.sum_frames):
            raise ValueError(
                f"cubes: a burst has {burst_frames} binary frames; give at most that as "
                f"bracket_frames ({longest}), a divisor of it as sum_frames ({self.sum_frames})"
            )


_PRODUCTS: Mapping[ProductName, tuple[str, Kind]] = {
    "counts": (".zarr", "readings"),
    "events_hdf5": (".events.h5", "events"),
    "events_dsec": (".dsec.h5", "events"),
    "binary_npy": (".binary.npy", "bits"),
    "burst_npy": (".burst.npy", "burst"),
    "tiff": (".tiff", "readings"),
    "histograms_npy": (".histograms.npy", "histograms"),
    "color_npy": (".color.npy", "readings"),
    "sums_npy": (".sums.npy", "burst"),
    "brackets_npy": (".brackets.npy", "burst"),
    "changes_hdf5": (".changes.h5", "burst"),
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
    from megalopta.sensor.contrast.model import ContrastSensor
    from megalopta.sensor.exposure import check_binary
    from megalopta.sensor.histograms import check_histograms
    from megalopta.sensor.spad.model import Sensor

    kind = kind_of(product)
    if product == "color_npy":
        sensor.filters.check_bayer()
    if kind == "readings":
        return
    if not isinstance(sensor, (Sensor, ContrastSensor) if kind == "events" else Sensor):
        lacks = f"a sensor of kind {sensor.kind!r} has no single events of photons"
        raise ValueError(f"{product}: {lacks}; remove the product or the sensor")
    try:
        if isinstance(sensor, Sensor) and kind == "histograms":
            check_histograms(sensor)
        elif isinstance(sensor, Sensor) and kind != "events":
            check_binary(sensor)
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
    cubes: CubeSettings = CubeSettings(),  # noqa: B008 (frozen)
) -> Iterator[Write]:
    """Yield a function that appends frames to a product, which appears once complete.

    `shape`: frames, rows and columns; `frame_period_s`: time between the starts of frames, s;
    `burst_frames`: binary frames per burst in that time; `cubes`: what is computed of them.
    """
    from megalopta.sensor.formats import counts_store, cubes as of_bursts, events, packed
    from megalopta.sensor.formats.recorded_frames import tiff_writer
    from megalopta.sensor.optics import demosaiced
    from megalopta.sensor.spad.model import Sensor

    (frames, rows, columns), sensor = shape, origin.sensor
    writer: AbstractContextManager[Write]
    if product == "counts":
        writer = counts_store.counts_writer(path, origin, frames)
    elif product == "tiff":
        writer = tiff_writer(path, math.prod(shape) * 4, sensor.exposure_s)
    elif product == "color_npy":
        writer = packed.npy_writer(path, (*shape, 3), "<f4")
    elif product == "histograms_npy":
        assert isinstance(sensor, Sensor)
        writer = packed.npy_writer(path, (*shape, sensor.tcspc.bins), "<u4")
    elif product in ("binary_npy", "burst_npy"):
        frames *= burst_frames if product == "burst_npy" else 1
        writer = packed.npy_writer(path, (frames, rows, -(-columns // 8)))
    elif product == "sums_npy":
        every = cubes.sum_frames
        sums = frames * burst_frames // every, rows, columns
        writer = of_bursts.sums_writer(path, sums, (every,), every)
    elif product == "brackets_npy":
        lengths = cubes.bracket_frames
        writer = of_bursts.sums_writer(path, (*shape, len(lengths)), lengths, burst_frames)
    else:
        notes = {
            "sensor": sensor.model_dump(mode="json"),
            "seed": origin.seed,
            "sequence": origin.sequence,
            "illuminance_lux": origin.illuminance_lux,
            **origin.extra,
        }
        parts = burst_frames if product == "changes_hdf5" else 1
        of_events = events.EventOrigin(
            shape=(frames * parts, rows, columns),
            frame_period_s=frame_period_s / parts,
            exposure_s=sensor.exposure_s if parts == 1 else frame_period_s / parts,
            extra=notes,
        )
        if product == "changes_hdf5":
            writer = of_bursts.changes_writer(path, of_events, cubes)
        else:
            is_dsec = product == "events_dsec"
            writer = events.events_hdf5_writer(path, of_events, is_dsec=is_dsec)
    with writer as write:
        append: Write = write
        of_readings: dict[ProductName, Write] = {
            "tiff": lambda drawn: append(drawn.counts),
            "color_npy": lambda drawn: append(demosaiced(drawn.counts, sensor.filters)),
        }
        yield of_readings.get(product, append)
