"""Curves and numbers that readers can tell apart."""

import math

import pytest

from megalopta.flow.detectors.registry import METHODS
from megalopta.plotting.style import method_style, wrapped
from megalopta.plotting.text import number, percent, relative_error, short


def test_no_two_methods_look_alike():
    looks = [tuple(method_style(name).values()) for name in METHODS]
    assert len(set(looks)) == len(METHODS)


@pytest.mark.parametrize("characters", range(20, 60))
def test_no_number_is_parted_from_its_unit(characters):
    text = "It falls to 25 % within 3 frames of 240 × 240 px, C = 1, at 13.58 V and 0.1 Hz/µm²."
    ends = [line.split()[-1] for line in wrapped(text, characters)[:-1]]
    assert not [end for end in ends if end[-1].isdigit() or end in ("×", "=")]


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0, "0"),
        (0.000499, "0.0005"),
        (1.234e-7, "1.2 · 10⁻⁷"),
        (0.01433, "0.014"),
        (1e-5, "10⁻⁵"),
        (1, "1.00"),
        (2.738, "2.74"),
        (64.44, "64.4"),
        (306.2, "306"),
        (999.7, "1.00k"),
        (305_400, "305k"),
        (-2130, "-2.13k"),
        (-2.13, "-2.13"),
        (math.nan, "–"),
        (math.inf, "–"),
    ],
)
def test_numbers_have_three_digits_and_those_below_one_two(value, text):
    assert number(value) == text


@pytest.mark.parametrize(
    ("fraction", "text"),
    [
        (0, "0 %"),
        (1e-6, "< 0.01 %"),
        (0.00345, "0.34 %"),
        (0.0999, "10.0 %"),
        (0.1534, "15 %"),
        (1, "100 %"),
        (math.nan, "–"),
    ],
)
def test_percentages_are_zero_only_where_there_is_nothing(fraction, text):
    assert percent(fraction).replace("\u00a0", " ") == text


def test_errors_from_tenfold_on_fail():
    assert relative_error(9.42) == "942\u00a0%"
    assert relative_error(10.0) == "fails"
    assert relative_error(4080.5) == "fails"
    assert relative_error(None) == "–"


@pytest.mark.parametrize(
    ("value", "text"), [(1e3, "1k"), (1e7, "10M"), (0.01, "0.01"), (1.0, "1"), (100.0, "100")]
)
def test_round_numbers_have_no_spare_digits(value, text):
    assert short(value) == text
