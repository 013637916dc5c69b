"""What of a dataset is finished: the manifest, with the hash of every file, and times."""

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from megalopta import __version__, files
from megalopta.config import Configuration
from megalopta.dataset import Dataset, file_hash, files_in
from megalopta.errors import UserError
from megalopta.freshness import digest
from megalopta.stages.registry import STAGES, with_dependents


@dataclass(frozen=True)
class Ledger:
    """Bookkeeping of one dataset."""

    dataset: Dataset

    @property
    def root(self) -> Path:
        """Folder of the dataset."""
        return self.dataset.root

    def outputs(self, stage: str) -> list[Path]:
        """Files and folders that a stage writes."""
        return STAGES[stage].outputs(self.dataset)

    def has(self, stage: str) -> bool:
        """Whether any output of a stage exists, finished or not."""
        return any(path.exists() for path in self.outputs(stage))

    def is_finished(self, stage: str) -> bool:
        """Whether a stage was finished with this configuration and its files are there."""
        line = self.entry(stage)
        return line is not None and not self.damaged(line)

    def is_outdated(self, stage: str) -> bool:
        """Whether a stage was finished with this configuration by another model."""
        line = self.entry(stage)
        return line is not None and line.get("model") != STAGES[stage].model()

    def entry(self, stage: str) -> dict[str, Any] | None:
        """Line of the manifest on a stage finished with this configuration."""
        wanted = (stage, self.dataset.sequence, stage_hash(self.dataset.configuration, stage))
        keys = ("stage", "sequence", "configuration")
        lines = (line for line in self.manifest() if tuple(map(line.get, keys)) == wanted)
        return next(lines, None)

    def damaged(self, line: Mapping[str, Any]) -> list[Path]:
        """Files of a line of the manifest that are missing or have another size."""
        sizes = {self.root / name: size for name, (size, _) in line["files"].items()}
        return [path for path, size in sizes.items() if _size(path) != size]

    def require(self, stage: str) -> None:
        """Refuse to go on when a stage is not finished with this configuration, or damaged."""
        line, home = self.entry(stage), self.dataset.home
        damaged = self.damaged(line) if line else []
        if line and not damaged:
            return
        target = f"{home} --out {home}" if stage == "render" else home
        what = (
            f"{damaged[0]} is missing or damaged"
            if damaged
            else f"{home}: stage {stage!r} is not finished with this configuration"
        )
        raise UserError(f"{what}; run first: megalopta {STAGES[stage].command} {target}")

    def manifest(self) -> list[dict[str, Any]]:
        """Lines of the manifest: sequence, stage, configuration and model, file hashes."""
        path = self.root / "manifest.jsonl"
        try:
            lines = path.read_text("utf-8").splitlines() if path.exists() else []
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

    def finish(self, stage: str) -> None:
        """Enter a finished stage, with the hashes of its files, into the manifest."""
        line = {
            "sequence": self.dataset.sequence,
            "stage": stage,
            "configuration": stage_hash(self.dataset.configuration, stage),
            "model": STAGES[stage].model(),
            "version": __version__,
            "files": {
                str(path.relative_to(self.root)): (path.stat().st_size, file_hash(path))
                for path in sorted(files_in(self.outputs(stage)))
            },
        }
        lines: list[Mapping[str, Any]] = [*self._manifest_without(stage), line]
        order = list(STAGES)
        self._write_manifest(sorted(lines, key=lambda each: order.index(each["stage"])))

    def forget(self, *stages: str) -> None:
        """Remove the output of stages and of every stage that needs them."""
        for stage in with_dependents(stages):
            self._write_manifest(self._manifest_without(stage))
            self._write_timings({name: t for name, t in self.timings().items() if name != stage})
            for path in (*self.outputs(stage), self.root / "report.html"):
                files.remove(path)

    def _manifest_without(self, stage: str) -> list[dict[str, Any]]:
        mine = (stage, self.dataset.sequence)
        return [line for line in self.manifest() if (line["stage"], line["sequence"]) != mine]

    def _write_manifest(self, lines: Iterable[Mapping[str, Any]]) -> None:
        text = "".join(json.dumps(line) + "\n" for line in lines)
        files.write_text(self.root / "manifest.jsonl", text)

    def _write_timings(self, timings: Mapping[str, float]) -> None:
        files.write_json(self.root / "timings.json", timings)


def stage_configuration(configuration: Configuration, stage: str) -> dict[str, Any]:
    """The parts of a configuration that a stage's output depends on."""
    names = (*STAGES[stage].needs, stage)
    fields = {field for name in names for field in STAGES[name].fields}
    # The backend changes the speed, and rendering noise within its statistics, but not the content.
    return configuration.model_dump(mode="json", include=fields, exclude={"render": {"backend"}})


def stage_hash(configuration: Configuration, stage: str) -> str:
    """Fingerprint of every setting that a stage's output depends on."""
    return digest(json.dumps(stage_configuration(configuration, stage), sort_keys=True))


def _size(path: Path) -> int | None:
    return path.stat().st_size if path.is_file() else None


def _check_line(line: Mapping[str, Any]) -> None:
    """Raise where a line of the manifest is not as `finish` writes it."""
    if line["stage"] not in STAGES or not isinstance(line["sequence"], str):
        raise ValueError(line["stage"])
    for name, (size, hashed) in line["files"].items():
        path = Path(name)
        if not isinstance(size, int) or not isinstance(hashed, str):
            raise TypeError(name)
        if path.is_absolute() or ".." in path.parts:
            raise ValueError(name)
