"""One sequence of a dataset: its light, its counts, its motion.

Frames are read, or drawn, on access.
"""

import operator
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from megalopta.config.drawing import repeated_name
from megalopta.config.model import Configuration, LightLevel
from megalopta.config.rendering import LabelName
from megalopta.config.yaml_model import validated
from megalopta.core.bounded import undamaged
from megalopta.core.errors import UserError, refused_as, shell_command
from megalopta.core.validation import merged
from megalopta.dataset.store import Dataset, exposure_name

if TYPE_CHECKING:
    import xarray

    from megalopta.dataset.inertial import ImuReadings
    from megalopta.dataset.labels import PointTracks
    from megalopta.dataset.reprojection import TruthReader
    from megalopta.sensor import OpenedCounts, StoredFrames

Float32 = NDArray[np.float32]
Index = int | slice | list[int] | NDArray[np.integer[Any]]


@dataclass(frozen=True, eq=False)
class LazyFrames:
    """An array (T, …) whose frames are read on access.

    light[3], light[3:7], light[[0, 5]], light[3:7, 10:20, 10:20], numpy.asarray(light)
    """

    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    unit: str
    """Unit of its values"""
    dimensions: tuple[str, ...]
    """Names of its axes"""
    read: Callable[[list[int]], NDArray[Any]] = field(repr=False)
    """Maps numbers of frames (n,) to an array (n, …)"""

    @property
    def ndim(self) -> int:
        """Number of axes."""
        return len(self.shape)

    def __len__(self) -> int:
        """Return the number of frames."""
        return self.shape[0]

    def __getitem__(self, index: Index | tuple[Any, ...]) -> NDArray[Any]:
        """Read frames; further indices apply to the frames read."""
        first, further = (index[0], index[1:]) if isinstance(index, tuple) else (index, ())
        if isinstance(first, slice):
            return self._frames(list(range(*first.indices(len(self)))))[(slice(None), *further)]
        if isinstance(first, list | np.ndarray):
            chosen = np.arange(len(self))[np.asarray(first)].tolist()
            return self._frames(chosen)[(slice(None), *further)]
        number = operator.index(first)
        if not -len(self) <= number < len(self):
            raise IndexError(f"frame {number} of {len(self)}")
        return np.asarray(self._frames([number % len(self)])[(0, *further)])

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> NDArray[Any]:
        """Read the whole array."""
        return np.asarray(self[:], dtype=dtype)

    def _frames(self, numbers: list[int]) -> NDArray[Any]:
        if not numbers:
            return np.zeros((0, *self.shape[1:]), self.dtype)
        return self.read(numbers)


