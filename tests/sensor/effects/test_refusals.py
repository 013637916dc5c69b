"""Values that no effect can have, refused with the field or what is missing."""

import pytest

from megalopta.sensor import (
    Afterpulsing,
    AnalogCounter,
    Bias,
    ColorFilters,
    Crosstalk,
    DarkCounts,
    Gate,
    Telegraph,
)

RED = {"wavelengths_nm": (300, 1100), "values": (0.0, 0.8)}


@pytest.mark.parametrize(
    ("effect", "fields", "message"),
    [
        (Afterpulsing, {"table_delays_s": (0, 1)}, "for each a fraction"),
        (Afterpulsing, {"table_delays_s": (0, 1), "table_cumulative": (0, 0.9)}, "from 0 to 1"),
        (Afterpulsing, {"table_delays_s": (1, 0), "table_cumulative": (0, 1)}, "increasing delays"),
        (AnalogCounter, {"step_v": 4.0}, "a step must fit into the swing"),
        (AnalogCounter, {"step_v": 0.01, "swing_v": 3.4}, "the swing into the supply"),
        (AnalogCounter, {"step_v": 0.01, "step_sigma_v": 0.0012}, "step_sigma_v"),
        (AnalogCounter, {"step_v": 1e-6}, r"step_v: 1e-06 makes \d+ counts"),
        (Bias, {"onset_v": 2.0}, r"bias\.onset_v: 2 is not below"),
        (Bias, {"excess_v": 3.0}, "nothing depends on bias; give efficiency_scale_v"),
        (ColorFilters, {"mosaic": ("RG", "G")}, "differ in length; fill them up"),
        (ColorFilters, {"mosaic": ("RG", "GB"), "red": RED}, "green: G has no curve"),
        (ColorFilters, {"mosaic": ("W",), "red": RED}, "red: R is in no row of the mosaic"),
        (Crosstalk, {"kernel": [[[[0, 1, 0]]]] * 2}, "0 in the middle"),
        (Crosstalk, {"kernel": [[[[1, 0, 0, 1]]]]}, "of odd rows and columns"),
        (Crosstalk, {"kernel": [[[[0, 0, 0]]]]}, "not all 0"),
        (Crosstalk, {"kernel": [[[[1, 0, 1], [1, 0]]]]}, "not all 0|shape"),
        (
            Crosstalk,
            {"mean_fired_neighbors": 0.4, "kernel": [[[[1, 0, 1]]], *[[[[0, 0, 0]]]] * 3]},
            "pixels fired by some",
        ),
        (DarkCounts, {"hot_fraction": 0.1}, "hot_mean_hz_um2: 0 with hot_fraction"),
        (Gate, {"period_s": 1.0}, "belong together"),
        (Gate, {"period_s": 1.0, "width_s": 1.5}, "fit into"),
        (Gate, {"period_s": 1.0, "width_s": 0.5, "phase_s": 1.0}, "fit into"),
        (Telegraph, {"fastest_s": 2.0}, "slowest_s: 1 is less than fastest_s 2"),
    ],
)
def test_values_that_no_effect_can_have_are_refused(effect, fields, message):
    with pytest.raises(ValueError, match=message):
        effect(**fields)
