"""Curves that readers can tell apart."""

import pytest

from megalopta.flow.detectors.registry import METHODS
from megalopta.plotting.style import method_style, wrapped


def test_no_two_methods_look_alike():
    looks = [tuple(method_style(name).values()) for name in METHODS]
    assert len(set(looks)) == len(METHODS)


@pytest.mark.parametrize("characters", range(20, 60))
def test_no_number_is_parted_from_its_unit(characters):
    text = "It falls to 25 % within 3 frames of 240 × 240 px, C = 1, at 13.58 V and 0.1 Hz/µm²."
    ends = [line.split()[-1] for line in wrapped(text, characters)[:-1]]
    assert not [end for end in ends if end[-1].isdigit() or end in ("×", "=")]
