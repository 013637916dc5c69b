"""A dataset on disk: the tree of `dataset.store`, shared by all sequences.

A single sequence is a dataset of one: dataset.yaml holds its configuration. Datasets of many have:

dataset.yaml          the plan, and the version that began it
sequences/SEQ.json    also configuration, statistics and poses
manifest.jsonl        a line per sequence: name, hash of the configuration, hash of its record
index.parquet         a row per frame: relative paths, times, poses
sequences.parquet     a row per sequence: settings and statistics
croissant.json        description for search engines and loaders
splits/SPLIT/Sintel/  links to the sequences of a split, as an MPI-Sintel tree
splits/SPLIT.txt      their names
failed.jsonl          failed sequences, with the reason
.making/SEQ/          an unfinished sequence; it moves into the tree when complete

A sequence belongs to the dataset once its record exists. The manifest is authoritative: a record
of another hash was modified. Two exceptions are left by a run that was killed before it wrote the
manifest: a record that it does not know yet, and a record that names the known one as its
predecessor.
"""

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from megalopta.config.recipe import Plan
from megalopta.core import bounded, files
from megalopta.core.errors import UserError, shell_command
from megalopta.core.folders import check_enclosed
from megalopta.dataset.record import SequenceRecord, read_record, stored_settings
from megalopta.dataset.store import (
    STAGING_FOLDER,
    Dataset,
    file_hash,
    open_sequence,
    read_header,
    write_header,
)

MANIFEST = "manifest.jsonl"
BOOKS = ("index", "splits", "sequences", "card")
"""Folders without files of sequences."""


@dataclass(frozen=True)
class Tree:
    """Paths and records of one dataset."""

    root: Path

    @property
    def records(self) -> Path:
        """Folder of the records."""
        return self.root / "sequences"

    @property
    def staging(self) -> Path:
        """Folder of unfinished sequences."""
        return self.root / STAGING_FOLDER

    @property
    def failures(self) -> Path:
        """List of failed sequences."""
        return self.root / "failed.jsonl"

    def record_path(self, name: str) -> Path:
        """Record of a sequence."""
        return self.records / f"{name}.json"

    @cached_property
    def lone(self) -> Dataset | None:
        """The sequence of a dataset of one; None for many, or an empty folder. Raises UserError."""
        if not os.path.lexists(self.root / "dataset.yaml") or is_of_many(self.root):
            return None
        return open_sequence(self.root)

    def names(self) -> list[str]:
        """Names of the sequences in order; of many, the finished ones."""
        if self.lone:
            return [self.lone.sequence]
        return sorted(
            path.stem for path in self.records.glob("*.json") if not files.is_temporary(path)
        )

    def record(self, name: str) -> SequenceRecord:
        """Read the record of one of many sequences. Raises UserError."""
        return read_record(self.record_path(name), name)

    def dataset(self, record: SequenceRecord) -> Dataset:
        """One of many sequences. Raises UserError for invalid settings."""
        settings = stored_settings(record, self.record_path(record.sequence))
        return Dataset(self.root, settings, record)

    def opened(self, name: str) -> Dataset:
        """A sequence; one of many if the manifest knows its record. Raises UserError."""
        if self.lone:
            return self.lone
        record = self.record(name)
        self.check_record(name, self._manifest)
        return self.dataset(record)

    @property
    def make_again(self) -> str:
        """Command that completes and repairs the dataset."""
        return shell_command("dataset", "make", self.root, "--out", self.root)

    def read_manifest(self) -> dict[str, str]:
        """Return the hash of every record by sequence name. Raises UserError."""
        path = self.root / MANIFEST
        if not os.path.lexists(path):
            return {}
        with bounded.undamaged(
            path, f"restore it, or remove it to accept the present records; run {self.make_again}"
        ):
            lines = map(bounded.from_json, bounded.read_text(path).splitlines())
            return {str(line["sequence"]): str(line["record"]) for line in lines}

    def is_known(self, name: str, manifest: Mapping[str, str]) -> bool:
        """True if the manifest has the record of a sequence with its present hash."""
        path = self.record_path(name)
        bounded.check_file(path, bounded.TEXT_BYTES)
        return manifest.get(name) == file_hash(path)

    def is_as_written(self, name: str, manifest: Mapping[str, str]) -> bool:
        """True if the program wrote the record of a sequence. Raises UserError."""
        return (
            name not in manifest
            or self.is_known(name, manifest)
            or self.record(name).replaced == manifest[name]
        )

    def check_record(self, name: str, manifest: Mapping[str, str]) -> None:
        """Refuse, with UserError, a record that the program did not write."""
        if not self.is_as_written(name, manifest):
            raise UserError(
                f"{self.record_path(name)} differs from the manifest; restore it, or remove it "
                f"and run {self.make_again}"
            )

    @cached_property
    def _manifest(self) -> Mapping[str, str]:
        return self.read_manifest()

    def plan(self) -> Plan:
        """Read the plan. Raises UserError."""
        path = self.root / "dataset.yaml"
        check_enclosed(self.root)
        header = read_header(self.root)
        if "configuration" in header:
            raise UserError(
                f"{self.root}: a dataset of one sequence, not of many; give one of `megalopta "
                "dataset make`"
            )
        with bounded.undamaged(path, "give a dataset of `megalopta dataset make`"):
            return Plan.model_validate(header["plan"])

    def write_plan(self, plan: Plan) -> None:
        """Write dataset.yaml."""
        write_header(self.root, plan=plan.model_dump(mode="json"))

    def sweep(self) -> None:
        """Remove temporary files of killed writers from the index; nobody else may be writing."""
        for folder in (self.root, *(self.root / name for name in BOOKS)):
            for path in filter(files.is_temporary, folder.glob(".part-*")):
                files.remove(path)

    def read_failures(self) -> dict[int, str]:
        """Failed sequences by index, with the reason."""
        if not os.path.lexists(self.failures):
            return {}
        with bounded.undamaged(self.failures, "remove it"):
            lines = map(bounded.from_json, bounded.read_text(self.failures).splitlines())
            return {int(each["index"]): str(each["reason"]) for each in lines}

    def write_failures(self, failures: dict[int, str]) -> None:
        """Write the list of failures; no file without any."""
        lines = [{"index": index, "reason": failures[index]} for index in sorted(failures)]
        if lines:
            files.write_text(self.failures, "".join(json.dumps(each) + "\n" for each in lines))
        else:
            files.remove(self.failures)


def is_of_many(root: Path) -> bool:
    """True if a folder holds a dataset of many sequences, begun or finished. Raises UserError."""
    return os.path.lexists(root / "dataset.yaml") and "plan" in read_header(root)
