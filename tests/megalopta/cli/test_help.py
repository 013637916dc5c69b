"""What the help states is what applies, and it comes at once."""

import json
import re
import subprocess
import sys

import pytest
import yaml

from megalopta.benchmark.design import DesignSettings
from megalopta.benchmark.ranking import RankingSettings
from megalopta.cli.command import VERBS
from megalopta.cli.describing import described
from megalopta.cli.main import main, program
from megalopta.cli.settings import FILE
from megalopta.config.model import load
from megalopta.config.recipe import Plan

MOST_CPU_S = 0.4
"""Processor time of a help; on the machine of the tests it takes half of that"""
program()  # declares the verbs
WITH_SETTINGS = [name for name, verb in VERBS.items() if verb.run and verb.settings]


def run_cpu_s(words):
    """Processor time of a command that prints help or refuses, and what it printed."""
    code = (
        "import resource, subprocess, sys\n"
        "done = subprocess.run(sys.argv[1:], capture_output=True, text=True)\n"
        "used = resource.getrusage(resource.RUSAGE_CHILDREN)\n"
        "print(used.ru_utime + used.ru_stime, done.stdout + done.stderr)"
    )
    command = [sys.executable, "-c", code, sys.executable, "-m", "megalopta", *words]
    found = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    seconds, _, told = found.partition(" ")
    return float(seconds), told


@pytest.fixture
def helped(capsys):
    """A function that returns the help for words of a command line."""

    def text(*words):
        with pytest.raises(SystemExit) as ended:
            main([*map(str, words)])
        assert ended.value.code == 0
        return capsys.readouterr().out

    return text


def stated(text):
    """Settings and values that a help states."""
    _, _, listed = text.partition("\nsettings (")
    pairs = re.findall(r"^  --(\S+) (.*)$", listed, re.MULTILINE)
    return {path.replace("-", "_"): value for path, value in pairs}


def at(values, path):
    """Value at the path of a setting; `...` if a file omits it, as it has its default."""
    for step in path.split("."):
        if values in (None, ...):
            return ...
        values = values[int(step)] if isinstance(values, list) else values.get(step, ...)
    return values


def agrees(shown, value):
    """Whether the help shows a value: in full, cut, or, for a list of models, their names."""
    if isinstance(value, list) and value and isinstance(value[0], dict):
        value = [each.get("name", each.get("kind", each)) for each in value]
    if value is ... or shown.endswith("[...]"):
        return True
    return yaml.safe_load(shown) == value or str(value) == shown


@pytest.mark.parametrize(
    ("verb", "model"),
    [
        ("render", lambda: load("demo")),
        ("demo", lambda: load("demo")),
        ("dataset make", Plan),
        ("benchmark sequence", RankingSettings),
        ("design", DesignSettings),
    ],
)
def test_the_help_states_the_values_that_apply(helped, verb, model):
    shown, values = stated(helped(*verb.split(), "--help-all")), model().model_dump(mode="json")
    assert shown
    for path, text in shown.items():
        assert text.startswith("(") or agrees(text, at(values, path)), path


def test_the_help_of_sense_states_the_sensor_for_pictures(helped):
    assert stated(helped("sense", "--help"))["sensors"] == "[ideal]"


def test_the_description_of_the_settings_is_that_of_the_models():
    found = json.loads(json.dumps(described()))
    assert found == json.loads(FILE.read_text("utf-8")), "run python -m megalopta.cli.describing"


@pytest.mark.parametrize(
    ("words", "told"),
    [
        *(pytest.param(f"{name} {how}", "usage: ", id=f"{name} {how}")
          for name in WITH_SETTINGS for how in ("--help", "--help-all")),
        ("render --scene.tres 300", "scene.tres: unknown key; did you mean 'trees'?"),
        ("render --scne.trees=300", "scne: unknown key; did you mean 'scene'?"),
        ("sense x --sensors.0.dead-tim 3", "sensors.0.dead_tim: unknown key; did you mean"),
        ("dataset make x --sequence 3", "sequence: unknown key; did you mean 'sequences'?"),
        ("design ideal --errr 3", "errr: unknown key; did you mean 'error'?"),
        ("benchmark photons x --trial.sze 3", "trial.sze: unknown key; did you mean 'size'?"),
    ],
)  # fmt: skip
def test_help_and_refused_typos_come_at_once(words, told):
    seconds, text = run_cpu_s(words.split())
    assert told in text
    assert seconds < MOST_CPU_S or run_cpu_s(words.split())[0] < MOST_CPU_S


@pytest.mark.parametrize("words", ["", "dataset", "benchmark", "spadcam", "scene"])
def test_a_verb_alone_prints_its_help(helped, words):
    assert helped(*words.split()) == helped(*words.split(), "--help")
