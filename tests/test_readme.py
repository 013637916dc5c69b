"""What the README and other pages print runs as printed."""

import re
import shlex
import subprocess
import sys
from argparse import Namespace
from pathlib import Path

import cv2
import numpy as np
import pytest

from megalopta.cli.main import program, split_overrides
from megalopta.config.drawing import configuration_of
from megalopta.config.model import load
from megalopta.config.recipe import load_plan
from megalopta.flow.formats import write_flo

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
PAGES = ("explanation/overview", "how-to/datasets", "how-to/cameras", "how-to/whole-frames")
COMMANDS = sorted(
    {
        line
        for page in ("README.md", *(f"docs/{page}.md" for page in PAGES))
        for line in re.findall(
            r"^    megalopta (.+?)(?:  +\S.*)?$", (ROOT / page).read_text("utf-8"), re.MULTILINE
        )
    }
)
RENDERS = ("demo", "render", "sense")


def parsed(line):
    """Options and settings of a command line, as the program takes them apart."""
    words = [word for word in shlex.split(line, comments=True) if word != "&"]
    parser = command = program()
    for word in words:
        command = command.verbs.get(word, command)
    own, overrides = split_overrides(words, parser.named | command.named, command.takes)
    return parser.parse_args(own, Namespace(overrides=overrides))


def _make_files():
    """Make the user's own files that the README's commands name, in the working folder."""
    plan = re.search(r"    # plan.yaml\n((?:    .*\n)+)", README)[1]
    Path("plan.yaml").write_text(plan.replace("\n    ", "\n").strip(), "utf-8")
    leaves = np.random.default_rng(1).integers(0, 255, (24, 32, 3), np.uint8)
    wide = cv2.resize(leaves, (160, 96), interpolation=cv2.INTER_CUBIC)
    frames = [wide[:, shift : shift + 128] for shift in range(6)]
    film = cv2.VideoWriter("clip.mp4", cv2.VideoWriter.fourcc(*"mp4v"), 25, (128, 96))
    for frame in frames:
        film.write(frame)
    film.release()
    for name, frame in zip(("first.png", "second.png"), frames, strict=False):
        cv2.imwrite(name, frame)
    write_flo("flow.flo", np.broadcast_to(np.float32([-1, 0]), (96, 128, 2)))
    Path("device.yaml").write_text("preset: spadcam\nname: mine\n")


@pytest.mark.slow
def test_all_commands_of_the_readme_run_in_their_order(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    _make_files()
    lines = re.findall(r"^    (megalopta .*)$", README, re.MULTILINE)
    lines += re.findall(r"`(megalopta sense .*)`", README)
    lines = [line for line in lines if "pip install" not in line]
    assert len(lines) == 12
    copied = "mkdir -p flow && cp -r data/training/flow/. flow"
    script = ["set -e", "trap 'kill $(jobs -p)' EXIT"]
    for line in lines:
        script += [copied] * ("submit" in line) + [line]
    monkeypatch.setenv("PATH", str(Path(sys.executable).parent), prepend=":")
    done = subprocess.run(["bash", "-c", "\n".join(script)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
    for made in ("out/quick/report.html", "out/clip", "ranking/ranking.html", "comparison.html"):
        assert Path(made).exists(), made


@pytest.mark.slow
def test_the_python_example_runs_and_prints_a_photon_flux(capsys):
    page = (ROOT / "docs/how-to/python.md").read_text("utf-8")
    example = page[page.index("## From a scene to N_2b") :]
    exec(re.search(r"```python\n(.*?)```", example, re.DOTALL).group(1), {})
    assert re.fullmatch(r"[\d\u202f]+ \([\d\u202f]+ to [\d\u202f]+\)\n", capsys.readouterr().out)


@pytest.mark.parametrize("line", COMMANDS)
def test_the_command_lines_and_their_settings_are_accepted(line):
    overrides = parsed(line).overrides  # refuses what it does not know
    overrides.pop("repeats", None)  # of sense, which adds exposures to a dataset of many
    if line.split()[0] in RENDERS:
        load("demo", overrides)


def test_the_plan_that_it_prints_is_one(tmp_path):
    lines = re.search(r"    # plan.yaml\n((?:    .*\n)+)", README)[1]
    (tmp_path / "plan.yaml").write_text(lines.replace("\n    ", "\n").strip(), "utf-8")
    plan = load_plan(tmp_path / "plan.yaml")
    made = [configuration_of(plan, index).scene.kind for index in range(plan.sequences)]
    assert sorted(made) == ["forest", "forest", "grating", "grating"]
