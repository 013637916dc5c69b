"""Baked light kept on disk under a hash of all that it depends on, for whoever needs it again."""

import contextlib
import hashlib
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta import files
from megalopta.freshness import BAKE_MODEL, RENDER_MODEL
from megalopta.render import RenderSettings, mi
from megalopta.render.loading import MergedMesh
from megalopta.scenes.cameras import Camera
from megalopta.scenes.world import Scene

Contents = dict[str, NDArray[Any]]

NAMES = "density", "cells", "seen", "rows"
MOST_BYTES = 4 * 10**9
"""Of all stored light: beyond it the oldest goes."""


def key_of(
    scene: Scene,
    meshes: Sequence[MergedMesh],
    settings: RenderSettings,
    camera: Camera,
    poses: NDArray[np.float64],
    seed: int,
) -> str:
    """Hash of all that baked light depends on."""
    found = hashlib.blake2b(digest_size=16)
    settled = settings.bands_nm, settings.max_depth, settings.standing_error
    found.update(
        repr((RENDER_MODEL, BAKE_MODEL, mi.variant(), seed, settled, scene.lighting)).encode()
    )
    found.update(camera.model_dump_json().encode() + poses.tobytes())
    for mesh in meshes:
        material = scene.materials[mesh.material]
        found.update(repr(material.reflectance).encode())
        if material.emission:
            found.update(repr(material.emission.radiance).encode())
            pattern = material.emission.pattern
            found.update(b"even" if pattern is None else pattern.tobytes())
        if material.texture:
            found.update(repr(material.texture.reflectance).encode())
            found.update(material.texture.weight.tobytes())
        for values in (mesh.vertices, mesh.faces, mesh.normals, mesh.uv):
            found.update(b"none" if values is None else np.ascontiguousarray(values).tobytes())
    return found.hexdigest()


class LightStore:
    """A folder of baked light; without one nothing is kept."""

    def __init__(self, folder: Path | None, key: str) -> None:
        self._path = folder / f"{key}.npz" if folder else None

    def read(self) -> Contents | None:
        """What was kept, None where nothing was or what is there is damaged."""
        if self._path is None:
            return None
        try:
            with self._path.open("rb") as file, np.load(file) as found:
                contents = {name: found[name] for name in NAMES}
            self._path.touch()
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
            return None
        return contents

    def write(self, contents: Contents) -> None:
        """Keep it if there is room; light is found again where it was not kept."""
        if self._path is None:
            return
        with contextlib.suppress(OSError):
            with files.atomic_write(self._path) as temporary, temporary.open("wb") as file:
                np.savez(file, allow_pickle=False, **{name: contents[name] for name in NAMES})
            _prune(self._path.parent)


def _prune(folder: Path) -> None:
    """Remove what was used the longest ago, beyond what may stay."""
    kept = sorted(folder.glob("*.npz"), key=lambda path: -path.stat().st_mtime)
    sizes = np.cumsum([path.stat().st_size for path in kept])
    for path, size in zip(kept[1:], sizes[1:], strict=True):
        if size > MOST_BYTES:
            path.unlink(missing_ok=True)
