"""Numbers as people write them."""

import math

import pytest

from megalopta.core.quantities import between, number, short, with_error


@pytest.mark.parametrize(
    ("value", "error", "unit", "text"),
    [
        (1.02e-6, 2.95e-9, "s", "1.020 ± 0.003 µs"),
        (9.996e-7, 2e-10, "s", "999.6 ± 0.2 ns"),
        (0.0, 3e-3, "Hz", "0 ± 3 mHz"),
        (1234.0, 150.0, "Hz", "1.23 ± 0.15 kHz"),
        (5.123, 0.04, "%", "5.12 ± 0.04 %"),
        (-0.25, 0.05, "V", "-250 ± 50 mV"),
        (0.96, 0.0097, "px", "0.960 ± 0.010 px"),
        (123456.0, 0.0, "counts", "123\u202f000 counts"),
        (123456.0, 19.9, "counts", "123\u202f460 ± 20 counts"),
        (2e-4, math.nan, "s", "200 µs"),
        (1e-22, 1.2e-21, "%", "(0.1 ± 1.2) · 10⁻²¹ %"),
        (-3.0e-5, 0.0, "%", "-3 · 10⁻⁵ %"),
    ],
)
def test_values_and_errors_share_unit_and_digits(value, error, unit, text):
    assert with_error(value, error, unit) == text


@pytest.mark.parametrize(
    ("value", "text", "shortened"),
    [
        (None, "–", None),
        (0.0, "0", "0"),
        (1e-5, "1.00 · 10⁻⁵", "10⁻⁵"),
        (0.000314, "0.000314", "0.000314"),
        (9.996, "10.0", "10"),
        (1020, "1020", "1020"),
        (99999, "100\u202f000", "100\u202f000"),
        (-12345, "-12\u202f300", "-12\u202f300"),
        (999_600, "1.00 million", "1 million"),
        (1.5e9, "1.50 billion", "1.5 billion"),
        (5e12, "5.00 · 10¹²", "5 · 10¹²"),
    ],
)
def test_numbers_have_three_digits_and_words_for_what_is_large(value, text, shortened):
    assert number(value) == text
    assert value is None or short(value) == shortened


def test_ends_of_a_range_share_a_unit():
    assert between(2.55e-7, 6.826e-6, "s") == "0.255 to 6.83 µs"
    assert between(16.0, 24.0, "%") == "16.0 to 24.0 %"
    assert between(59_601.0, 59_604.0, "Hz") == "59.6 kHz"
