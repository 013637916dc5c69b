"""What is said of a release in more than one place is said alike."""

import yaml

from megalopta import __version__

from .pages import DOCS


def test_the_citation_names_the_version_of_the_program():
    citation = yaml.safe_load((DOCS.parent / "CITATION.cff").read_text("utf-8"))
    assert str(citation["version"]) == __version__


def test_a_script_of_the_gallery_has_at_most_forty_lines():
    lengths = {p.name: len(p.read_text("utf-8").splitlines()) for p in DOCS.glob("gallery/*.py")}
    assert lengths
    assert max(lengths.values()) <= 40, lengths
