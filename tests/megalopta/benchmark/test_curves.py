"""Charts of errors: what the eye needs to tell methods and lights apart."""

import re

from megalopta.benchmark.curves import BOUND, STILL, error_chart
from megalopta.benchmark.table import FAR, MEAN, means, samples

UNIT = "photons per pixel", "--photons", 100


def chart(metric, methods):
    rows = means(
        samples(
            (metric, method, 100.0 * light, "all", unit, error + unit / 9, 1.0)
            for method, error in methods.items()
            for light in (1, 3, 10)
            for unit in range(5)
        )
    )
    return error_chart(rows, metric, UNIT, "title", rows)


def texts(svg):
    return re.findall(r"<text[^>]*>([^<]*)</text>", svg)


def test_ticks_are_at_the_lights_in_the_unit_that_was_given():
    shown = texts(chart(MEAN, {"DIS": 1.0, "own:flow": 2.0, BOUND: 0.1}))
    assert shown[:4] == ["1", "3", "10", "photons per pixel"]
    assert {"DIS", "own:flow", BOUND, "title"} <= set(shown)


def test_zero_motion_does_not_set_the_scale_of_shares():
    assert "40%" not in " ".join(texts(chart(FAR, {"DIS": 0.0, STILL: 90.0})))


def test_methods_of_ones_own_are_thick():
    widths = [
        set(re.findall(r"stroke-width: ([\d.]+)", chart(MEAN, dict.fromkeys(names, 1.0))))
        for names in (("DIS", "PF"), ("DIS", "own:flow"))
    ]
    assert widths[1] - widths[0] == {"3.5"}
