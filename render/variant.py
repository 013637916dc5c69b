"""Choice of the Mitsuba variant: llvm, otherwise scalar, without risk of a crash.

libLLVM 15 and 16 abort the whole process from inside Dr.Jit. So a library is used only if its own
`LLVMGetVersion` reports a tested version, and its path is passed to Dr.Jit before the import.
"""

import ctypes
import os
import re
import sys
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, files
from pathlib import Path

from megalopta.render.settings import Backend

TRIED_LLVM = (17, 18, 19, 20, 21, 22, 23)
"""Versions that rendered a forest, by paths and by baked light, and its true flow, to the same bits
on x86-64; 15 and 16 abort."""
_LLVM_PACKAGE = "karellen-llvm-core"
_REMEDY = (
    f"install LLVM {TRIED_LLVM[0]} to {TRIED_LLVM[-1]} (Linux x86-64: pip install "
    f"'{_LLVM_PACKAGE}<{TRIED_LLVM[-1] + 1}'; "
    "Debian: apt-get install libllvm19)"
)

CUDA_NOTE = (
    "a device is available: --render.backend cuda traces paths several times as fast; auto stays "
    "with llvm, whose bytes are the same on every machine"
)

_LIBRARY_FOLDERS = (
    *("usr/lib/*-linux-gnu", "usr/lib64", "usr/lib", "usr/local/lib", "usr/lib/llvm-*/lib"),
    *("opt/homebrew/opt/llvm*/lib", "usr/local/opt/llvm*/lib"),
)


@dataclass(frozen=True)
class Variant:
    """Variant in use, the reason, and advice for faster rendering."""

    name: str
    """Mitsuba's name, such as "llvm_ad_spectral"."""
    reason: str
    """Reason, as one clause for readers."""
    advice: str = ""
    """Advice for faster rendering; empty if there is none."""

    def __str__(self) -> str:
        return f"{self.name} ({self.reason})" + (f"; {self.advice}" if self.advice else "")


def choose_variant(backend: Backend = "auto") -> Variant:
    """Choose the fastest correct spectral variant that cannot abort the process.

    "auto" uses llvm if it works, otherwise scalar. Raises ValueError if a named backend is not
    usable here.
    """
    if backend == "cuda":
        if has_cuda_device():
            return Variant("cuda_ad_spectral", "as requested")
        raise ValueError(
            "render.backend 'cuda': no CUDA driver with a device and OptiX is available; use "
            "'auto', 'llvm' or 'scalar'"
        )
    if backend == "scalar":
        return Variant("scalar_spectral", "as asked")
    library, version = llvm_in_use()
    if library:
        return Variant("llvm_ad_spectral", f"{Path(library).name}, LLVM {version}")
    if backend == "llvm":
        raise ValueError(f"render.backend 'llvm': {version}; {_REMEDY}, or use 'scalar'")
    return Variant(
        "scalar_spectral",
        version,
        f"LLVM would render long sequences several times as fast: {_REMEDY}",
    )


@cache
def llvm_in_use() -> tuple[str, str]:
    """Library that Dr.Jit has loaded, or will load, and its version, as from `find_llvm`.

    The first call chooses, unless Dr.Jit was imported before and has already chosen.
    """
    if "drjit" not in sys.modules:
        library, version = find_llvm()
        if library:
            os.environ["DRJIT_LIBLLVM_PATH"] = library
        return library, version
    from drjit.detail import llvm_version as bound_version

    bound = bound_version()
    if bound[0] in TRIED_LLVM:
        return "libLLVM of Dr.Jit's own choice", ".".join(map(str, bound))
    refusal = _refusal(bound) if bound[0] > 0 else "is none"
    remedy = "take Mitsuba from megalopta.render, as mi, before importing it"
    return "", f"the LLVM that Dr.Jit found {refusal}; {remedy}"


def find_llvm() -> tuple[str, str]:
    """Find a libLLVM for Dr.Jit: its path and version, or "" and the reason that there is none."""
    stated = os.environ.get("DRJIT_LIBLLVM_PATH")
    refusals = []
    for library in [Path(stated)] if stated else llvm_libraries():
        version = llvm_version(library)
        if version and version[0] in TRIED_LLVM:
            return str(library), ".".join(map(str, version))
        refusals.append(f"{library} {_refusal(version)}")
    if stated:
        return "", f"DRJIT_LIBLLVM_PATH: {refusals[0]}"
    return "", refusals[0] if refusals else "no libLLVM found"


def llvm_version(library: Path) -> tuple[int, int, int] | None:
    """Return the LLVM version that a library reports.

    None if it cannot be loaded, zeros if it reports none, as before LLVM 16.
    """
    numbers = tuple(ctypes.c_uint() for _ in range(3))
    try:
        ctypes.CDLL(str(library)).LLVMGetVersion(*map(ctypes.byref, numbers))
    except OSError:
        return None
    except AttributeError:
        return 0, 0, 0
    return numbers[0].value, numbers[1].value, numbers[2].value


def _refusal(version: tuple[int, int, int] | None) -> str:
    if version is None:
        return "cannot be loaded as a library"
    if version[0] < TRIED_LLVM[0]:
        return f"is LLVM {version[0] or 'before 16'}, which would abort the process"
    return f"is LLVM {version[0]}, which is untested"


def has_cuda_device() -> bool:
    """True if the CUDA driver reports a device and OptiX is installed with it."""
    names = {"linux": ("libcuda.so.1", "libnvoptix.so.1"), "win32": ("nvcuda.dll", "nvoptix.dll")}
    if sys.platform not in names:
        return False
    count = ctypes.c_int(0)
    try:
        cuda, _ = (ctypes.CDLL(name) for name in names[sys.platform])
        failed = cuda.cuInit(0) or cuda.cuDeviceGetCount(ctypes.byref(count))
    except (OSError, AttributeError):
        return False
    return not failed and count.value > 0


def llvm_libraries() -> Iterator[Path]:
    """Files that may be libLLVM, the most likely first: of the wheel, then of the system."""
    with suppress(PackageNotFoundError):
        for file in files(_LLVM_PACKAGE) or []:
            if re.fullmatch(r"libLLVM\.so\.[\d.]+", file.name):
                yield Path(str(file.locate())).resolve()
    name = re.compile(r"(lib)?LLVM(-C|-\d+)?\.(so|dylib|dll)[\d.]*")
    folders = [folder for pattern in _LIBRARY_FOLDERS for folder in Path("/").glob(pattern)]
    libraries = {path.resolve() for folder in folders for path in folder.glob("*LLVM*")}

    def newest_first(library: Path) -> tuple[int, str]:
        number = re.search(r"\d+", library.name) or re.search(r"(?<=llvm-)\d+", str(library))
        return -int(number.group()) if number else 0, str(library)

    yield from sorted((path for path in libraries if name.fullmatch(path.name)), key=newest_first)
