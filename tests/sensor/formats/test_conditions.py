"""Exposure and light in names and headers."""

import pytest

from megalopta.sensor.formats.conditions import conditions_in


@pytest.mark.parametrize(
    ("name", "exposure_s", "light"),
    [
        ("dark_10ms", 1e-2, 0),
        ("flat-2e7-100us", 1e-4, 2e7),
        ("exp=1e-5_light=2e7", 1e-5, 2e7),
        ("bright_10µs", 1e-5, None),
        ("50.0us", 5e-5, None),
        ("t20us_1.5e6", 2e-5, 1.5e6),
        ("exp10ms", 1e-2, None),
        ("0111-dark-100khz-1", None, 0),
        ("SPAD_0.1us_1726830927.999999046_1.bin", 1e-7, None),
        ("240613_QD-10MHz-3f-4g-10000us-5ns-150uW.tif", None, None),
        ("SPAD512S", None, None),
        ("2021_12_30_9_26_53.75", None, None),
        ("darkroom", None, None),
        ("flat_0.000.png", None, None),
    ],
)
def test_names(name, exposure_s, light):
    conditions = conditions_in(name, is_name=True)
    assert conditions.get("exposure_s") == (exposure_s and pytest.approx(exposure_s))
    assert conditions.get("light") == light


@pytest.mark.parametrize(
    ("header", "exposure_s", "light"),
    [
        ('{"shape": [3, 20, 30], "exposure_s": 1e-05}', 1e-5, None),
        ("Integration time: 10 ms\nGate width: 5 ns", 1e-2, None),
        ("exposure: 0.01\nlight=2e7", 0.01, 2e7),
        ("ImageJ=1.11a\nimages=7", None, None),
        ("recorded in 10 ms", None, None),
    ],
)
def test_headers(header, exposure_s, light):
    stated = {"exposure_s": exposure_s, "light": light}
    stated = {name: pytest.approx(value) for name, value in stated.items() if value is not None}
    assert conditions_in(header) == stated
