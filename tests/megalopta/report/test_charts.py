import re
from xml.etree import ElementTree

import numpy as np

from megalopta.flow.metrics.curve import ErrorCurve
from megalopta.flow.metrics.photon_threshold import Threshold
from megalopta.plotting.style import BLACK, RULE
from megalopta.report.budget import Budget
from megalopta.report.charts import MethodThresholds, error_chart, signal_chart, threshold_chart
from megalopta.sensor import PRESETS

FLUXES = np.geomspace(1e3, 1e9, 7)


def budget(sensor, level, lux, photons_per_frame, ratio=1.0):
    return Budget(
        sensor=PRESETS[sensor],
        level=level,
        illuminance_lux=lux,
        photons=1.0,
        detected=1.0,
        dark=0.0,
        expected=1.0,
        signal_to_noise=(0.5 * ratio, ratio, 2 * ratio),
        saturated_fraction=0.0,
        photons_per_frame=photons_per_frame,
    )


BUDGETS = [
    budget("spadcam", "twilight", 1.0, 1e4),
    budget("spadcam", "starlight", 1e-3, 10.0, 0.01),
    budget("ideal", "twilight", 1.0, 1e8, 100.0),
    budget("ideal", "starlight", 1e-3, 0.0, 0.0),
]


def texts(svg):
    # What HTML allows beyond XML: xlink without its namespace.
    root = ElementTree.fromstring(str(svg).replace("xlink:href", "href"))
    return [element.text for element in root.iter("text")]


def curve(name, errors):
    shape = (60, 60)
    return ErrorCurve(name, name, shape, "literal", (*FLUXES,), (*errors,), (*errors / 10,), 1, {})


def crossing(flux):
    return Threshold("crossing", 0.25, 1e3, 1e9, flux, flux / 1.2, flux * 1.2)


def test_charts_take_the_colors_and_fonts_of_the_page():
    svg = str(signal_chart(BUDGETS, ["spadcam", "ideal"]))
    assert {"illuminance (lux)", "spadcam", "ideal"} <= {*texts(svg)}
    assert "://" not in svg and "<style" not in svg
    assert "stroke-width: 2;" in svg  # matplotlib's own lines are 1.5 pt wide
    assert "currentColor" in svg
    assert "var(--rule)" in svg
    assert "font-family" not in svg
    assert not {BLACK.lower(), RULE.lower()} & set(re.findall("#[0-9a-f]{6}", svg))


def test_identifiers_carry_the_name_of_the_chart():
    shown = curve("BM", 1e3 / FLUXES)
    svg = str(error_chart([shown], "chart-7", 0.25, "a chart"))
    targets = re.findall(r'(?:url\(#|href="#)([^)"]*)', svg)
    identifiers = set(re.findall(r'\sid="([^"]*)"', svg))
    assert targets
    assert set(targets) <= identifiers
    assert all(identifier.startswith("chart-7-") for identifier in identifiers)


def test_needs_name_every_method_sensor_and_light():
    methods = [MethodThresholds("BM", {"literal": crossing(1e6), "ratio": crossing(1e5)})]
    words = texts(threshold_chart(methods, BUDGETS, "need", "needs"))
    assert {"BM", "spadcam", "ideal", "twilight", "starlight", "photons per frame"} <= {*words}


def test_descriptions_are_escaped():
    svg = str(error_chart([], "chart", 0.25, 'a "chart" <of> errors'))
    assert 'aria-label="a &#34;chart&#34; &lt;of&gt; errors"' in svg
