import _ctypes
import os
import subprocess
import sys
from pathlib import Path

import pytest

from megalopta.render import variant
from megalopta.render.variant import MINIMUM_LLVM, choose_variant, llvm_version

RENDER = """
from megalopta.render.variant import choose_variant, activate
chosen = choose_variant()
activate(chosen)
import mitsuba as mi
scene = mi.load_dict({"type": "scene", "light": {"type": "constant"},
                      "sensor": {"type": "perspective", "film": {"type": "hdrfilm", "width": 8,
                                 "height": 8}}, "integrator": {"type": "path"}})
assert float(mi.render(scene, spp=1).array[0]) > 0
print(chosen.name)
"""


def render_in_a_process_of_its_own(library):
    done = subprocess.run(
        [sys.executable, "-c", RENDER],
        env={**os.environ, "DRJIT_LIBLLVM_PATH": str(library)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""  # Dr.Jit's own complaint is told better by the choice of variant
    return done.stdout.strip()


@pytest.fixture
def no_cache():
    variant.find_llvm.cache_clear()
    yield
    variant.find_llvm.cache_clear()


def libraries_older_than_minimum():
    found = list(variant._llvm_libraries())
    return [p for p in found if (llvm_version(p) or (0, 0, 0))[0] < MINIMUM_LLVM]


def test_a_file_that_is_no_library_leaves_the_process_alive(tmp_path):
    (tmp_path / "libLLVM.so").write_text("no library")
    assert render_in_a_process_of_its_own(tmp_path / "libLLVM.so") != "llvm_ad_spectral"


@pytest.mark.parametrize("library", libraries_older_than_minimum() or [Path("/nonexistent")])
def test_an_old_libllvm_is_never_handed_to_the_renderer(library):
    assert render_in_a_process_of_its_own(library) != "llvm_ad_spectral"


@pytest.mark.parametrize(
    ("version", "expected"),
    [
        ((22, 1, 0), "llvm_ad_spectral"),
        ((19, 0, 0), "llvm_ad_spectral"),
        ((18, 1, 0), "scalar_spectral"),
        ((16, 0, 0), "scalar_spectral"),
        (None, "scalar_spectral"),
    ],
)
def test_llvm_is_let_in_by_the_version_it_reports(monkeypatch, no_cache, version, expected):
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", "/somewhere/libLLVM.so")
    monkeypatch.setattr(variant, "llvm_version", lambda _: version)
    monkeypatch.setattr(variant, "has_cuda_device", lambda: False)
    assert choose_variant().name == expected


@pytest.mark.parametrize(
    ("version", "clause"),
    [
        (None, "cannot be loaded as a library"),
        ((0, 0, 0), "tells no LLVM version.* would abort the process"),
        ((16, 0, 6), "is LLVM 16, which would abort the process"),
        ((18, 1, 0), "is LLVM 18, which is untried"),
    ],
)
def test_a_refused_library_is_named_with_what_is_wrong(monkeypatch, no_cache, version, clause):
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", "/somewhere/libLLVM.so")
    monkeypatch.setattr(variant, "llvm_version", lambda _: version)
    with pytest.raises(ValueError, match=f"DRJIT_LIBLLVM_PATH: /somewhere/libLLVM.so {clause}"):
        choose_variant("llvm")


def test_a_file_that_is_no_library_has_no_version_and_another_library_tells_none(tmp_path):
    (tmp_path / "libLLVM.so").write_text("no library")
    assert llvm_version(tmp_path / "libLLVM.so") is None
    assert llvm_version(Path(_ctypes.__file__)) == (0, 0, 0)


def test_the_newest_library_is_asked_first():
    names = ["libLLVM-14.so.1", "libLLVM.so.22.1", "libLLVM-19.so", "libLLVM-9.so"]
    ordered = sorted((Path("/usr/lib") / name for name in names), key=variant._newest_first)
    assert [path.name for path in ordered] == [names[1], names[2], names[0], names[3]]


def test_cuda_comes_first_when_a_device_answers(monkeypatch):
    monkeypatch.setattr(variant, "has_cuda_device", lambda: True)
    assert choose_variant().name == "cuda_ad_spectral"


def test_a_named_backend_is_taken_or_refused(monkeypatch, no_cache):
    assert choose_variant("scalar").name == "scalar_spectral"
    monkeypatch.setattr(variant, "has_cuda_device", lambda: False)
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", "/nonexistent")
    with pytest.raises(ValueError, match="'cuda': no CUDA driver"):
        choose_variant("cuda")
    with pytest.raises(ValueError, match=f"'llvm'.*install LLVM {MINIMUM_LLVM}"):
        choose_variant("llvm")


def test_scalar_says_what_would_be_faster(monkeypatch, no_cache):
    monkeypatch.setattr(variant, "has_cuda_device", lambda: False)
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", "/nonexistent")
    assert "libllvm19" in choose_variant().advice
