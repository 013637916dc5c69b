import os
import platform
import subprocess
import sys
from pathlib import Path

import pytest

from megalopta.render import choose_variant, variant
from megalopta.render.variant import TRIED_LLVM, find_llvm, llvm_version
from megalopta.stages import versions

RENDER = """
from pathlib import Path
from megalopta.render.variant import choose_variant
from megalopta.render.mitsuba_loader import activate
chosen = choose_variant()
activate(chosen)
import mitsuba as mi
scene = mi.load_dict({"type": "scene", "light": {"type": "constant"},
                      "sensor": {"type": "perspective", "film": {"type": "hdrfilm", "width": 8,
                                 "height": 8}}, "integrator": {"type": "path"}})
assert float(mi.render(scene, spp=1).array[0]) > 0
print(chosen.name)
maps = Path("/proc/self/maps")
if maps.exists():
    print(*{line.split()[-1] for line in maps.read_text().splitlines() if "libLLVM" in line})
"""


def render_in_a_process_of_its_own(library=None, before=""):
    """Name of the variant, and the libraries of LLVM in the process, one line each."""
    environment = {name: each for name, each in os.environ.items() if name != "DRJIT_LIBLLVM_PATH"}
    if library:
        environment["DRJIT_LIBLLVM_PATH"] = str(library)
    done = subprocess.run(
        [sys.executable, "-c", before + RENDER],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    if not before:
        assert done.stderr == ""  # Dr.Jit's own complaint is told better by the choice of variant
    return done.stdout.strip()


@pytest.fixture
def unbound(monkeypatch):
    """As if Dr.Jit were not imported yet: a library is searched."""
    for module in (variant, versions):
        monkeypatch.setattr(module, "llvm_in_use", find_llvm)


def libraries_never_tried():
    found = list(variant.llvm_libraries())
    return [path for path in found if (llvm_version(path) or (0, 0, 0))[0] not in TRIED_LLVM]


@pytest.mark.parametrize("library", libraries_never_tried() or [Path("/nonexistent")])
@pytest.mark.parametrize("before", ["", "import drjit"], ids=["first", "after Dr.Jit"])
def test_an_untried_libllvm_is_never_used_by_the_renderer(library, before):
    assert render_in_a_process_of_its_own(library, before).startswith("scalar")


@pytest.mark.parametrize(
    ("version", "expected"),
    [
        ((TRIED_LLVM[-1] + 1, 0, 0), "scalar_spectral"),
        ((22, 1, 0), "llvm_ad_spectral"),
        ((19, 0, 0), "llvm_ad_spectral"),
        ((17, 0, 6), "llvm_ad_spectral"),
        ((16, 0, 0), "scalar_spectral"),
        (None, "scalar_spectral"),
    ],
)
def test_llvm_is_let_in_by_the_version_it_reports(monkeypatch, unbound, version, expected):
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", "/somewhere/libLLVM.so")
    monkeypatch.setattr(variant, "llvm_version", lambda _: version)
    monkeypatch.setattr(variant, "has_cuda_device", lambda: False)
    assert choose_variant().name == expected


@pytest.mark.skipif(
    (sys.platform, platform.machine()) != ("linux", "x86_64"), reason="the package is for Linux"
)
def test_the_package_that_is_installed_with_ours_renders_without_any_other_library(unbound):
    library = next(variant.llvm_libraries())
    name, bound = render_in_a_process_of_its_own().splitlines()
    assert name == "llvm_ad_spectral"
    assert Path(bound) == library


def test_a_named_backend_is_taken_or_refused(monkeypatch, unbound):
    assert choose_variant("scalar").name == "scalar_spectral"
    monkeypatch.setattr(variant, "has_cuda_device", lambda: False)
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", "/nonexistent")
    with pytest.raises(ValueError, match="'cuda': no CUDA driver"):
        choose_variant("cuda")
    with pytest.raises(ValueError, match=f"'llvm'.*install LLVM {TRIED_LLVM[0]}"):
        choose_variant("llvm")
