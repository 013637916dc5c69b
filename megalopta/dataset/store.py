"""The dataset on disk: one folder, MPI-Sintel's tree with what Sintel lacks beside it.

    dataset.yaml                 the whole configuration and the version that made it
    manifest.jsonl               one line per finished stage of a sequence, with file hashes
    timings.json                 seconds each stage took
    training/clean|final/SEQ/    tone-mapped radiance | counts, PNG
    training/flow|occlusions|invalid|depth|camdata_left/SEQ/
    radiance|truth/SEQ/          EXR, every frame at its instant
    radiance_shutter/SEQ/        EXR, the same frames blurred and rolling, where a shutter is set
    truth_shutter/SEQ/           EXR, truth of every row at its own time, where rows are read out
    counts/SEQ/SENSOR-LEVEL.zarr
    results/SEQ/                 detector responses, errors, photon benchmark

A stage begins by agreeing with the configuration of everything that is already there; where they
differ it is refused with the differences, unless the user asks to redo it (`redo`).
"""

import hashlib
import json
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from pydantic import ValidationError

from megalopta import __version__, files
from megalopta.config import (
    Configuration,
    LightLevel,
    differences,
    level_text,
    one_sentence,
    to_yaml,
)
from megalopta.errors import UserError
from megalopta.folders import LOCK_NAME
from megalopta.sensor import ImageSensor

# Which parts of the configuration a stage's output depends on, beside those of the stages before
# it.
STAGE_FIELDS: Mapping[str, tuple[str, ...]] = {
    "render": (
        "name",
        "seed",
        "scene",
        "objects",
        "light",
        "camera",
        "trajectory",
        "shutter",
        "render",
    ),
    "sense": ("light_levels", "sensors"),
    "flow": ("methods",),
    "bench": ("methods", "benchmark"),
}
STAGE_NEEDS: Mapping[str, tuple[str, ...]] = {
    "render": (),
    "sense": ("render",),
    "flow": ("render", "sense"),
    "bench": ("render",),
}
STAGES = tuple(STAGE_FIELDS)

LICENSE = "CC0-1.0"
REDO_FOLDER = ".redo"
"""Where output is made again while the old one stays."""


