"""Ledger of finished stages: record of the sequence, hash of every file, and times."""

import json
import os
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path

from megalopta import __version__
from megalopta.config.model import Configuration
from megalopta.core import bounded, files
from megalopta.core.errors import UserError, shell_command
from megalopta.core.format_numbers import written
from megalopta.core.freshness import digest
from megalopta.core.progress import step
from megalopta.dataset.record import SequenceRecord, StageRecord, read_record
from megalopta.dataset.store import Dataset, file_difference, hashes_of
from megalopta.stages.registry import (
    STAGES,
    provenance,
    provenance_changes,
    stage_configuration,
    with_dependents,
)


class Ledger:
    """Ledger of one sequence, whose record is read once.

    Raises UserError if the record is damaged, or names a file that no stage of this dataset writes.
    """

    def __init__(self, dataset: Dataset) -> None:
        self.dataset, self.root = dataset, dataset.root
        self.record = dataset.record or self._read()
        for stage, entry in self.record.stages.items():
            self._check_entry(stage, entry)

    def outputs(self, stage: str) -> list[Path]:
        """Files and folders that a stage writes."""
        return STAGES[stage].outputs(self.dataset)

    def has(self, stage: str) -> bool:
        """True if any output of a stage exists, finished or not."""
        return any(map(files.holds_files, self.outputs(stage)))

    def is_finished(self, stage: str) -> bool:
        """True if a stage was finished with this configuration and its files exist."""
        return self.entry(stage) is not None and not self.damaged(stage)

    def is_outdated(self, stage: str) -> bool:
        """True if a stage was finished with this configuration by another model."""
        entry = self.entry(stage)
        return entry is not None and entry.made_with.get("model") != STAGES[stage].model()

    def entry(self, stage: str) -> StageRecord | None:
        """Record of a stage finished with this configuration."""
        entry = self._begun(stage)
        return entry if entry and entry.files is not None else None

    def mixture(self, stage: str) -> str:
        """Changes since an unfinished stage was begun; empty if there are none."""
        entry = self._begun(stage)
        now = provenance(stage, self.dataset.configuration)
        return provenance_changes(entry.made_with, now) if entry else ""

    def damaged(self, stage: str) -> list[Path]:
        """Files of a finished stage that are missing or have another size or hash."""
        entry = self.entry(stage)
        with step(f"comparing files of {stage}"):
            known = entry.files or {} if entry else {}
            written = {self.root / name: each for name, each in known.items()}
            return [path for path, each in written.items() if file_difference(path, *each)]

    def finished(self) -> list[str]:
        """Return the finished stages. Raises UserError if one of them is damaged."""
        stages = [stage for stage in STAGES if self.entry(stage)]
        for stage in stages:
            self.require(stage)
        return stages

    def require(self, stage: str) -> None:
        """Refuse to continue if a stage is damaged or not finished with this configuration."""
        home, damaged = self.dataset.home, self.damaged(stage)
        if self.entry(stage) and not damaged:
            return
        target = (home, "--out", home) if stage == "render" else (home,)
        what = (
            f"{damaged[0]} is missing or damaged"
            if damaged
            else f"{home}: stage {stage!r} is not finished with this configuration"
        )
        raise UserError(
            f"{what}; run first: {shell_command(*STAGES[stage].command.split(), *target)}"
        )

    def timings(self) -> dict[str, float]:
        """Seconds spent on each stage, including interrupted runs."""
        path = self.root / "timings.json"
        with bounded.undamaged(path, "remove it (it holds only times)"):
            found = dict(bounded.read_json(path)) if path.exists() else {}
            return {str(stage): float(seconds) for stage, seconds in found.items()}

    def add_time(self, stage: str, seconds: float) -> None:
        """Add to the time spent on a stage."""
        total = self.timings().get(stage, 0.0) + seconds
        self._write_timings({**self.timings(), stage: round(total, 3)})

    def begin(self, stage: str) -> None:
        """Record what a stage is run with, so that it continues with the same.

        Quickly derived output that was begun by other code is removed.
        """
        if STAGES[stage].is_derived and self.mixture(stage):
            self.forget(stage)
        if not self._begun(stage) or not self.has(stage):
            self._enter(stage, stage_record(self.dataset, stage, None))

    def finish(self, stage: str) -> None:
        """Record a finished stage with the hashes of its files."""
        self._enter(stage, stage_record(self.dataset, stage, self.outputs(stage)))

    def withdraw(self, stage: str) -> None:
        """Forget a stage that was begun without output."""
        if not self.entry(stage) and not self.has(stage):
            self._remove(stage)

    def forget(self, *stages: str) -> None:
        """Remove the output of stages and of all stages that need them."""
        for stage in with_dependents(stages):
            self._remove(stage)
            self._write_timings({name: t for name, t in self.timings().items() if name != stage})
            for path in (*self.outputs(stage), self.root / "report.html"):
                files.remove(path)

    def _read(self) -> SequenceRecord:
        """Read the record of a dataset of one; return an empty one if nothing was begun."""
        path, name = self.dataset.record_path, self.dataset.sequence
        if not os.path.lexists(path):
            return SequenceRecord(format=written("sequence"), sequence=name)
        return read_record(path, name, is_lone=True)

    def _begun(self, stage: str) -> StageRecord | None:
        entry = self.record.stages.get(stage)
        is_same = entry and entry.settings == stage_hash(self.dataset.configuration, stage)
        return entry if is_same else None

    def _enter(self, stage: str, entry: StageRecord) -> None:
        self._write({**self.record.stages, stage: entry})

    def _remove(self, stage: str) -> None:
        left = {name: each for name, each in self.record.stages.items() if name != stage}
        if left:
            self._write(left)
        else:
            self.record = self.record.model_copy(update={"stages": {}})
            files.remove(self.dataset.record_path)
            with suppress(OSError):  # it holds other files, or does not exist
                self.dataset.record_path.parent.rmdir()

    def _write(self, stages: Mapping[str, StageRecord]) -> None:
        ordered = {name: stages[name] for name in STAGES if name in stages}
        self.record = self.record.model_copy(update={"stages": ordered})
        files.write_text(self.dataset.record_path, self.record.to_json())

    def _write_timings(self, timings: Mapping[str, float]) -> None:
        files.write_json(self.root / "timings.json", timings)

    def _check_entry(self, stage: str, entry: StageRecord) -> None:
        """Refuse records that `Ledger` does not write."""
        names = [str(path.relative_to(self.root)) for path in self.outputs(stage)]
        inside = tuple(f"{name}{os.sep}" for name in names)
        for name in entry.files or {}:
            if name not in names and not name.startswith(inside):
                raise UserError(
                    f"{self.dataset.record_path} is damaged ({bounded.quoted(name, 60)!r} is no "
                    f"output of stage {stage!r}); restore it, or render into a new folder"
                )


def stage_record(dataset: Dataset, stage: str, outputs: Iterable[Path] | None) -> StageRecord:
    """Record of a stage: its model and libraries, and the hashes of its output if finished."""
    return StageRecord(
        settings=stage_hash(dataset.configuration, stage),
        made_with=provenance(stage, dataset.configuration),
        version=__version__,
        files=None if outputs is None else hashes_of(dataset.root, outputs),
    )


def stage_hash(configuration: Configuration, stage: str) -> str:
    """Hash of every setting that a stage's output depends on."""
    return digest(json.dumps(stage_configuration(configuration, stage), sort_keys=True))
