import os
import re
import shutil
from pathlib import Path

import pytest
from filelock import FileLock

from megalopta.cli import main as cli
from megalopta.config.model import load
from megalopta.config.recipe import Plan
from megalopta.generation.making import make
from megalopta.stages.pipeline import run_all

TINY = {
    "camera.width": "48",
    "camera.height": "40",
    "trajectory.frames": "24",
    "render.samples_per_pixel": "1",
    "render.bands_nm": "[[450, 550], [550, 650]]",
    "benchmark.sizes": "[40]",
    "benchmark.flux_min": "1e4",
    "benchmark.flux_max": "1e8",
    "benchmark.fluxes_per_decade": "1",
    "benchmark.repeats": "2",
}


@pytest.fixture(scope="session")
def tiny():
    """A grating sequence that takes a second to render."""
    return load("grating", TINY)


@pytest.fixture(scope="session")
def whole(tmp_path_factory):
    """Folder of a dataset with every stage done, a grating of four frames; not to be changed."""
    settings = {
        **TINY,
        **{"camera.width": "32", "camera.height": "24", "benchmark.sizes": "[24]"},
        **{"trajectory.frames": "4", "scene.cycles_per_frame": "4", "methods": "[BM, LK]"},
        **{"sensors": "[spadcam]", "light_levels": "[starlight]"},
    }
    return run_all(tmp_path_factory.mktemp("whole") / "data", load("grating", settings)).root


@pytest.fixture
def whole_copy(whole, tmp_path):
    """A copy of it, to be changed."""
    return Path(shutil.copytree(whole, tmp_path / "data"))


@pytest.fixture
def refused(capsys):
    """Runs a command that is refused with code 2, and returns what it says."""

    def refused(*words):
        capsys.readouterr()
        with pytest.raises(SystemExit) as stopped:
            cli.main([*map(str, words)])
        assert stopped.value.code == 2
        return capsys.readouterr().err

    return refused


@pytest.fixture(scope="session")
def check_words():
    """Refuses a figure without the dissertation's number, or with a caption of over 3 sentences."""

    def check(figure):
        number = re.fullmatch(r"(fig|table)-(\d+\.\d+)", figure.name)
        if number:
            kind = {"fig": "Figure", "table": "Table"}[number[1]]
            assert figure.title.startswith(f"{kind} {number[2]}: ")
        sentences = re.findall(r"(?<!Eq)[.?!](?= [A-Z(]|$)", figure.caption)
        assert 1 <= len(sentences) <= 3

    return check


SMALL = {
    "camera": {"width": 32, "height": 24},
    "render": {
        "samples_per_pixel": 1,
        "max_depth": 2,
        "bands_nm": [[700, 800], [800, 900]],
        "integrator": "path",
    },
}


@pytest.fixture(scope="session")
def small_plan():
    """Boards and gratings that take a second each."""
    return Plan(
        sequences=3,
        seed=3,
        scenes=(
            {"preset": "grating", "trajectory": {"rotation_deg_s": {"uniform": [5, 20]}}},
            {
                "preset": "grating",
                "scene": {"kind": "plane"},
                "trajectory": {"kind": "hover", "look_at_m": [1, 0, 1.5]},
            },
        ),
        lights=("daylight", "twilight"),
        every={**SMALL, "trajectory": {"frames": 3}},
        sensors=("spadcam", "ctia_si"),
        light_levels=({"log_uniform": [0.1, 10]},),
        flow_files=("kitti_png", "flo5"),
    )


def made_once(name, plan, tmp_path_factory):
    folder = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent
    with FileLock(folder / f"{name}.lock"):
        if not (folder / name).exists():
            make(folder / name, plan)
    return folder / name


@pytest.fixture(scope="session")
def small_dataset(small_plan, tmp_path_factory):
    """Folder of the small plan's dataset, made once for all processes; not to be changed."""
    return made_once("small", small_plan, tmp_path_factory)


@pytest.fixture(scope="session")
def single_plan(small_plan):
    """One grating of two frames, one exposure."""
    small = {"camera": {"width": 16, "height": 12}, "trajectory": {"frames": 2}}
    changes = {
        "sequences": 1,
        "scenes": small_plan.scenes[:1],
        "lights": (),
        "every": {**small_plan.every, **small},
        "sensors": ("spadcam",),
        "light_levels": ("twilight",),
    }
    return small_plan.model_copy(update=changes)


@pytest.fixture(scope="session")
def single_dataset(single_plan, tmp_path_factory):
    """Folder of the plan of one sequence, made once for all processes; not to be changed."""
    return made_once("single", single_plan, tmp_path_factory)
