"""File or folder that a scene is made from; one that has changed since it was named is an error."""

import hashlib
import sys
from abc import abstractmethod
from pathlib import Path
from typing import Annotated, Any, BinaryIO

from pydantic import AfterValidator, Field, ValidationInfo, model_validator

from megalopta.core import bounded
from megalopta.core.record import Record


class Hashed(Record, frozen=True):
    """Thing by path and content; a plain path is accepted and gets its hash."""

    path: str
    """Path, in a file relative to its folder, in which it must lie."""
    sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
    """SHA-256 hash of its content, filled in; other content raises an error."""

    @classmethod
    @abstractmethod
    def hash_of(cls, path: str) -> str:
        """Return the hash of what lies at a path. Raises ValueError if it cannot be read."""

    @model_validator(mode="before")
    @classmethod
    def _hash_what_has_none(cls, values: Any, validation: ValidationInfo) -> Any:
        if isinstance(values, str | Path):
            values = {"path": values}
        if not isinstance(values, dict) or "sha256" in values:
            return values
        if not isinstance(values.get("path"), str | Path):
            return values
        path = str(bounded.named_path(values["path"], bounded.folder_of(validation)))
        return {**values, "path": path, "sha256": cls.hash_of(path)}

    def check(self) -> None:
        """Raise ValueError if the file cannot be read or has changed."""
        self.compare(self.hash_of(self.path))

    def compare(self, sha256: str) -> None:
        """Raise ValueError if a hash is another one."""
        if sha256 != self.sha256:
            raise ValueError(
                f"{self.path} has changed since it was first used; restore it, or omit its sha256"
            )


class HashedFile(Hashed, frozen=True):
    """File, or folder of files."""

    @classmethod
    def hash_of(cls, path: str) -> str:
        """Return the hash of a file, or of the names and hashes of the files of a folder.

        Raises ValueError if it cannot be read.
        """
        with bounded.unreadable(path):
            if not Path(path).is_dir():
                return sha256_of(Path(path))
            inside = [file for file in sorted(Path(path).iterdir()) if file.is_file()]
            lines = (f"{file.name}\0{sha256_of(file)}\n" for file in inside)
            return hashlib.sha256("".join(lines).encode()).hexdigest()

    def read(self) -> bytes:
        """Content of the file.

        Raises ValueError if it cannot be read or has changed.
        """
        with bounded.unreadable(self.path):
            content = bounded.read_bytes(self.path, bounded.ARRAY_BYTES)
        self.compare(hashlib.sha256(content).hexdigest())
        return content


def _named_as_a_picture(file: HashedFile) -> HashedFile:
    if not file.path.lower().endswith((".hdr", ".exr", ".png")):
        raise ValueError(f"{file.path} is not an HDR, EXR or PNG file; give one of these")
    return file


PictureFile = Annotated[HashedFile, AfterValidator(_named_as_a_picture)]
"""An HDR, EXR or PNG file by its name."""


def sha256_of(path: Path) -> str:
    """SHA-256 hash of a regular file, hexadecimal; errors as `check_file`."""
    bounded.check_file(path, sys.maxsize)
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def copied(source: BinaryIO, target: BinaryIO) -> str:
    """Copy an open file to another, and return the hash of what was copied."""
    digest = hashlib.sha256()
    while part := source.read(2**20):
        digest.update(part)
        target.write(part)
    return digest.hexdigest()
