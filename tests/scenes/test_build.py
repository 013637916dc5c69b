"""Scenes of other packages, which are installed here by a folder of metadata alone."""

import json
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from ..installing import environment_with

PACKAGE = Path(__file__).parents[1] / "plugin_package"
TINY = """
scene: {kind: corridor, width_m: 2.5}
camera: {width: 20, height: 20}
trajectory: {frames: 4, velocity_m_s: [1, 0, 0]}
render: {samples_per_pixel: 4, backend: scalar}
sensors: [ideal]
light_levels: [twilight]
methods: [IIA]
benchmark: {sizes: [20], repeats: 2, fluxes_per_decade: 1}
"""


@pytest.fixture
def megalopta(tmp_path):
    """Runs the command line where the package is installed, with more entry points if asked."""
    offered = tomllib.loads((PACKAGE / "pyproject.toml").read_text())["project"]["entry-points"]

    def run(*arguments, more=""):
        entries = offered["megalopta.scenes"].items()
        lines = ["[megalopta.scenes]", *(f"{name} = {value}" for name, value in entries), more]
        environment = environment_with(PACKAGE, "\n".join(lines), tmp_path / "site")
        command = [sys.executable, "-m", "megalopta", *map(str, arguments)]
        return subprocess.run(
            command, capture_output=True, text=True, env=environment, cwd=tmp_path, timeout=300
        )

    return run


@pytest.mark.slow
def test_the_scene_of_another_package_is_rendered_and_reported(megalopta, tmp_path):
    (tmp_path / "tiny.yaml").write_text(TINY)
    ran = megalopta("demo", "tiny.yaml", "--out", "out", "--scene.reflectance", "0.6")
    assert ran.returncode == 0, ran.stderr
    record = json.loads(next((tmp_path / "out").rglob("scene.json")).read_text())
    assert record["kinds"] == ["wall"] and record["objects"] == 2
    page = next((tmp_path / "out").rglob("*.html")).read_text()
    assert "A corridor, 2.5 m wide." in page


BROKEN = {
    "gone = others_scenes.gone:Gone": "No module named 'others_scenes.gone'",
    "mine = pathlib:Path": "does not derive from megalopta.scenes.SceneDescription",
    "half = megalopta.scenes:SceneDescription": "needs the methods build and describe",
    "taken = megalopta.scenes:Forest": "the name 'forest' is taken",
}


@pytest.mark.slow
def test_broken_plug_ins_are_told_by_name_and_the_others_go_on(megalopta):
    settings = ("--scene.kind", "corridor", "--scene.width-m", "0")
    ran = megalopta("render", "demo", *settings, more="\n".join(BROKEN))
    lines = ran.stderr.splitlines()
    for entry, told in BROKEN.items():
        name = entry.partition(" ")[0]
        assert [told in line for line in lines if f"plug-in {name} " in line] == [True]
    assert "scene.width_m" in lines[-1] and "greater than 0.5" in lines[-1]
    assert len(lines) == len(BROKEN) + 1
