"""What the README and the overview print runs as printed."""

import re
import shlex
from argparse import Namespace
from pathlib import Path

import pytest

from megalopta.cli.main import program, split_overrides
from megalopta.config.model import load
from megalopta.config.recipe import load_plan

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
COMMANDS = sorted(
    {
        line
        for page in ("README.md", "docs/overview.md", "docs/results.md", "docs/datasets.md")
        for line in re.findall(
            r"^    megalopta (.+?)(?:  +\S.*)?$", (ROOT / page).read_text("utf-8"), re.MULTILINE
        )
    }
)
RENDERS = ("demo", "render", "sense")


def parsed(line):
    """Options and settings of a command line, as the program takes them apart."""
    words = shlex.split(line, comments=True)
    parser = command = program()
    for word in words:
        command = command.verbs.get(word, command)
    own, overrides = split_overrides(words, {*parser.options, *command.options}, command.takes)
    return parser.parse_args(own, Namespace(overrides=overrides))


@pytest.mark.slow
def test_the_python_example_runs_and_prints_a_photon_flux(capsys):
    page = (ROOT / "docs/how-to/python.md").read_text("utf-8")
    example = page[page.index("## From a scene to N_2b") :]
    exec(re.search(r"```python\n(.*?)```", example, re.DOTALL).group(1), {})
    assert re.fullmatch(r"[\d.]+[kM]? \[[\d.]+[kM]?, [\d.]+[kM]?\]\n", capsys.readouterr().out)


def test_the_pages_print_commands():
    assert len(COMMANDS) > 30


@pytest.mark.parametrize("line", COMMANDS)
def test_the_command_lines_are_accepted(line):
    parsed(line)  # refuses what it does not know


@pytest.mark.parametrize("line", [each for each in COMMANDS if each.split()[0] in RENDERS])
def test_the_settings_on_its_command_lines_are_accepted(line):
    load("demo", parsed(line).overrides)  # refuses what it does not know


def test_the_plan_that_it_prints_is_one(tmp_path):
    lines = re.search(r"    # plan.yaml\n((?:    .*\n)+)", README)[1]
    (tmp_path / "plan.yaml").write_text(lines.replace("\n    ", "\n").strip(), "utf-8")
    assert load_plan(tmp_path / "plan.yaml").sequences == 4


@pytest.mark.parametrize("name", re.findall(r"\]\(((?!http|#)[^)]+)\)", README))
def test_the_files_it_links_exist(name):
    assert (ROOT / name).exists()
