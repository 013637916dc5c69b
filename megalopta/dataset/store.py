"""The dataset on disk, of one sequence or of many: MPI-Sintel's tree with additions.

docs/reference/dataset-files.md lists it. A record, written last, lists what is output.
"""

import hashlib
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from megalopta import __version__
from megalopta.config.model import Configuration, LightLevel, level_text
from megalopta.config.recipe import Plan
from megalopta.core import bounded, files, strict_yaml
from megalopta.core.errors import UserError, near_path, shell_command
from megalopta.core.folders import LOCK_NAME, check_enclosed, remove_stale_lock
from megalopta.core.format_numbers import FORMATS, check_format
from megalopta.core.progress import step
from megalopta.dataset.record import SequenceRecord, read_record, stored_settings
from megalopta.sensor import ImageSensor

if TYPE_CHECKING:
    from megalopta.dataset.picture_light import PictureLight

LICENSE = "CC0-1.0"
BOOKS = ("index", "splits", "sequences", "card")
"""Folders without files of sequences."""
_PICTURES = (
    *("clean", "final", "occlusions", "invalid", "flow_kitti"),
    *("disparities", "occlusions_stereo", "disparities_kitti"),
    *("classes", "instances", "clusters", "normals"),
)
SUFFIXES: Mapping[str, str] = {
    **dict.fromkeys(("radiance", "truth", "radiance_shutter", "truth_shutter"), "exr"),
    **{f"training/{name}": "png" for name in _PICTURES},
    "training/flow": "flo",
    "training/flow_flo5": "flo5",
    "training/depth": "dpt",
    "training/camdata_left": "cam",
    "training/albedo": "exr",
}
"""Suffix of the files of frames, by their folder"""


