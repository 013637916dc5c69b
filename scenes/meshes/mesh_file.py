"""Mesh file with the files that it names, in its folder: buffers, materials and textures.

They are read at once, and the hash is that of all: of the file alone, that of its content.
"""

import hashlib
import os
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType

from pydantic import model_validator

from megalopta.core import bounded
from megalopta.core.errors import DamagedFileError
from megalopta.scenes.hashed_file import Hashed
from megalopta.scenes.meshes import gltf, mitsuba_xml, polygons, serialized, wavefront

MESH_BYTES = 2 * 10**9
"""Most bytes of a mesh file and all that it names."""
REPAIR = "repair it, or export it again"
"""Remedy of a damaged file."""
FORMATS: Mapping[str, ModuleType] = {
    ".glb": gltf,
    ".gltf": gltf,
    ".obj": wavefront,
    ".ply": polygons,
    ".serialized": serialized,
    ".stl": polygons,
    ".xml": mitsuba_xml,
}
"""Readers by suffix; each has `pieces_of`, and as its format needs it `names_in`, `stated` and
`unused`."""

Contents = Mapping[str, bytes]
"""Content of a file and of those that it names, by name; the file itself is first."""


class MeshFile(Hashed, frozen=True):
    """GLB, glTF, OBJ, PLY or STL file, or Mitsuba's XML or serialized."""

    @model_validator(mode="after")
    def _is_of_a_known_kind(self) -> "MeshFile":
        if self.suffix not in FORMATS:
            raise ValueError(f"{self.path} is not a {', '.join(FORMATS)} file; give one of these")
        return self

    @classmethod
    def hash_of(cls, path: str) -> str:
        """Return the hash of a file and of those that it names; errors as `contents`."""
        return _hash(_contents(path))

    @property
    def suffix(self) -> str:
        """Suffix of the file, in lower case."""
        return Path(self.path).suffix.lower()

    def contents(self) -> Contents:
        """Content of the file and of those that it names.

        Raises ValueError if one of them cannot be read, is too large, or lies elsewhere, or if they
        have changed.
        """
        contents = _contents(self.path)
        self.compare(_hash(contents))
        return contents


def _hash(contents: Contents) -> str:
    hashes = {name: hashlib.sha256(content).hexdigest() for name, content in contents.items()}
    if len(hashes) == 1:
        return next(iter(hashes.values()))
    lines = (f"{name}\0{content_hash}\n" for name, content_hash in hashes.items())
    return hashlib.sha256("".join(lines).encode()).hexdigest()


def _contents(path: str) -> Contents:
    main, reader = Path(path).name, FORMATS.get(Path(path).suffix.lower(), polygons)
    with bounded.unreadable(path):
        contents = {main: bounded.read_bytes(path, MESH_BYTES)}
    left = MESH_BYTES - len(contents[main])
    waiting = [main]
    while waiting:
        name = waiting.pop()
        if name not in contents:
            if name.lower().endswith(".mtl") and not os.path.lexists(Path(path).parent / name):
                continue  # its materials are names
            at_most = bounded.TEXT_BYTES if name.lower().endswith(".mtl") else left
            contents[name] = _beside(path, name, min(left, at_most))
            left -= len(contents[name])
        if hasattr(reader, "names_in"):
            with bounded.undamaged(path, REPAIR):
                names = reader.names_in(name, contents[name])
            waiting += [named for named in names if named not in contents]
    return contents


def _beside(path: str, name: str, at_most: int) -> bytes:
    """Content of a file in the folder of another one, which names it."""
    try:
        place = bounded.named_path(name, Path(path).parent)
    except ValueError:
        raise DamagedFileError(
            f"{path} names {bounded.quoted(name)}, which is not in its folder; put that file next "
            "to it, and let it name only that"
        ) from None
    try:
        return bounded.read_bytes(place, at_most)
    except OSError as problem:
        raise DamagedFileError(
            f"{path} names {bounded.quoted(name)}, which cannot be read ("
            f"{(problem.strerror or str(problem)).lower()}); put it there, or do not name it"
        ) from None
