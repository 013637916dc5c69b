"""Another package's detector and sensor, found by its entry points."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from megalopta.flow import METHODS

from .installing import environment_with

PACKAGE = Path(__file__).parent / "plugin_detector"
ENTRY_POINTS = """
[megalopta.detectors]
broken = whole_frame:BROKEN
center = whole_frame:CenterOfLight
missing = no_such_module:Detector

[megalopta.sensors]
theirs = whole_frame:SENSOR_FILE
twice = whole_frame:NAMESAKE
"""


@pytest.fixture(scope="module")
def with_plug_in(tmp_path_factory):
    """Run Python code in a process in which the package is installed."""
    environment = environment_with(PACKAGE, ENTRY_POINTS, tmp_path_factory.mktemp("site"))

    def run(code):
        command = [sys.executable, "-c", code]
        return subprocess.run(command, env=environment, capture_output=True, text=True, check=True)

    return run


@pytest.mark.slow
def test_a_detector_of_another_package_stands_after_ours_and_is_measured_by_name(with_plug_in):
    code = """
import json
from pathlib import Path
from megalopta.config.model import Configuration
from megalopta.benchmark.trial import Trial, measure_trial
from megalopta.flow import METHODS
trial = Trial(methods=["cl", "LK"], search={"flux_max": 1e6, "metrics": ["ratio"], "bits": [2]})
curves = measure_trial(trial, trial.template.pixels(), "test")
print(json.dumps([list(METHODS), trial.methods, Configuration(methods=["CL"]).methods,
    [each.method for each in curves]]))
"""
    done = with_plug_in(code)
    known, chosen, configured, measured = json.loads(done.stdout)
    assert known[0] == "BM"
    assert known[-1] == "CL"
    assert (chosen, configured, measured) == (["CL", "LK"], ["CL"], ["CL", "LK"])


@pytest.mark.slow
def test_a_broken_plug_in_is_told_in_one_sentence_and_breaks_nothing(with_plug_in):
    done = with_plug_in("import megalopta.flow as flow; print(len(flow.METHODS))")
    assert int(done.stdout) == len(METHODS) + 1  # the one that works
    told = [line for line in done.stderr.splitlines() if "megalopta.detectors" in line]
    assert len(told) == 2
    assert told[0].endswith("broken (whole_frame:BROKEN): 5 is not a Detector; give one")
    assert "missing (no_such_module:Detector): No module named" in told[1]


@pytest.mark.slow
def test_a_sensor_of_another_package_is_used_by_name_and_listed(with_plug_in):
    code = """
from megalopta.config.model import load
from megalopta.cli.settings import VerbSettings
demo = load("demo", {"sensors": "[theirs, {preset: theirs, name: dark, exposure_s: 0.02}]"})
print([(each.name, each.fill_factor, each.exposure_s) for each in demo.sensors])
print(", theirs." in " ".join(VerbSettings().help().split()))
try:
    load("demo", {"sensors": "[their]"})
except Exception as refusal:
    print(refusal)
"""
    done = with_plug_in(code)
    used, is_listed, refusal = done.stdout.splitlines()
    assert used == "[('theirs', 0.5, 0.1), ('dark', 0.5, 0.02)]"
    assert is_listed == "True"
    assert refusal.endswith("'their' is unknown; did you mean 'theirs'?")
    assert "twice (whole_frame:NAMESAKE): the name 'ideal' is taken" in done.stderr
