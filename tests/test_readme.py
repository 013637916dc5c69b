"""What the README prints runs as printed."""

import re
import shlex
from pathlib import Path

import pytest

from megalopta.cli.parser import split_overrides
from megalopta.config.model import Configuration, load
from megalopta.config.settings import Settings

README = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")


@pytest.mark.slow
def test_the_python_example_runs_and_prints_a_photon_flux(capsys):
    exec(re.search(r"```python\n(.*?)```", README, re.DOTALL).group(1), {})
    assert re.fullmatch(r"[\d.]+[kM]? \[[\d.]+[kM]?, [\d.]+[kM]?\]\n", capsys.readouterr().out)


@pytest.mark.parametrize(
    "line", re.findall(r"^    megalopta ((?:demo|render|sense) [^#\n]*)", README, re.MULTILINE)
)
def test_the_settings_on_its_command_lines_are_accepted(line):
    takes = Settings(Configuration).takes
    own, overrides = split_overrides(shlex.split(line), ("--out", "--redo", "--quick"), takes)
    assert own[0] in ("demo", "render", "sense")
    load("demo", overrides)  # refuses what it does not know


@pytest.mark.parametrize("name", re.findall(r"\]\(((?!http|#)[^)]+)\)", README))
def test_the_files_it_links_exist(name):
    assert (Path(__file__).parents[1] / name).exists()