@dataclass(frozen=True)
class Dataset:
    """Paths and bookkeeping of one dataset folder.

    Attributes
    ----------
    root : Path
        The folder.
    configuration : Configuration
        What its content was, or will be, made from.
    """

    root: Path
    configuration: Configuration

    @property
    def home(self) -> Path:
        """The folder that the user knows: what is made again stands in one inside it."""
        return self.root.parent if self.root.name == REDO_FOLDER else self.root

    @property
    def sequence(self) -> str:
        """Name of the sequence."""
        return self.configuration.name

    def frame(self, kind: str, index: int, suffix: str) -> Path:
        """Path of one frame's file, such as frame("radiance", 0, "exr"); files count from 1."""
        return self.root / kind / self.sequence / f"frame_{index + 1:04d}.{suffix}"

    def radiance(self, index: int) -> Path:
        """Spectral radiance of a frame."""
        return self.frame("radiance", index, "exr")

    def truth(self, index: int) -> Path:
        """Ground truth of a frame."""
        return self.frame("truth", index, "exr")

    def exposed_radiance(self, index: int) -> Path:
        """Spectral radiance of a frame as the shutter takes it, which is what sensors see."""
        is_instant = self.configuration.shutter.is_instant
        return self.frame("radiance" if is_instant else "radiance_shutter", index, "exr")

    def exposed_truth(self, index: int) -> Path:
        """Ground truth of what sensors see; motion blur has that of its middle."""
        is_rolling = self.configuration.shutter.readout_s > 0
        return self.frame("truth_shutter" if is_rolling else "truth", index, "exr")

    @property
    def scene_record(self) -> Path:
        """JSON of what was rendered with what: objects, triangles, variant, light and noise."""
        return self.root / "radiance" / self.sequence / "scene.json"

    def read_scene_record(self) -> dict[str, Any]:
        """Read what the render stage noted; empty when it did not."""
        try:
            return dict(json.loads(self.scene_record.read_text("utf-8")))
        except (OSError, ValueError):
            return {}

    def counts(self, sensor: ImageSensor, level: LightLevel) -> Path:
        """Counts of one sensor at one light level."""
        return self.root / "counts" / self.sequence / f"{exposure_name(sensor, level)}.zarr"

    def result(self, name: str) -> Path:
        """A file of the measurements."""
        return self.root / "results" / self.sequence / name

    def stage_folders(self, stage: str) -> list[Path]:
        """Folders and files that a stage writes."""
        training = [
            self.root / "training" / kind / self.sequence
            for kind in ("clean", "flow", "occlusions", "invalid", "depth", "camdata_left")
        ]
        return {
            "render": [
                *training,
                *(
                    self.root / kind / self.sequence
                    for kind in ("radiance", "truth", "radiance_shutter", "truth_shutter")
                ),
            ],
            "sense": [
                self.root / "counts" / self.sequence,
                self.root / "training/final" / self.sequence,
            ],
            "flow": [self.result("flow.json"), self.result("responses")],
            "bench": [
                self.result(name) for name in ("benchmark.json", "benchmark.csv", "benchmark-parts")
            ],
        }[stage]

    def has(self, stage: str) -> bool:
        """Whether any output of a stage exists, finished or not."""
        return any(path.exists() for path in self.stage_folders(stage))

    def is_finished(self, stage: str) -> bool:
        """Whether a stage was finished with this configuration and its files are there."""
        line = self.entry(stage)
        return line is not None and not self.damaged(line)

    def entry(self, stage: str) -> dict[str, Any] | None:
        """Line of the manifest on a stage finished with this configuration."""
        wanted = (stage, self.sequence, stage_hash(self.configuration, stage))
        keys = ("stage", "sequence", "configuration")
        lines = (line for line in self.manifest() if tuple(map(line.get, keys)) == wanted)
        return next(lines, None)

    def damaged(self, line: Mapping[str, Any]) -> list[Path]:
        """Files of a line of the manifest that are missing or have another size."""
        sizes = {self.root / name: size for name, (size, _) in line["files"].items()}
        return [path for path, size in sizes.items() if _size(path) != size]

    def require(self, stage: str) -> None:
        """Refuse to go on when a stage is not finished with this configuration, or damaged."""
        line = self.entry(stage)
        damaged = self.damaged(line) if line else []
        if line and not damaged:
            return
        target = f"{self.home} --out {self.home}" if stage == "render" else self.home
        what = (
            f"{damaged[0]} is missing or damaged"
            if damaged
            else f"{self.home}: stage {stage!r} is not finished with this configuration"
        )
        raise UserError(f"{what}; run first: megalopta {stage} {target}")

    def manifest(self) -> list[dict[str, Any]]:
        """Lines of the manifest: sequence, stage, configuration hash, file hashes."""
        path = self.root / "manifest.jsonl"
        lines = path.read_text("utf-8").splitlines() if path.exists() else []
        try:
            found = [dict(json.loads(line)) for line in lines if line]
            for line in found:
                _check_line(line)
        except (ValueError, TypeError, KeyError, AttributeError):
            raise UserError(f"{path} is damaged; restore it, or render into a new folder") from None
        return found

    def timings(self) -> dict[str, float]:
        """Seconds spent on each stage, interrupted runs included."""
        path = self.root / "timings.json"
        try:
            found = dict(json.loads(path.read_text("utf-8"))) if path.exists() else {}
            return {str(stage): float(seconds) for stage, seconds in found.items()}
        except (ValueError, TypeError):
            raise UserError(f"{path} is damaged; remove it, it holds nothing but times") from None

    def add_time(self, stage: str, seconds: float) -> None:
        """Add to the time spent on a stage."""
        total = self.timings().get(stage, 0.0) + seconds
        self._write_timings({**self.timings(), stage: round(total, 3)})

    def _write_timings(self, timings: Mapping[str, float]) -> None:
        files.write_json(self.root / "timings.json", timings)

    def finish(self, stage: str) -> None:
        """Enter a finished stage, with the hashes of its files, into the manifest."""
        line = {
            "sequence": self.sequence,
            "stage": stage,
            "configuration": stage_hash(self.configuration, stage),
            "version": __version__,
            "files": {
                str(path.relative_to(self.root)): (path.stat().st_size, file_hash(path))
                for path in sorted(files_in(self.stage_folders(stage)))
            },
        }
        lines: list[Mapping[str, Any]] = [*self._manifest_without(stage), line]
        self._write_manifest(sorted(lines, key=lambda each: STAGES.index(each["stage"])))

    def forget(self, *stages: str) -> None:
        """Remove the output of stages and of every stage that needs them."""
        for stage in with_dependents(stages):
            self._write_manifest(self._manifest_without(stage))
            self._write_timings({name: t for name, t in self.timings().items() if name != stage})
            for path in (*self.stage_folders(stage), self.root / "report.html"):
                files.remove(path)

    def _manifest_without(self, stage: str) -> list[dict[str, Any]]:
        mine = (stage, self.sequence)
        return [line for line in self.manifest() if (line["stage"], line["sequence"]) != mine]

    def _write_manifest(self, lines: Iterable[Mapping[str, Any]]) -> None:
        text = "".join(json.dumps(line) + "\n" for line in lines)
        files.write_text(self.root / "manifest.jsonl", text)


def open_dataset(root: Path) -> Dataset:
    """Open an existing dataset with the configuration it was made from. Raises UserError."""
    path = root / "dataset.yaml"
    try:
        values = dict(yaml.safe_load(path.read_text("utf-8"))["configuration"])
        return Dataset(root, Configuration.model_validate(values))
    except OSError:
        raise UserError(f"{root}: no dataset here; make one with: megalopta render") from None
    except ValidationError as error:
        raise UserError(f"{path}: {one_sentence(error, Configuration)}") from None
    except (yaml.YAMLError, TypeError, KeyError, ValueError):
        raise UserError(f"{path} is damaged; render into a new folder") from None