class Sequence:
    """Lazy arrays of one sequence; frames count from 0.

    Attributes
    ----------
    name : str
    split : str
    dataset : Dataset
        Paths of its files.
    """

    def __init__(self, dataset: Dataset) -> None:
        self.dataset, self.name = dataset, dataset.sequence
        self.split = dataset.former.split
        self._opened: dict[str, OpenedCounts] = {}

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle without open files and caches."""
        return Sequence, (self.dataset,)

    def __repr__(self) -> str:
        """Describe the sequence."""
        size = f"{self.shape[1]} × {self.shape[0]}"
        return f"Sequence({self.name!r}, {len(self)} frames of {size}, split {self.split!r})"

    def __len__(self) -> int:
        """Return the number of frames."""
        return self.configuration.trajectory.frames

    @property
    def configuration(self) -> Configuration:
        """Complete configuration of the sequence."""
        return self.dataset.configuration

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.configuration.camera.height, self.configuration.camera.width

    @property
    def bands_nm(self) -> tuple[tuple[float, float], ...]:
        """Lower and upper edge of each band of the radiance, nm."""
        return self.configuration.render.bands_nm

    @property
    def times_s(self) -> NDArray[np.float64]:
        """Time of each frame (T,), s; the first is at 0."""
        return self.configuration.trajectory.times_s

    @cached_property
    def poses(self) -> NDArray[np.float64]:
        """Camera axes (+x right, +y down, +z forward) to world meters (T, 4, 4)."""
        return self.configuration.trajectory.poses()

    @property
    def intrinsics(self) -> NDArray[np.float64] | None:
        """Pinhole matrix (3, 3), px, pixel centers at half integers; None for a panorama."""
        return self.configuration.camera.intrinsics

    @property
    def undistortion_map(self) -> Float32:
        """Columns and rows (H, W, 2) for `cv2.remap`, which undistorts images with them.

        Each pixel of a pinhole's image with the same matrix gets its place in the distorted image,
        with pixel centers at integers; NaN where there is none. Raises UserError for other cameras
        than kind `opencv`.
        """
        from megalopta.scenes import OpenCVCamera

        camera = self.configuration.camera
        if not isinstance(camera, OpenCVCamera):
            raise UserError(
                f"{self.name}: camera.kind {camera.kind!r} has no undistortion map; only 'opencv' "
                "has one"
            )
        return camera.undistortion_map().astype(np.float32)

    @property
    def radiance(self) -> LazyFrames:
        """Spectral radiance (T, H, W, B), W·m⁻²·sr⁻¹·nm⁻¹, through the shutter."""
        from megalopta.dataset.frames import read_radiance_frame

        read = partial(read_radiance_frame, self.dataset)
        return self._by_frame(read, "W·m⁻²·sr⁻¹·nm⁻¹", band=len(self.bands_nm))

    @property
    def exposures(self) -> tuple[str, ...]:
        """Names of the stored exposures, such as "spadcam-starlight"."""
        return self.dataset.exposures

    def counts(self, exposure: str | None = None, quantity: str = "counts") -> LazyFrames:
        """Readings of a sensor (T, H, W); by default of the first exposure.

        Other quantities are "saturated", and the means "photons", "mean_reading" and
        "reading_variance" over noise. Raises UserError if there is no such exposure or quantity.
        """
        with refused_as(self.name):
            return self._lazy(self._open(self._exposure(exposure))[quantity], quantity)

    def corrected(self, exposure: str | None = None, quantity: str = "detections") -> LazyFrames:
        """Corrected frames of a SPAD array (T, H, W); by default of the first exposure.

        Quantities are "detections", "variance", "filled" and "ambiguous". Raises UserError if the
        dataset has none (`megalopta sense --correct`).
        """
        from megalopta.sensor import StoredFrames

        name = f"{self._exposure(exposure)}.zarr"
        path = self.dataset.root / "corrected" / self.name / name
        with undamaged(
            path, "sense with --correct, or with `correct: true` below `every` of a plan"
        ):
            return self._lazy(StoredFrames.open(self.dataset.store(path), quantity), quantity)

    def expose(
        self,
        sensor: Any,
        level: LightLevel | None = None,
        *,
        gain: float = 1.0,
        repeat: int = 0,
        **changes: Any,
    ) -> LazyFrames:
        """Readings of any sensor in this light (T, H, W), drawn on access.

        Raises UserError if there is no such sensor or level, or an exposure is longer than a frame.

        Parameters
        ----------
        sensor
            A preset's name, fields as in a configuration, or a sensor.
        level : str or float or None
            Light level by name or in lux; default: the rendered light.
        gain : float
            Further factor on the light.
        repeat : int
            Number of an independent draw of the noise on the same device.
        **changes
            Changed fields of the sensor, such as exposure_s=1e-3.
        """
        from megalopta.dataset.frames import read_radiance_frame
        from megalopta.sensor import expose

        settings = self.configuration
        chosen = level if level is not None else settings.light.resolved().illuminance_lux
        if hasattr(sensor, "model_dump"):
            sensor = sensor.model_dump(mode="json")
        fields = {"preset": sensor} if isinstance(sensor, str) else dict(sensor)
        values = settings.model_dump(mode="json", exclude={"sensors", "light_levels"})
        values |= {"sensors": [merged(fields, changes)], "light_levels": [chosen]}
        exposed = validated(Configuration, values, "expose")
        with refused_as("expose"):
            exposed.check_exposures()
        device = repeated_name(exposed.sensors[0], repeat)
        if not gain > 0:
            raise UserError(f"gain {gain!r}: give a number above 0")
        scale = (exposed.light_scale(chosen) * gain).astype(np.float32)
        name = f"{self.name}/{exposure_name(device, chosen)}"

        def read(number: int) -> NDArray[Any]:
            reading = expose(
                read_radiance_frame(self.dataset, number)[np.newaxis] * scale,
                settings.render.bands_nm,
                device,
                seed=settings.seed,
                stream=f"{name}/gain {gain!r}" if gain != 1 else name,
                first_frame=number,
                frame_period_s=1 / settings.trajectory.frame_rate_hz,
            )
            return np.asarray(reading.counts[0])

        dtype = np.float32 if device.unit == "electrons" else np.uint32
        return self._by_frame(read, f"{device.unit} per exposure", dtype)

    def flow(self, first: int, second: int | None = None) -> Float32:
        """Flow (H, W, 2) from a frame to any other, by default the next.

        In px of the image, +x right, +y down, NaN where undefined. Between neighbors it is the
        stored one, otherwise it is computed from depth, poses and motions.
        """
        return self._truth.flow(first, first + 1 if second is None else second)

    def flow_to(self, camera: "Sequence", first: int, second: int | None = None) -> Float32:
        """Flow (H, W, 2), px, into the image of another camera of the rig, from depth and poses.

        It ends in that camera's frame of the same number, or another. Raises UserError if the other
        sequence shows another scene or path.
        """
        mine, its = self.configuration, camera.configuration
        if mine.trajectory.mounted(None) != its.trajectory.mounted(None) or mine.scene != its.scene:
            raise UserError(
                f"{camera.name} shows another scene or path than {self.name}; give a camera of "
                "the same rig"
            )
        return self._truth.flow_to(camera._truth, first, first if second is None else second)

    @property
    def disparity(self) -> LazyFrames:
        """Disparity (T, H, W), px, to the camera `stereo_with`; NaN from 1024 px on.

        Raises UserError without such a camera.
        """
        from megalopta.dataset.sintel import read_disparity

        if self.configuration.stereo_with is None:
            raise UserError(f"{self.name}: no second camera side by side, and thus no disparity")
        frame = self.dataset.frame
        return self._by_frame(lambda n: read_disparity(frame("training/disparities", n)), "px")

    @property
    def imu(self) -> "ImuReadings":
        """Readings of the IMU on the rig. Raises UserError without one."""
        from megalopta.dataset.inertial import read_imu

        return read_imu(self.dataset.compared(self.dataset.imu / "imu0/data.csv"))

    def occlusion(self, first: int, second: int | None = None) -> NDArray[np.bool_]:
        """Mask (H, W) of a frame's pixels that are hidden in another, or out of its view.

        Between neighbors it is the stored, traced one; otherwise it is computed from the depth of
        the other frame, to about a pixel at edges.
        """
        return self._truth.occlusion(first, first + 1 if second is None else second)

    @property
    def depth(self) -> LazyFrames:
        """Depth (T, H, W), m, along the optical axis, or along the ray in a panorama; sky: inf."""
        return self._by_frame(lambda index: self._truth.frame(index).depth, "m")

    @property
    def normals(self) -> LazyFrames:
        """Surface normals (T, H, W, 3), world axes, toward the camera; NaN for the sky."""
        return self._by_frame(lambda index: self._truth.frame(index).normal, "1", axis=3)

    @property
    def object_ids(self) -> LazyFrames:
        """Object number (T, H, W); 0 is the sky."""
        return self._by_frame(lambda index: self._truth.frame(index).object_id, "1", np.uint32)

    @property
    def class_ids(self) -> LazyFrames:
        """Number of the object's class (T, H, W), an index of `class_names`."""
        return self._by_frame(lambda index: self._truth.frame(index).kind_id, "1", np.uint32)

    @property
    def class_names(self) -> tuple[str, ...]:
        """Names of the classes: of the sky, and of all kinds of objects."""
        return "sky", *map(str, self.dataset.read_scene_record().get("kinds", ()))

    @property
    def albedo(self) -> LazyFrames:
        """Diffuse reflectance (T, H, W, B), means over the bands; the sky's is 0.

        The configuration has `albedo` among its `labels`; otherwise raises UserError.
        """
        from megalopta.render import read_radiance

        self._require_label("albedo")
        place = partial(self.dataset.frame, "training/albedo")
        return self._by_frame(lambda n: read_radiance(place(n))[0], "1", band=len(self.bands_nm))

    @property
    def leaf_clusters(self) -> LazyFrames:
        """Number of the twig (T, H, W), within its plant from 1, that bears the leaf; else 0.

        The configuration has `clusters` among its `labels`; otherwise raises UserError.
        """
        from megalopta.render.exr import read_leaf_clusters

        self._require_label("clusters")
        place = partial(self.dataset.frame, "truth")
        return self._by_frame(lambda index: read_leaf_clusters(place(index)), "1", np.uint32)

    @property
    def tracks(self) -> "PointTracks":
        """Points followed through all frames. Raises UserError if none were."""
        from megalopta.dataset.labels import read_tracks

        return read_tracks(self.dataset.compared(self.dataset.tracks))

    def to_xarray(self, *exposures: str) -> "xarray.Dataset":
        """Return a lazy xarray.Dataset with units; by default with counts of all exposures.

        Raises UserError if xarray or dask is not installed.
        """
        try:
            import dask.array as chunked
            import xarray
        except ImportError:
            raise UserError("for to_xarray run: pip install xarray dask") from None

        def flow(index: int) -> Any:
            if index + 1 < len(self):
                return self.flow(index)
            return np.full((*self.shape, 2), np.nan, np.float32)  # unknown for the last frame

        arrays = {"radiance": self.radiance}
        if self.configuration.scene.has_truth:
            arrays |= {"depth": self.depth, "flow": self._by_frame(flow, "px", component=2)}
        for name in exposures or self.exposures:
            title = f"counts {name}" if len(self.exposures) > 1 else "counts"
            arrays[title] = self.counts(name)
        variables: dict[str, Any] = {}
        for title, array in arrays.items():
            chunks = (1, *array.shape[1:])
            lazy = chunked.from_array(array, chunks=chunks, name=False, asarray=False)
            variables[title] = xarray.Variable(array.dimensions, lazy, {"units": array.unit})
        poses = xarray.Variable(("frame", "to", "from"), self.poses, {"units": "m"})
        return xarray.Dataset(
            {**variables, "camera_to_world": poses},
            coords={
                "time": ("frame", self.times_s, {"units": "s"}),
                "band_nm": ("band", np.mean(self.bands_nm, axis=1), {"units": "nm"}),
                "component": ["x", "y"],
            },
            attrs={"sequence": self.name, "split": self.split},
        )

    def _by_frame(
        self,
        read: Callable[[int], NDArray[Any]],
        unit: str,
        dtype: type[np.generic] = np.float32,
        **more: int,
    ) -> LazyFrames:
        """Frames (H, W, more axes by name), each read by its number."""
        shape, names = (len(self), *self.shape, *more.values()), ("frame", "row", "column", *more)

        def stacked(numbers: list[int]) -> NDArray[Any]:
            return np.stack([np.asarray(read(number)) for number in numbers])

        return LazyFrames(shape, np.dtype(dtype), unit, names, stacked)

    def _require_label(self, name: LabelName) -> None:
        if name not in self.configuration.labels:
            raise UserError(f"{self.name}: no {name}; render with `labels: [{name}]`")

    @cached_property
    def _truth(self) -> "TruthReader":
        from megalopta.dataset.reprojection import TruthReader

        return TruthReader(self.dataset)

    def _exposure(self, name: str | None) -> str:
        names = self.exposures
        if not names:
            again = shell_command("sense", self.dataset.root)
            raise UserError(f"{self.name}: no counts yet; run: {again}")
        name = names[0] if name is None else name
        if name not in names:
            there_are = f"there are {', '.join(names)}; {shell_command('sense', self.dataset.root)}"
            raise UserError(f"{self.name}: no exposure {name!r}; {there_are} adds others")
        return name

    def _open(self, name: str) -> "OpenedCounts":
        from megalopta.sensor import open_counts

        if name not in self._opened:
            path = self.dataset.root / "counts" / self.name / f"{name}.zarr"
            with undamaged(path):
                shape = len(self), *self.shape
                self._opened[name] = open_counts(self.dataset.store(path), shape)
        return self._opened[name]

    def _lazy(self, stored: "StoredFrames", quantity: str) -> LazyFrames:
        def read(numbers: list[int]) -> NDArray[Any]:
            chunks = {number // stored.array.chunks[0] for number in numbers}
            self.dataset.compare_chunks(stored.path / quantity, sorted(chunks))
            return stored[numbers]

        dtype, unit = np.dtype(stored.array.dtype), str(stored.array.attrs["unit"])
        return LazyFrames(stored.shape, dtype, unit, ("frame", "row", "column"), read)
