"""What a result depends on beside its inputs: code or a declared model, and libraries.

What is quickly made again (detectors, benchmarks) depends on the code itself: any change makes it
again. What takes long (frames, counts) depends on a version that is raised by whoever changes what
comes out; tests that render again fail where that was forgotten.
"""

import hashlib
from functools import cache
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

RENDER_MODEL = 2
"""Of radiance: plants, ground, light, cameras, sampling; not of where code stands."""
BAKE_MODEL = 9
"""Of baked light and where it is, frames that an exposure or a shutter blurs, stated errors."""
TRUTH_MODEL = 4
"""Of ground truth and of pictures, which panoramas have not: what else the render stage writes."""
SENSOR_MODEL = 7
"""Of readings: effects, their order, random streams."""

_LIBRARIES = ("numba", "numpy", "opencv-python-headless", "scikit-image", "scipy")


def digest(*parts: str | bytes) -> str:
    """BLAKE2b hash (16 bytes, in hexadecimal) of parts, whose borders count too."""
    found = hashlib.blake2b(digest_size=16)
    for part in parts:
        body = part.encode() if isinstance(part, str) else part
        found.update(f"{len(body)}:".encode() + body)
    return found.hexdigest()


@cache
def code_digest(*modules: str) -> str:
    """Hash of the sources of modules, of packages with all that is in them, and of libraries."""
    versions = [f"{name} {version(name)}" for name in _LIBRARIES]
    return digest(*versions, *(path.read_bytes() for name in modules for path in _sources(name)))


def _sources(module: str) -> list[Path]:
    spec = find_spec(module)
    assert spec is not None and spec.origin is not None, module
    folder = spec.submodule_search_locations
    return sorted(Path(folder[0]).rglob("*.py")) if folder else [Path(spec.origin)]
