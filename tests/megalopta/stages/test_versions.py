"""What `megalopta info` says of the machine."""

from importlib.metadata import PackageNotFoundError

from megalopta.render import choose_variant
from megalopta.stages import versions


def test_a_cuda_device_is_told_of_and_left_alone_by_auto(monkeypatch):
    monkeypatch.setattr(versions, "has_cuda_device", lambda: True)
    monkeypatch.setattr("megalopta.render.variant.has_cuda_device", lambda: True)
    assert "cuda" not in choose_variant("auto").name
    assert "auto stays with llvm" in versions.describe()


def test_what_an_extra_would_install_is_said(monkeypatch):
    def version(package):
        if package == "mitsuba":
            raise PackageNotFoundError(package)
        return "1"

    monkeypatch.setattr(versions, "version", version)
    lines = versions.describe().splitlines()
    assert any(line.split() == ["mitsuba", "not", "installed"] for line in lines)
    assert lines[-1].endswith("pip install 'megalopta[render]'")
