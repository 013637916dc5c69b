"""Versions of the software, the rendering variant, and how to speed it up."""

import os
import platform
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version

from megalopta import __version__
from megalopta.render import CUDA_NOTE, choose_variant, has_cuda_device, llvm_in_use

PACKAGES = (
    "mitsuba", "drjit", "OpenEXR", "numpy", "scipy", "numba", "opencv-contrib-python-headless",
    "scikit-image", "trimesh", "zarr", "pydantic", "matplotlib",
)  # fmt: skip
_MISSING = "not installed"
_WIDTH = max(map(len, PACKAGES)) + 2


def versions() -> dict[str, str]:
    """Version of the program, of Python and of every package that shapes a result."""
    program = {"megalopta": __version__, "python": platform.python_version()}
    return program | {package: _version(package) for package in PACKAGES}


def _version(package: str) -> str:
    with suppress(PackageNotFoundError):
        return version(package)
    return _MISSING


def describe() -> str:
    """Return a few lines of text."""
    rows = [*versions().items(), ("machine", f"{platform.platform()}, {os.cpu_count()} cores")]
    if _version("mitsuba") == _MISSING:
        rows.append(("rendering", "pip install 'megalopta[render]'"))
    else:
        variant, (library, llvm) = choose_variant(), llvm_in_use()
        rows.append(("rendering", f"{variant.name}: {variant.reason}"))
        rows += [("libLLVM", f"{llvm}, {library}")] if library else []
        rows += [("cuda", CUDA_NOTE)] if has_cuda_device() else []
        rows += [("faster", variant.advice)] if variant.advice else []
    return "\n".join(f"{name:<{_WIDTH}}{text}" for name, text in rows)
