"""Versions of the software, the rendering variant, and how to speed it up."""

import os
import platform
from importlib.metadata import PackageNotFoundError, version

from megalopta import __version__
from megalopta.render import CUDA_NOTE, choose_variant, has_cuda_device, llvm_in_use

PACKAGES = (
    "mitsuba",
    "drjit",
    "OpenEXR",
    "numpy",
    "scipy",
    "numba",
    "opencv-python-headless",
    "scikit-image",
    "trimesh",
    "zarr",
    "pydantic",
    "matplotlib",
)
_MISSING = "not installed"
_WIDTH = max(map(len, PACKAGES)) + 2


def versions() -> dict[str, str]:
    """Version of the program, of Python and of every package that shapes a result."""
    own = {"megalopta": __version__, "python": platform.python_version()}
    return own | {package: _version(package) for package in PACKAGES}


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return _MISSING


def describe() -> str:
    """Return a few lines of text."""
    lines = [f"{name:<{_WIDTH}}{number}" for name, number in versions().items()]
    machine = f"{platform.platform()}, {os.cpu_count()} cores"
    lines.append(f"{'machine':<{_WIDTH}}{machine}")
    if _version("mitsuba") == _MISSING:
        return "\n".join([*lines, f"{'rendering':<{_WIDTH}}pip install 'megalopta[render]'"])
    return "\n".join([*lines, *_rendering()])


def _rendering() -> list[str]:
    variant = choose_variant()
    lines = [f"{'rendering':<{_WIDTH}}{variant.name}: {variant.reason}"]
    library, found = llvm_in_use()
    if library:
        lines.append(f"{'libLLVM':<14}{found}, {library}")
    if has_cuda_device():
        lines.append(f"{'cuda':<14}{CUDA_NOTE}")
    if variant.advice:
        lines.append(f"{'faster':<{_WIDTH}}{variant.advice}")
    return lines
