"""Sensors and flow without Mitsuba, Dask, LLVM and serial ports; what may be installed."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet

from megalopta.core import strict_yaml

ROOT = Path(__file__).parents[1]
WITHOUT_EXTRAS = """
import sys

class Refused:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {"mitsuba", "drjit", "OpenEXR", "trimesh", "dask", "distributed", "serial", "cobs", "av", "ptufile", "rerun", "DracoPy", "meshopt", "opengl_basisu"}:
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
counts = sensor.expose(radiance, [(450, 650)], sensor.preset("spadcam"), seed=0, stream="x").counts
print(counts.shape, flow.METHODS["BM"].name)
"""
COMMANDS = """
from megalopta.cli.main import main
for line in sys.stdin:
    try:
        main(line.split())
        print(0)
    except SystemExit as ended:
        print(ended.code)
"""


def run(code, *lines):
    command = [sys.executable, "-c", WITHOUT_EXTRAS + code]
    return subprocess.run(command, input="\n".join(lines), capture_output=True, text=True)


def test_sensors_and_flow_need_no_extra():
    done = run(USE)
    assert (done.stdout, done.returncode) == ("(3, 24, 24) BM\n", 0), done.stderr


def test_photons_and_pictures_are_seen_and_measured_without_extras(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    np.save("cube.binary.npy", np.full((3, 16, 2), 0b01001001, np.uint8))
    np.save("clip.npy", np.random.default_rng(0).integers(0, 255, (4, 48, 64), np.uint8))
    sensed = "sense clip.npy --unit srgb --photons 2"
    flow, report = "flow out/clip --methods BM", "report out/clip"
    done = run(COMMANDS, "view cube.binary.npy --out seen", sensed, flow, report)
    assert re.findall(r"^\d$", done.stdout, re.MULTILINE) == ["0"] * 4, done.stderr
    assert "no film.mp4: av is not installed; pip install 'megalopta[video]'" in done.stderr
    assert {each.name for each in (tmp_path / "seen").iterdir()} == {"film.gif", "view.html"}
    assert (tmp_path / "out/clip/report.html").exists()


MISSING = {
    "render grating --out data": "trimesh is not installed; pip install 'megalopta[render]'",
    "spadcam list": "serial is not installed; pip install 'megalopta[camera]'",
    "benchmark pairs clip.mp4 --no-truth": "av is not installed; pip install 'megalopta[video]'",
    "spadcam tags dark.ptu": "ptufile is not installed; pip install 'megalopta[timetags]'",
}


def test_missing_extras_are_named(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "clip.mp4").write_bytes(b"anything")
    (tmp_path / "dark.ptu").write_bytes(b"PQTTTR\0\0" + bytes(100))
    done = run(COMMANDS, *MISSING)
    refusals = [line for line in done.stderr.splitlines() if line.startswith("megalopta: ")]
    assert refusals == [f"megalopta: {each}" for each in MISSING.values()]
    assert done.stdout.split() == ["2"] * 4
    assert {each.name for each in tmp_path.iterdir()} == {"clip.mp4", "dark.ptu"}


def test_all_has_every_extra_that_the_program_names():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"][
        "optional-dependencies"
    ]
    assert extras["all"] == ["megalopta[render,cluster,camera,video,timetags,gltf]"]


WITHOUT_HOLES = {
    "dask": "2026.1.1",
    "distributed": "2026.1.1",
    "filelock": "3.20.3",
    "h5py": "3.16",
    "jinja2": "3.1.6",
    "numcodecs": "0.16.6",
    "OpenEXR": "3.5.3",
    "pillow": "12.3",
    "pyarrow": "23.0.1",
    "zarr": "3.1.3",
}
"""The oldest versions without known holes that matter here"""


def floors():
    """The packages that are needed, by name, those of `[all]` among them."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    extras = project["optional-dependencies"]
    named = ("render", "cluster", "camera", "video", "timetags", "gltf")
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


def test_citation_changelog_and_conda_have_the_version_and_the_requirements():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    assert f"\nversion: {project['version']}\n" in (ROOT / "CITATION.cff").read_text("utf-8")
    assert f"\n## [{project['version']}]" in (ROOT / "CHANGELOG.md").read_text("utf-8")
    recipe = strict_yaml.load((ROOT / ".conda/recipe.yaml").read_text("utf-8"))
    assert recipe["package"] == {"name": project["name"], "version": project["version"]}
    of_conda = {"matplotlib": "matplotlib-base", "opencv-contrib-python-headless": "py-opencv"}
    wanted = {
        (of_conda.get(r.name, r.name), r.specifier)
        for r in map(Requirement, project["dependencies"])
    }
    run = {(r.name, r.specifier) for r in map(Requirement, recipe["requirements"]["run"])}
    assert run == wanted | {("python", SpecifierSet(project["requires-python"]))}
