"""A folder from somebody else: nothing in it is run unless that is asked for."""

import subprocess
import sys
from pathlib import Path

import pytest

NAMES = ("argparse", "evil", "numba", "numpy", "psutil", "pydantic", "random", "scipy", "yaml")
SWEEP = """
trial: {methods: [evil:flow], size: 20}
values: [5]
"""


@pytest.fixture
def hostile(tmp_path):
    """A folder whose modules tell that they were run, and a sweep that names one."""
    for name in NAMES:
        text = f"open({str(tmp_path / 'canary')!r}, 'a').write({name!r})\nflow = lambda a, b: a.x"
        (tmp_path / f"{name}.py").write_text(text)
    (tmp_path / "sweep.yaml").write_text(SWEEP)
    return tmp_path


@pytest.mark.slow
@pytest.mark.parametrize(
    "command", [[sys.executable, "-m", "megalopta"], [Path(sys.executable).parent / "megalopta"]]
)
def test_no_module_of_the_working_folder_is_run(hostile, command):
    words = [*command, "benchmark", "photons", "sweep.yaml"]
    done = subprocess.run(words, cwd=hostile, capture_output=True, text=True)
    assert done.returncode == 2
    told = done.stderr.splitlines()[-1]
    assert told.startswith("megalopta: sweep.yaml: trial.methods: method 'evil:flow' is unknown")
    assert told.endswith("or run code that a file names by --allow-code")
    assert not (hostile / "canary").exists()


@pytest.mark.slow
def test_allowed_code_is_run_and_takes_no_other_module_s_place(hostile):
    words = [sys.executable, "-m", "megalopta", "benchmark", "photons", "sweep.yaml"]
    done = subprocess.run([*words, "--allow-code"], cwd=hostile, capture_output=True, text=True)
    assert (hostile / "canary").read_text() == "evil"
    told = done.stderr.splitlines()[-1]
    assert told.startswith("megalopta: method evil:flow: AttributeError: ")
    assert "evil.py:2; give a function of two frames" in told
