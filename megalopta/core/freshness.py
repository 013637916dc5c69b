"""What a result depends on other than its inputs: code or a declared model, and libraries."""

import hashlib
from functools import cache
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

RENDER_MODEL = 4
"""Version of radiance: plants, ground, light, cameras, sampling; not of the place of code."""
BAKE_MODEL = 15
"""Version of baked light and its places, of blurred frames, of stated errors, and of the seeds of
passes and parts, which change the noise of a frame alone."""
TRUTH_MODEL = 4
"""Version of ground truth and pictures, the other output of the render stage; not of panoramas."""
SENSOR_MODEL = 8
"""Version of readings: effects, their order, random streams."""

_LIBRARIES = ("numba", "numpy", "opencv-contrib-python-headless", "scikit-image", "scipy")


def digest(*parts: str | bytes) -> str:
    """BLAKE2b hash (16 bytes, hexadecimal) of parts and of the borders between them."""
    hashed = hashlib.blake2b(digest_size=16)
    for part in parts:
        body = part.encode() if isinstance(part, str) else part
        hashed.update(f"{len(body)}:".encode() + body)
    return hashed.hexdigest()


@cache
def code_digest(*modules: str) -> str:
    """Hash of the sources of modules, of packages with their content, and of library versions."""
    parts: list[str | bytes] = [f"{name} {version(name)}" for name in _LIBRARIES]
    for module in modules:
        spec = find_spec(module)
        assert spec is not None and spec.origin is not None, module
        folder = spec.submodule_search_locations
        paths = sorted(Path(folder[0]).rglob("*.py")) if folder else [Path(spec.origin)]
        parts += [path.read_bytes() for path in paths]
    return digest(*parts)
