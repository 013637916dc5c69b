import os
import shutil
from pathlib import Path

import pytest
from filelock import FileLock

from megalopta.cli import main as cli
from megalopta.config.model import load
from megalopta.config.recipe import Plan
from megalopta.stages.make import make
from megalopta.stages.run import run_all

from .small import TINY, copied, small


@pytest.fixture(scope="session")
def tiny():
    """A grating sequence that takes a second to render."""
    return load("grating", TINY)


@pytest.fixture(scope="session")
def whole(tmp_path_factory):
    """Folder of a dataset with every stage done, a grating of four frames; not to be changed."""
    settings = TINY | small(32, 24, 4, sensors="spadcam", levels="starlight")
    settings |= {"benchmark.sizes": "[24]", "scene.cycles_per_frame": "4", "methods": "[BM, LK]"}
    return run_all(tmp_path_factory.mktemp("whole") / "data", load("grating", settings)).root


@pytest.fixture
def whole_copy(whole, tmp_path):
    """A copy of it, to be changed."""
    return Path(shutil.copytree(whole, tmp_path / "data"))


@pytest.fixture
def refused(capsys):
    """Runs a command that is refused with code 2 and prints nothing; returns what it says."""

    def refused(*words):
        capsys.readouterr()
        with pytest.raises(SystemExit) as stopped:
            cli.main([*map(str, words)])
        assert stopped.value.code == 2
        printed, said = capsys.readouterr()
        assert printed == ""
        return said

    return refused


BANDS = {"bands_nm": [[700, 800], [800, 900]]}
SMALL = {
    "camera": {"width": 32, "height": 24},
    "render": {"samples_per_pixel": 1, "max_depth": 2, "integrator": "path", **BANDS},
}


@pytest.fixture(scope="session")
def small_plan():
    """Boards and gratings that take a second each."""
    hover = {"kind": "hover", "look_at_m": [1, 0, 1.5]}
    return Plan(
        sequences=3,
        seed=3,
        scenes=(
            {"preset": "grating", "trajectory": {"rotation_deg_s": {"uniform": [5, 20]}}},
            {"preset": "grating", "scene": {"kind": "plane"}, "trajectory": hover},
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


@pytest.fixture
def single_copy(single_dataset, tmp_path):
    return copied(single_dataset, tmp_path / "data")


@pytest.fixture
def small_copy(small_dataset, tmp_path):
    return copied(small_dataset, tmp_path / "data")


@pytest.fixture
def run():
    """Runs a command and returns its exit code."""

    def run(words):
        try:
            cli.main(words)
        except SystemExit as stopped:
            return stopped.code or 0
        return 0

    return run
