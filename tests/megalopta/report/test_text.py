"""Numbers as people write them."""

import math

import pytest

from megalopta.report.text import with_error


@pytest.mark.parametrize(
    ("value", "error", "unit", "text"),
    [
        (1.02e-6, 2.96e-9, "s", "1.0200 ± 0.0030 µs"),
        (9.996e-7, 2e-10, "s", "999.60 ± 0.20 ns"),
        (0.0, 3e-3, "Hz", "0.0000 ± 0.0030 Hz"),
        (1234.0, 150.0, "Hz", "1.23 ± 0.15 kHz"),
        (5.123, 0.04, "%", "5.123 ± 0.040 %"),
        (-0.25, 0.05, "V", "-250 ± 50 mV"),
        (0.01, math.nan, "V", "10.0 mV"),
    ],
)
def test_values_and_errors_share_unit_and_digits(value, error, unit, text):
    assert with_error(value, error, unit) == text
