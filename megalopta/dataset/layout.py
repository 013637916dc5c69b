"""A dataset on disk: the tree of `dataset.store`, which all of its sequences share.

One sequence is a dataset of one: dataset.yaml holds its configuration. Of many there are besides:

dataset.yaml          the plan, and the version that began it
sequences/SEQ.json    also configuration, statistics and poses
manifest.jsonl        a line for each of them: name, hash of the configuration, hash of its record
index.parquet         a row for each frame: relative paths, times, poses
sequences.parquet     a row for each sequence: settings and statistics
croissant.json        what is in them, for search engines and loaders
splits/SPLIT/Sintel/  links to the sequences of a split, as an MPI-Sintel tree
splits/SPLIT.txt      their names
failed.jsonl          sequences that could not be made, with the reason
.making/SEQ/          a sequence that is not finished; it appears in the tree whole

A sequence belongs to the dataset from the moment its record is there. What the manifest says holds:
a record of another hash was changed by somebody. There are two exceptions, which a run that was
killed before it wrote the manifest leaves: a record that it does not know yet, and one that says
itself that it took the place of the record that it knows.
"""

import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from megalopta.config.recipe import Plan
from megalopta.core import bounded, files
from megalopta.core.errors import UserError
from megalopta.core.folders import check_enclosed
from megalopta.dataset.record import SequenceRecord, read_lone_record, read_record, settings_of
from megalopta.dataset.store import Dataset, file_hash, open_sequence, read_header, write_header

MANIFEST = "manifest.jsonl"
BOOKS = ("index", "splits", "sequences", "card")
"""Folders that hold no sequence's own files."""


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
        """Folder of sequences that are being made."""
        return self.root / ".making"

    @property
    def failures(self) -> Path:
        """List of sequences that could not be made."""
        return self.root / "failed.jsonl"

    def record_path(self, name: str) -> Path:
        """Record of a sequence."""
        return self.records / f"{name}.json"

    @cached_property
    def lone(self) -> Dataset | None:
        """The one sequence of a dataset of one; None of many, or of nothing. Raises UserError."""
        if not os.path.lexists(self.root / "dataset.yaml") or is_of_many(self.root):
            return None
        return open_sequence(self.root)

    def names(self) -> list[str]:
        """Names of the sequences, of many those that are finished, in order."""
        if self.lone:
            return [self.lone.sequence]
        return sorted(
            path.stem for path in self.records.glob("*.json") if not files.is_temporary(path)
        )

    def record(self, name: str) -> SequenceRecord:
        """Read the record of a sequence; of a lone one it may be empty. Raises UserError."""
        return (
            read_lone_record(self.lone) if self.lone else read_record(self.record_path(name), name)
        )

    def all_records(self) -> Iterator[SequenceRecord]:
        """Read the records one after another, in order."""
        return map(self.record, self.names())

    def dataset(self, record: SequenceRecord) -> Dataset:
        """One sequence, as the stages know it. Raises UserError for settings that are none."""
        if self.lone:
            settings = self.lone.configuration
        else:
            settings = settings_of(record, self.record_path(record.sequence))
        return Dataset(self.root, settings, record.files)

    def opened(self, name: str) -> tuple[SequenceRecord, Dataset]:
        """Record and paths of a sequence, if the manifest knows the record. Raises UserError."""
        record = self.record(name)
        if not self.lone:
            self.check_record(name, self._manifest)
        return record, self.dataset(record)

    def check_record(self, name: str, manifest: Mapping[str, str]) -> None:
        """Refuse, with UserError and the way out, a record that the program did not write."""
        if not is_record_as_written(path := self.record_path(name), manifest):
            raise UserError(
                f"{path} is not as it was written; restore it, or remove it and run "
                f"megalopta dataset make {self.root} --out {self.root}"
            )

    @cached_property
    def _manifest(self) -> Mapping[str, str]:
        return read_manifest(self.root)

    def plan(self) -> Plan:
        """Read the plan. Raises UserError."""
        path = self.root / "dataset.yaml"
        check_enclosed(self.root)
        try:
            return Plan.model_validate(read_header(self.root)["plan"])
        except (TypeError, KeyError, ValueError, AttributeError):
            raise UserError(
                f"{path}: no plan in it, or damaged; give a dataset of `megalopta dataset make`"
            ) from None

    def write_plan(self, plan: Plan) -> None:
        """Write dataset.yaml."""
        write_header(self.root, plan=plan.model_dump(mode="json"))

    def sweep(self) -> None:
        """Remove what a killed writer left among the books; nobody else may be writing."""
        for folder in (self.root, *(self.root / name for name in BOOKS)):
            for path in filter(files.is_temporary, folder.glob(".part-*")):
                files.remove(path)

    def read_failures(self) -> dict[int, str]:
        """Sequences that could not be made, by index, with the reason."""
        try:
            lines = map(bounded.from_json, bounded.read_text(self.failures).splitlines())
            return {int(each["index"]): str(each["reason"]) for each in lines}
        except FileNotFoundError:
            return {}
        except (ValueError, KeyError, TypeError):
            raise UserError(f"{self.failures} is damaged; remove it") from None

    def write_failures(self, failures: dict[int, str]) -> None:
        """Write the list of failures; without any, there is no file."""
        lines = [{"index": index, "reason": failures[index]} for index in sorted(failures)]
        if lines:
            files.write_text(self.failures, "".join(json.dumps(each) + "\n" for each in lines))
        else:
            files.remove(self.failures)


def is_of_many(root: Path) -> bool:
    """Whether a folder holds a dataset of many sequences, begun or made. Raises UserError."""
    return os.path.lexists(root / "dataset.yaml") and "plan" in read_header(root)


def read_manifest(root: Path) -> dict[str, str]:
    """Return the hash of every record by the name of its sequence. Raises UserError."""
    path = root / MANIFEST
    try:
        lines = map(bounded.from_json, bounded.read_text(path).splitlines())
        return {str(line["sequence"]): str(line["record"]) for line in lines}
    except FileNotFoundError:
        return {}
    except (ValueError, KeyError, TypeError):
        raise UserError(
            f"{path} is damaged; restore it, or remove it to take the records as they are, and run "
            f"megalopta dataset make {root} --out {root}"
        ) from None


def is_record_known(path: Path, manifest: Mapping[str, str]) -> bool:
    """Whether the manifest has the record at a path as it is."""
    return manifest.get(path.stem) == _hash(path)


def is_record_as_written(path: Path, manifest: Mapping[str, str]) -> bool:
    """Whether the record at a path is what the program wrote. Raises UserError."""
    known = manifest.get(path.stem)
    return known in (None, _hash(path)) or read_record(path, path.stem).replaced == known


def _hash(path: Path) -> str:
    bounded.check_file(path, bounded.TEXT_BYTES)
    return file_hash(path)
