"""Scenes with exactly known motion, photon counts, and benchmarks of motion detectors.

dataset = megalopta.open_dataset("out/night")
exposure = megalopta.photons_from_images("clip.mp4", photons_per_pixel=2)
"""

from importlib import import_module
from pathlib import Path
from typing import Any

import lazy_loader

if (Path(__file__).parents[1] / "render" / "scene_renderer.py").exists():
    # In a clone the five library folders are next to this one, not in it.
    __path__.append(str(Path(__file__).parents[1]))

_load, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> Any:
    """Load a public name on first use."""
    if name == "__version__":
        from importlib.metadata import version

        return version("megalopta")
    if name in ("assets_gen", "flow", "render", "scenes", "sensor"):
        return import_module(f"megalopta.{name}")
    return _load(name)
