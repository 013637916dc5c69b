"""What is said of a release in more than one place is said alike."""

import re
from importlib.metadata import version

import yaml

import megalopta

from .pages import DOCS


def test_the_citation_names_the_newest_version_of_the_changelog():
    citation = yaml.safe_load((DOCS.parent / "CITATION.cff").read_text("utf-8"))
    changes = (DOCS.parent / "CHANGELOG.md").read_text("utf-8")
    assert str(citation["version"]) == re.search(r"^## ([\d.]+)", changes, re.MULTILINE)[1]


def test_the_program_has_the_version_of_its_installation():
    assert megalopta.__version__ == version("megalopta")
