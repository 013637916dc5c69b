"""What is loaded, and how long it takes, before anything is computed."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
RENDERER = {"mitsuba"}
FILES = {"zarr", "cv2", "matplotlib", "skimage", "trimesh", "rich", "pyarrow", "dask", "torch"}
MODELS = {"pydantic", "numpy", "scipy", "numba", "yaml", "drjit"}


def loaded(code):
    """Top-level modules that are loaded once some Python has run."""
    told = f"{code}\nimport sys; print(*{{name.partition('.')[0] for name in sys.modules}})"
    done = subprocess.run([sys.executable, "-c", told], capture_output=True, text=True, check=True)
    return set(done.stdout.splitlines()[-1].split())


@pytest.mark.parametrize(
    "words",
    [
        "--help",
        "--version",
        "frob",
        "render --ouut x",
        "dataset make --ouut x",
        "check --plot x",
        "report x --scene.trees 5",
    ],
)
def test_help_version_and_mistyped_words_load_nothing_heavy(words):
    run = f"""
from megalopta.cli import main as cli
try:
    cli.main({words.split()})
except SystemExit:
    pass
"""
    assert not loaded(run) & (RENDERER | FILES | MODELS)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("code", "absent"),
    [
        ("import megalopta.flow", RENDERER | FILES | MODELS),
        ("from megalopta.flow import METHODS, photon_search, truth_error", RENDERER | FILES),
        ("import megalopta.sensor", RENDERER | FILES | MODELS),
        ("from megalopta.sensor import PRESETS, expose", RENDERER | FILES),
        ("import megalopta.config", RENDERER | FILES | MODELS),
        ("from megalopta.config.model import load; load('demo')", RENDERER | FILES),
    ],
)
def test_a_room_loads_what_it_uses(code, absent):
    assert not loaded(code) & absent


@pytest.mark.parametrize("folder", ["assets_gen", "scenes", "render", "sensor", "flow"])
def test_the_libraries_are_importable_inside_a_clone(folder):
    # Without the editable install's finder, as where a wheel is installed.
    code = (
        "import sys; sys.meta_path = [each for each in sys.meta_path if 'ditable' not in repr(each)]; "
        f"import megalopta.{folder} as it; print(it.__file__)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == str(ROOT / folder / "__init__.py")
