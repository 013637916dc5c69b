"""What is installed by default, and what may be installed."""

import re
import tomllib
from pathlib import Path

from packaging.requirements import Requirement

ROOT = Path(__file__).parents[1]
WITHOUT_HOLES = {
    "distributed": "2026.1",
    "filelock": "3.20.3",
    "jinja2": "3.1.6",
    "pillow": "11.3",
}
"""The oldest versions without known holes that matter here"""


def floors():
    """The packages that are needed, by name, those of `[all]` among them."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    extras = project["optional-dependencies"]
    wanted = [*project["dependencies"], *extras["render"], *extras["cluster"], *extras["camera"]]
    return {each.name: each.specifier for each in map(Requirement, wanted)}


def test_no_version_with_a_known_hole_may_be_installed():
    for name, oldest in WITHOUT_HOLES.items():
        assert f">={oldest}" in str(floors()[name]).split(",")


def test_the_versions_that_are_tried_are_allowed():
    lines = (ROOT / "constraints.txt").read_text("utf-8").splitlines()
    tried = {name.lower(): version for name, _, version in (each.partition("==") for each in lines)}
    for name, allowed in floors().items():
        found = tried.get(name.lower()) or tried[re.sub("[-_.]+", "-", name).lower()]
        assert found in allowed, name
