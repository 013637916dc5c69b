"""What `megalopta info` says of the machine."""

from importlib.metadata import PackageNotFoundError

from megalopta.stages import versions


def test_what_an_extra_would_install_is_said(monkeypatch):
    def version(package):
        if package == "mitsuba":
            raise PackageNotFoundError(package)
        return "1"

    monkeypatch.setattr(versions, "version", version)
    lines = versions.describe().splitlines()
    assert any(line.split() == ["mitsuba", "not", "installed"] for line in lines)
    assert lines[-1].endswith("pip install 'megalopta[render]'")