@dataclass
class Dataset:
    """Paths of one sequence; modified files are refused.

    A file is compared with its hash in the record before it is read, once per dataset: about 2 ms
    of processor time per megabyte, a third of decoding an EXR file. For a store of counts, opening
    compares the sizes of all files and the hashes of its metadata; the hashes of its data are
    compared a chunk at a time, as they are read. Files that are not read are not compared.

    Attributes
    ----------
    root : Path
    configuration : Configuration
        Configuration of its content.
    record : SequenceRecord or None
        Its record, whose files are compared.
    light : PictureLight or None
        Light of its pictures, if they are open.
    former : SequenceRecord
        Its record; an empty one if nothing is finished.
    files : mapping of str to (int, str)
        Bytes and hash of the files to compare, by their paths in the dataset.
    record_path, begun_path : Path
        Records of the sequence, and of the stages in progress.
    scene_record : Path
        JSON of the rendering: objects, triangles, variant, light and noise.
    tracks : Path
        Tracks of points through all frames.
    imu : Path
        Folder of an IMU's readings, and of poses, in the layouts of EuRoC and TUM.
    """

    root: Path
    configuration: Configuration
    record: SequenceRecord | None = field(default=None, repr=False, compare=False)
    light: "PictureLight | None" = field(default=None, repr=False, compare=False)
    _compared: set[str] = field(default_factory=set, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        self.sequence: str = (name := self.configuration.name)
        self.former = self.record or SequenceRecord(
            format=FORMATS["sequence"].written, sequence=name
        )
        self.files: Mapping[str, tuple[int, str]] = self.record.files if self.record else {}
        self.record_path = self.root / "sequences" / f"{name}.json"
        self.begun_path = self.record_path.with_suffix(".begun")
        self.scene_record = self.root / "radiance" / name / "scene.json"
        self.tracks = self.root / "training/tracks" / name / "tracks.npz"
        self.imu: Path = self.root / "training/imu" / name
        shutter = self.configuration.shutter
        is_blurred = shutter.exposure_s > 0 or shutter.readout_s > 0
        self._radiance = "radiance_shutter" if is_blurred else "radiance"
        self._truth = "truth_shutter" if shutter.readout_s > 0 else "truth"

    @cached_property
    def render_again(self) -> str:
        """Command that completes and repairs the rendering."""
        return shell_command("render", self.root, "--out", self.root)

    def require_truth(self) -> None:
        """Refuse, with UserError, a dataset of pictures, whose motion and depth are unknown."""
        if not self.configuration.scene.has_truth:
            raise UserError(
                f"{self.root}: made of pictures, whose true motion and depth are unknown; give a "
                "dataset of rendered frames"
            )

    def frame(self, kind: str, index: int) -> Path:
        """Path of one frame's file, such as frame("radiance", 0).

        Raises UserError if it is compared and was modified; as do all below.
        """
        return self.compared(self.root / frame_file(kind, self.sequence, index))

    def exposed_radiance(self, index: int) -> Path:
        """Spectral radiance of a frame through the shutter, as sensors see it."""
        return self.frame(self._radiance, index)

    def exposed_truth(self, index: int) -> Path:
        """Ground truth of the frame that sensors see; with motion blur, at its middle."""
        return self.frame(self._truth, index)

    def read_scene_record(self) -> dict[str, Any]:
        """Read the record of the render stage; empty if there is none."""
        try:
            return dict(bounded.read_json(self.compared(self.scene_record)))
        except (OSError, ValueError):
            return {}

    @property
    def exposures(self) -> tuple[str, ...]:
        """Names of the stored exposures, such as "spadcam-starlight"."""
        if self.former.exposures:
            return tuple(exposure.name for exposure in self.former.exposures)
        pairs = self.configuration.exposures
        return tuple(exposure_name(*pair) for pair in pairs if self.counts(*pair).exists())

    def counts(self, sensor: ImageSensor, level: LightLevel) -> Path:
        """Counts of one sensor at one light level."""
        folder = self.root / "counts" / self.sequence
        return self.store(folder / f"{exposure_name(sensor, level)}.zarr")

    def result(self, name: str) -> Path:
        """File of results."""
        return self.root / "results" / self.sequence / name

    def store(self, path: Path) -> Path:
        """Path of a store whose files and metadata are complete and unmodified."""
        inside = f"{path.relative_to(self.root).as_posix()}/" if self.files else ""
        for name in self.files:
            if name.startswith(inside):
                self._check(name, is_hashed=name.endswith("zarr.json"))
        return path

    def compared(self, path: Path) -> Path:
        """Path of a file that is unmodified, or unknown to the record."""
        name = path.relative_to(self.root).as_posix() if self.files else ""
        if name in self.files:
            self._check(name, is_hashed=True)
        return path

    def compare_all(self, start: str) -> None:
        """Compare all files whose path in the dataset begins with `start`. Raises UserError."""
        for name in self.files:
            if name.startswith(start):
                self._check(name, is_hashed=True)

    def compare_chunks(self, array: Path, chunks: Iterable[int]) -> None:
        """Compare the files that hold some chunks of frames of an array."""
        for chunk in chunks:
            key = f"{array.relative_to(self.root).as_posix()}/c/{chunk}"
            if key not in self._compared:
                self.compare_all(f"{key}/")
                self._compared.add(key)

    def _check(self, name: str, is_hashed: bool) -> None:
        if name in self._compared:
            return
        if difference := file_difference(self.root / name, *self.files[name], is_hashed=is_hashed):
            raise UserError(
                f"{self.root / name} {difference}; find other damage with: "
                f"{shell_command('check', 'files', self.root)}"
            )
        if is_hashed:
            self._compared.add(name)


def frame_file(kind: str, sequence: str, index: int) -> str:
    """Return the path of a frame's file in a dataset; files count from 1."""
    return f"{kind}/{sequence}/frame_{index + 1:04d}.{SUFFIXES[kind]}"


@dataclass(frozen=True)
class Tree:
    """A dataset's folder and its sequences, which exist once their records do."""

    root: Path

    @property
    def make_again(self) -> str:
        """Command that completes and repairs the dataset."""
        verb = ("dataset", "make") if self.plan else ("render",)
        return shell_command(*verb, self.root, "--out", self.root)

    def check(self) -> None:
        """Refuse, with UserError, a folder without a dataset, or that leads elsewhere."""
        _ = self._header

    @property
    def plan(self) -> Plan | None:
        """Plan that it is made from, if any. Raises UserError if there is no dataset."""
        if "plan" not in self._header:
            return None
        with bounded.undamaged(self.root / "dataset.yaml", "give one of `megalopta dataset make`"):
            return Plan.model_validate(self._header["plan"])

    @cached_property
    def _header(self) -> dict[str, Any]:
        path = self.root / "dataset.yaml"
        if os.path.lexists(path):
            check_enclosed(self.root)
        try:
            # larger YAML takes seconds to parse
            header = dict(strict_yaml.load(bounded.read_text(path, at_most=2**20)))
        except OSError:
            make = "megalopta render, of pictures: megalopta sense, of many: megalopta dataset make"
            near = near_path(self.root, f"make one with: {make}")
            raise UserError(f"{self.root}: no dataset here; {near}") from None
        except (TypeError, ValueError):
            raise UserError(f"{path} is damaged; make the dataset again in a new folder") from None
        check_format("dataset", header, path)
        return header

    def names(self) -> list[str]:
        """Names of the sequences in order."""
        paths = (self.root / "sequences").glob("*.json")
        return sorted(path.stem for path in paths if not files.is_temporary(path))

    def record_path(self, name: str) -> Path:
        """Record of a sequence."""
        return self.root / "sequences" / f"{name}.json"

    def record(self, name: str) -> SequenceRecord:
        """Read the record of a sequence. Raises UserError."""
        return read_record(self.record_path(name), name)

    def opened(self, name: str) -> Dataset:
        """A sequence, with its record. Raises UserError."""
        record = self.record(name)
        settings = stored_settings(record, self.record_path(name))
        return Dataset(self.root, settings, record)

    def at(self, configuration: Configuration) -> Dataset:
        """A sequence, finished or not, with settings that may differ from its record's."""
        path = self.root / "sequences" / f"{configuration.name}.json"
        record = read_record(path, configuration.name) if os.path.lexists(path) else None
        return Dataset(self.root, configuration, record)

    def write_header(self, **body: Any) -> None:
        """Write dataset.yaml with a `configuration`, or the `plan` of many."""
        number = FORMATS["dataset"].written
        header = {"format": number, "megalopta": __version__, "license": LICENSE, **body}
        files.write_text(self.root / "dataset.yaml", strict_yaml.dump(header))

    def exists(self) -> bool:
        """True if a dataset was begun here. Raises UserError for a folder of something else."""
        root = self.root
        if (root / "dataset.yaml").exists():
            return True
        inside = root.iterdir() if root.is_dir() else [root] if root.exists() else []
        if any(
            not (path.name == LOCK_NAME or files.is_temporary(Path(path.name))) for path in inside
        ):
            raise UserError(f"{root} exists and is not a dataset; choose a new folder")
        return False

    def sweep(self) -> None:
        """Remove temporary files and locks of killed writers, but not the output of stages."""
        for folder in (self.root, *(self.root / name for name in BOOKS)):
            for path in filter(files.is_temporary, folder.glob(".part-*")):
                files.remove(path)
        for path in (self.root / "sequences").glob(".*.lock"):
            remove_stale_lock(path)


def open_sequence(root: Path) -> Dataset:
    """Open a dataset of one sequence.

    Raises UserError if there is none or more, it is damaged, or leads out of its folder.
    """
    tree = Tree(root)
    plan, names = tree.plan, tree.names()
    if len(names) > 1:
        raise UserError(
            f"{root}: a dataset of {len(names)} sequences, and this takes one; see megalopta "
            "dataset --help"
        )
    if not names:
        again = tree.make_again if plan else shell_command("render", root, "--out", root)
        raise UserError(f"{root}: no finished sequence; run: {again}")
    return tree.opened(names[0])


def exposure_name(sensor: ImageSensor, level: LightLevel) -> str:
    """Name of the counts of one sensor at one light level, such as "spadcam-starlight"."""
    return f"{sensor.name}-{level_text(level)}"


@step("hashing files")
def hashes_of(root: Path, paths: Iterable[Path]) -> dict[str, tuple[int, str]]:
    """Bytes and hash of files, and of those in folders, by their paths in a dataset."""
    hashes = {}
    for path in sorted(files.files_in(paths)):
        state = path.stat()
        hashes[str(path.relative_to(root))] = state.st_size, _hash_of(path, _identity(state))
    return hashes


def whole_of(path: Path, root: Path) -> Path:
    """Return the unit of output that a file belongs to: the outermost store around it, or itself.

    Folders above the dataset may have any name.
    """
    inside = [folder for folder in path.parents if folder.is_relative_to(root) and folder != root]
    stores = [folder for folder in inside if folder.suffix == ".zarr"]
    return stores[-1] if stores else path


def file_difference(path: Path, size: int, digest: str, is_hashed: bool = True) -> str | None:
    """Return how a file differs from its record; None if it does not.

    A hash is computed once per process, while the file is unchanged.
    """
    if not os.path.isfile(path):  # noqa: PTH113 # False if it may not be read
        return "is missing"
    state = path.stat()
    if state.st_size != size or (is_hashed and _hash_of(path, _identity(state)) != digest):
        return "differs from its record"
    return None


def _identity(state: os.stat_result) -> tuple[int, ...]:
    return state.st_dev, state.st_ino, state.st_size, state.st_mtime_ns, state.st_ctime_ns


@lru_cache(maxsize=2**17)
def _hash_of(path: Path, _identity: tuple[int, ...]) -> str:
    return file_hash(path)


def file_hash(path: Path) -> str:
    """BLAKE2b hash (16 bytes, hexadecimal) of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, lambda: hashlib.blake2b(digest_size=16)).hexdigest()
