"""What a result depends on beside its inputs."""

import sys

import pytest

from megalopta.core import freshness


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A package with a module in a sub-package; its hash is remembered in a process."""
    folder = tmp_path / "some_package" / "room"
    folder.mkdir(parents=True)
    (folder / "module.py").write_text("x = 1\n")
    for init in (folder, folder.parent):
        (init / "__init__.py").write_text("")
    monkeypatch.syspath_prepend(tmp_path)
    freshness.code_digest.cache_clear()
    yield folder
    freshness.code_digest.cache_clear()
    sys.modules.pop("some_package", None)


def test_code_in_the_rooms_of_a_package_counts(package):
    before = freshness.code_digest("some_package")
    (package / "module.py").write_text("x = 2\n")
    freshness.code_digest.cache_clear()
    assert freshness.code_digest("some_package") != before


def test_libraries_count(package, monkeypatch):
    before = freshness.code_digest("some_package")
    monkeypatch.setattr(freshness, "version", lambda library: f"{library} of tomorrow")
    freshness.code_digest.cache_clear()
    assert freshness.code_digest("some_package") != before


def test_borders_of_parts_count():
    assert freshness.digest("ab", "c") != freshness.digest("a", "bc")
