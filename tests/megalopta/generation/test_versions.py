"""What `megalopta info` says of the machine."""

from megalopta.generation import versions
from megalopta.render import choose_variant


def test_a_cuda_device_is_told_of_and_left_alone_by_auto(monkeypatch):
    monkeypatch.setattr(versions, "has_cuda_device", lambda: True)
    monkeypatch.setattr("megalopta.render.variant.has_cuda_device", lambda: True)
    assert "cuda" not in choose_variant("auto").name
    assert "auto leaves it alone" in versions.describe()
