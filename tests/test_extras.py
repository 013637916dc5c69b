"""Sensors and flow without Mitsuba, Dask, LLVM and serial ports; what may be installed."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from packaging.requirements import Requirement

ROOT = Path(__file__).parents[1]
WITHOUT_EXTRAS = """
import sys

class Refused:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {"mitsuba", "drjit", "OpenEXR", "trimesh", "dask", "distributed", "serial", "cobs", "av", "ptufile", "daplis", "rerun"}:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Refused())
"""
USE = """
import numpy as np
import megalopta.flow as flow, megalopta.sensor as sensor

for library in (flow, sensor):
    for name in library.__all__:
        getattr(library, name)
radiance = np.full((3, 24, 24, 1), 1e-6) * (1 + np.random.default_rng(0).random((24, 24, 1)))
counts = sensor.expose(radiance, [(450, 650)], sensor.preset("spadcam"), seed=0, sequence="x").counts
print(counts.shape, flow.METHODS["BM"].name)
"""
COMMAND = """
from megalopta.cli.main import main
main(sys.argv[1:])
"""


def run(code, *words):
    command = [sys.executable, "-c", WITHOUT_EXTRAS + code, *words]
    return subprocess.run(command, capture_output=True, text=True)


def test_sensors_and_flow_need_no_extra():
    done = run(USE)
    assert (done.stdout, done.returncode) == ("(3, 24, 24) BM\n", 0), done.stderr


def test_a_cube_of_photons_is_seen_without_extras(tmp_path):
    np.save(tmp_path / "cube.npy", np.full((3, 16, 2), 0b01001001, np.uint8))
    done = run(COMMAND, "view", str(tmp_path / "cube.npy"), "--out", str(tmp_path / "out"))
    assert "no film.mp4: av is not installed; pip install 'megalopta[video]'" in done.stderr
    assert {each.name for each in (tmp_path / "out").iterdir()} == {"film.gif", "view.html"}


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("render", "grating", "--out", "data"), "trimesh is not installed; pip install 'megalopta[render]'"),
        (("spadcam", "list"), "serial is not installed; pip install 'megalopta[camera]'"),
    ],
)  # fmt: skip
def test_a_missing_extra_is_named(tmp_path, monkeypatch, words, said):
    monkeypatch.chdir(tmp_path)
    done = run(COMMAND, *words)
    assert done.stderr.splitlines()[-1] == f"megalopta: {said}"
    assert done.returncode == 2
    assert not list(tmp_path.iterdir())


def test_pictures_become_photons_flow_and_a_report_without_a_renderer(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    codes = np.random.default_rng(0).integers(0, 255, (4, 48, 64), np.uint8)
    np.save("clip.npy", codes)
    for words in (
        ("sense", "clip.npy", "--unit", "srgb", "--photons", "2"),
        ("flow", "out/clip", "--methods", "BM"),
        ("report", "out/clip"),
    ):
        done = run(COMMAND, *words)
        assert done.returncode == 0, done.stderr
    assert (tmp_path / "out/clip/report.html").exists()


def test_a_film_names_its_extra(tmp_path):
    (tmp_path / "clip.mp4").write_bytes(b"anything")
    done = run(COMMAND, "benchmark", "pairs", str(tmp_path / "clip.mp4"), "--no-truth")
    said = "megalopta: av is not installed; pip install 'megalopta[video]'"
    assert (done.stderr.splitlines()[-1], done.returncode) == (said, 2)


def test_time_tags_name_their_extra(tmp_path):
    (tmp_path / "dark.ptu").write_bytes(b"PQTTTR\0\0" + bytes(100))
    done = run(COMMAND, "spadcam", "tags", str(tmp_path / "dark.ptu"))
    said = "megalopta: ptufile is not installed; pip install 'megalopta[timetags]'"
    assert (done.stderr.splitlines()[-1], done.returncode) == (said, 2)


def test_linospad2_names_its_extra(tmp_path):
    np.zeros(2 + 65 * 512, "<u4").tofile(tmp_path / "dark.dat")
    done = run(COMMAND, "spadcam", "tags", str(tmp_path / "dark.dat"), "--linospad2", "2212b")
    said = "megalopta: daplis is not installed; pip install 'megalopta[linospad2]'"
    assert (done.stderr.splitlines()[-1], done.returncode) == (said, 2)


def test_all_has_every_extra_that_the_program_names():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"][
        "optional-dependencies"
    ]
    assert extras["all"] == ["megalopta[render,cluster,camera,video,timetags]"]


WITHOUT_HOLES = {
    "distributed": "2026.1",
    "filelock": "3.20.3",
    "jinja2": "3.1.6",
    "pillow": "11.3",
}
"""The oldest versions without known holes that matter here"""


def floors():
    """The packages that are needed, by name, those of `[all]` among them."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    extras = project["optional-dependencies"]
    named = ("render", "cluster", "camera", "video", "timetags")
    wanted = [*project["dependencies"], *(each for name in named for each in extras[name])]
    return {each.name: each.specifier for each in map(Requirement, wanted)}


def test_no_version_with_a_known_hole_may_be_installed():
    for name, oldest in WITHOUT_HOLES.items():
        assert f">={oldest}" in str(floors()[name]).split(",")


def test_the_versions_that_are_tried_are_allowed():
    lines = (ROOT / "constraints.txt").read_text("utf-8").splitlines()
    tried = {name.lower(): version for name, _, version in (each.partition("==") for each in lines)}
    for name, allowed in floors().items():
        found = tried.get(name.lower()) or tried[re.sub("[-_.]+", "-", name).lower()]
        assert found in allowed, name
