"""Scenes with exactly known motion, photon counts, and benchmarks of motion detectors."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

if (Path(__file__).parents[1] / "render" / "scene_renderer.py").exists():
    # In a clone the five library folders are next to this one, not in it.
    __path__.append(str(Path(__file__).parents[1]))

if TYPE_CHECKING:
    from megalopta.dataset.opened import open_dataset as open_dataset
    from megalopta.dataset.photons import photons_from_images as photons_from_images

    __version__: str


def __getattr__(name: str) -> Any:
    """Load a public name on first use."""
    if name == "open_dataset":
        from megalopta.dataset.opened import open_dataset

        return open_dataset
    if name == "photons_from_images":
        from megalopta.dataset.photons import photons_from_images

        return photons_from_images
    if name == "__version__":
        from importlib.metadata import version

        return version("megalopta")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