def begin_stages(
    root: Path, configuration: Configuration, stages: Sequence[str], redo: bool = False
) -> tuple[Dataset, list[str]]:
    """The dataset as it is, and the stages to make again, or a refusal.

    Everything already there must come from the same configuration, and the stages that these need
    must be finished. With `redo`, these stages and whatever disagrees is to be made again, and what
    depends on them goes. Nothing is changed here.
    """
    new = Dataset(root, configuration)
    old = existing(root) or new
    stale = [
        other
        for other in STAGES
        if old.has(other)
        and stage_configuration(old.configuration, other)
        != stage_configuration(configuration, other)
    ]
    changes = _changes(old, new, stale)
    if stale and not redo:
        raise UserError(
            f"{root} holds {' and '.join(stale)} output of another configuration "
            f"({changes}); choose another folder, or add --redo to replace it"
        )
    again = [stage for stage in stages if redo and old.has(stage)]
    doomed = with_dependents([*stale, *again])
    needs = {need for stage in stages for need in STAGE_NEEDS[stage]}
    for needed in [stage for stage in STAGES if stage in needs.difference(stages)]:
        if needed in doomed:
            raise UserError(
                f"{root}: --redo of {stages[0]!r} alone would remove the {needed!r} output, which "
                f"disagrees ({changes}); run with --redo first: megalopta {needed}"
            )
        new.require(needed)
    return old, doomed


def existing(root: Path) -> Dataset | None:
    """The dataset in a folder, None where nothing is. Raises UserError for something else."""
    if (root / "dataset.yaml").exists():
        return open_dataset(root)
    if root.exists() and (not root.is_dir() or {p.name for p in root.iterdir()} - {LOCK_NAME}):
        raise UserError(f"{root} exists and is no dataset; choose a new folder")
    return None


def with_dependents(stages: Collection[str]) -> list[str]:
    """Stages and all that need one of them, in order."""
    doomed: set[str] = set()
    for stage in STAGES:
        if stage in stages or doomed.intersection(STAGE_NEEDS[stage]):
            doomed.add(stage)
    return [stage for stage in STAGES if stage in doomed]


def _changes(old: Dataset, new: Dataset, stages: Sequence[str]) -> str:
    changes = differences(_union(old.configuration, stages), _union(new.configuration, stages))
    more = f" and {len(changes) - 3} more" if len(changes) > 3 else ""
    return "; ".join(changes[:3]) + more


def exposure_name(sensor: ImageSensor, level: LightLevel) -> str:
    """Name of the counts of one sensor at one light level, such as "spadcam-starlight"."""
    return f"{sensor.name}-{level_text(level)}"


def stage_configuration(configuration: Configuration, stage: str) -> dict[str, Any]:
    """The parts of a configuration that a stage's output depends on."""
    fields = {field for needed in (*STAGE_NEEDS[stage], stage) for field in STAGE_FIELDS[needed]}
    # The backend changes the speed, and rendering noise within its statistics, but not the content.
    return configuration.model_dump(mode="json", include=fields, exclude={"render": {"backend"}})


def stage_hash(configuration: Configuration, stage: str) -> str:
    """Fingerprint of everything a stage's output depends on."""
    content = json.dumps(stage_configuration(configuration, stage), sort_keys=True)
    return hashlib.blake2b(content.encode(), digest_size=16).hexdigest()


def _union(configuration: Configuration, stages: Sequence[str]) -> dict[str, Any]:
    return {
        key: value
        for stage in stages
        for key, value in stage_configuration(configuration, stage).items()
    }


def write_configuration(dataset: Dataset) -> None:
    """Write dataset.yaml."""
    header = {"megalopta": __version__, "license": LICENSE}
    body = {"configuration": yaml.safe_load(to_yaml(dataset.configuration))}
    text = yaml.safe_dump({**header, **body}, sort_keys=False, allow_unicode=True, width=100)
    files.write_text(dataset.root / "dataset.yaml", text)


def files_in(paths: Iterable[Path]) -> Iterable[Path]:
    """Files among these paths and in the folders among them, but for half-written ones."""
    for path in paths:
        inside = path.rglob("*") if path.is_dir() else [path]
        yield from (each for each in inside if each.is_file() and not files.is_temporary(each))


def whole_of(path: Path) -> Path:
    """What is written at once with a file: the outermost Zarr store that it lies in, or itself."""
    stores = [folder for folder in path.parents if folder.suffix == ".zarr"]
    return stores[-1] if stores else path


def file_hash(path: Path) -> str:
    """BLAKE2b hash (16 bytes, in hexadecimal) of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, lambda: hashlib.blake2b(digest_size=16)).hexdigest()


def _size(path: Path) -> int | None:
    return path.stat().st_size if path.is_file() else None


def _check_line(line: Mapping[str, Any]) -> None:
    """Raise where a line of the manifest is not as `finish` writes it."""
    if not isinstance(line["stage"], str) or line["stage"] not in STAGES:
        raise ValueError(line["stage"])
    for name, (size, digest) in line["files"].items():
        path = Path(name)
        if not isinstance(size, int) or not isinstance(digest, str):
            raise TypeError(name)
        if path.is_absolute() or ".." in path.parts:
            raise ValueError(name)
