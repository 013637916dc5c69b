"""Curves that readers can tell apart."""

from megalopta.flow.methods import METHODS
from megalopta.plot_style import method_style


def test_no_two_methods_look_alike():
    looks = [tuple(method_style(name).values()) for name in METHODS]
    assert len(set(looks)) == len(METHODS)
