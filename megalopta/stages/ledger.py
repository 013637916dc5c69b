"""What of a dataset is finished: the manifest, with the hash of every file, and times."""

import json
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from megalopta import __version__
from megalopta.config.model import Configuration
from megalopta.core import bounded, files
from megalopta.core.errors import UserError
from megalopta.core.freshness import digest
from megalopta.core.progress import progress
from megalopta.dataset.store import (
    Dataset,
    file_hash,
    files_in,
    is_as_written,
)
from megalopta.stages.origins import provenance, provenance_changes
from megalopta.stages.registry import STAGES, with_dependents

_WORTH_TELLING_BYTES = 5e9
"""Comparing so much with its hashes takes seconds."""


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
        line = self._line(stage)
        return line if line and "files" in line else None

    def mixture(self, stage: str) -> str:
        """What is other now than when a stage was begun that is to be gone on with, or nothing."""
        line = self._line(stage)
        now = provenance(stage, self.dataset.configuration)
        return provenance_changes(line.get("provenance", {}), now) if line else ""

    def damaged(self, line: Mapping[str, Any]) -> list[Path]:
        """Files of a line of the manifest that are missing or have another size or hash."""
        written = {self.root / name: each for name, each in line["files"].items()}
        if sum(size for size, _ in written.values()) < _WORTH_TELLING_BYTES:
            return [path for path, each in written.items() if not is_as_written(path, *each)]
        found = []
        with progress(f"Comparing files of {line['stage']}", len(written), "file") as advance:
            for path, each in written.items():
                if not is_as_written(path, *each):
                    found.append(path)
                advance()
        return found

    def finished(self) -> list[str]:
        """Return the stages that are finished. Raises UserError where one of them is damaged."""
        stages = [stage for stage in STAGES if self.entry(stage)]
        for stage in stages:
            self.require(stage)
        return stages

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
        """Lines of the manifest: sequence, stage, configuration, provenance; when finished, hashes.

        Raises
        ------
        UserError
            When it is damaged, or names a file that no stage of this dataset writes.
        """
        path = self.root / "manifest.jsonl"
        try:
            lines = bounded.read_text(path).splitlines() if path.exists() else []
            found = [dict(bounded.from_json(line)) for line in lines if line]
            for line in found:
                _check_line(line, self.dataset)
        except (ValueError, TypeError, KeyError, AttributeError):
            raise UserError(f"{path} is damaged; restore it, or render into a new folder") from None
        return found

    def timings(self) -> dict[str, float]:
        """Seconds spent on each stage, interrupted runs included."""
        path = self.root / "timings.json"
        try:
            found = dict(bounded.read_json(path)) if path.exists() else {}
            return {str(stage): float(seconds) for stage, seconds in found.items()}
        except (ValueError, TypeError, OverflowError):
            raise UserError(f"{path} is damaged; remove it, it holds nothing but times") from None

    def add_time(self, stage: str, seconds: float) -> None:
        """Add to the time spent on a stage."""
        total = self.timings().get(stage, 0.0) + seconds
        self._write_timings({**self.timings(), stage: round(total, 3)})

    def begin(self, stage: str) -> None:
        """Note what the output of a stage is made with, so that it goes on with the same."""
        if not self._line(stage) or not self.has(stage):
            self._enter(stage, {})

    def finish(self, stage: str) -> None:
        """Enter a finished stage, with the hashes of its files, into the manifest."""
        hashes = {
            str(path.relative_to(self.root)): (path.stat().st_size, file_hash(path))
            for path in sorted(files_in(self.outputs(stage)))
        }
        self._enter(stage, {"files": hashes})

    def withdraw(self, stage: str) -> None:
        """Forget that a stage was begun of which nothing came."""
        if not self.entry(stage) and not self.has(stage):
            lines = self._manifest_without(stage)
            self._write_manifest(lines)
            if not lines:
                files.remove(self.root / "manifest.jsonl")

    def forget(self, *stages: str) -> None:
        """Remove the output of stages and of every stage that needs them."""
        for stage in with_dependents(stages):
            self._write_manifest(self._manifest_without(stage))
            self._write_timings({name: t for name, t in self.timings().items() if name != stage})
            for path in (*self.outputs(stage), self.root / "report.html"):
                files.remove(path)

    def _line(self, stage: str) -> dict[str, Any] | None:
        wanted = (stage, self.dataset.sequence, stage_hash(self.dataset.configuration, stage))
        keys = ("stage", "sequence", "configuration")
        lines = (line for line in self.manifest() if tuple(map(line.get, keys)) == wanted)
        return next(lines, None)

    def _enter(self, stage: str, more: Mapping[str, Any]) -> None:
        configuration = self.dataset.configuration
        line = {
            "sequence": self.dataset.sequence,
            "stage": stage,
            "configuration": stage_hash(configuration, stage),
            "model": STAGES[stage].model(),
            "provenance": provenance(stage, configuration),
            "version": __version__,
            **more,
        }
        lines: list[Mapping[str, Any]] = [*self._manifest_without(stage), line]
        order = list(STAGES)
        self._write_manifest(sorted(lines, key=lambda each: order.index(each["stage"])))

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


def _check_line(line: Mapping[str, Any], dataset: Dataset) -> None:
    """Raise where a line of the manifest is not as `Ledger` writes it."""
    if line["stage"] not in STAGES or not isinstance(line["sequence"], str):
        raise ValueError(line["stage"])
    if any(not isinstance(each, str) for each in line.get("provenance", {}).values()):
        raise TypeError("provenance")
    outputs = [
        str(path.relative_to(dataset.root)) for path in STAGES[line["stage"]].outputs(dataset)
    ]
    inside = tuple(f"{output}{os.sep}" for output in outputs)
    for name, (size, hashed) in line.get("files", {}).items():
        if not isinstance(size, int) or not isinstance(hashed, str):
            raise TypeError(name)
        is_output = name in outputs or name.startswith(inside)
        if line["sequence"] == dataset.sequence and not (
            is_output and name == os.path.normpath(name)
        ):
            raise ValueError(name)
