"""Where baked light is kept, and the hash of all that it depends on."""

import hashlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from megalopta.core.array_store import ArrayStore
from megalopta.core.freshness import BAKE_MODEL, RENDER_MODEL
from megalopta.render import RenderSettings, mi
from megalopta.render.loading.meshes import MergedMesh
from megalopta.scenes.cameras.base import Camera
from megalopta.scenes.scene import Scene

NAMES = "density", "cells", "seen", "rows", "scatter"
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
    for sky in scene.lighting.patterns if scene.lighting else ():
        found.update(sky.pattern.tobytes())
    found.update(camera.model_dump_json().encode() + poses.tobytes())
    for mesh in meshes:
        material = scene.materials[mesh.material]
        found.update(repr((material.reflectance, material.transmittance)).encode())
        if material.emission:
            found.update(repr(material.emission.radiance).encode())
            pattern = material.emission.pattern
            found.update(b"even" if pattern is None else pattern.tobytes())
        if material.texture:
            spectra = material.texture.reflectance, material.texture.transmittance
            found.update(repr(spectra).encode())
            found.update(material.texture.weight.tobytes())
        for values in (mesh.vertices, mesh.faces, mesh.normals, mesh.uv):
            found.update(b"none" if values is None else np.ascontiguousarray(values).tobytes())
    return found.hexdigest()


def light_store(folder: Path | None, key: str) -> ArrayStore:
    """Return where baked light is kept; without a folder nothing is."""
    return ArrayStore(folder, key, MOST_BYTES)
