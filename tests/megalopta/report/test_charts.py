import re
from xml.etree import ElementTree

import numpy as np
import pytest

from megalopta.flow.metrics.photon_threshold import ErrorCurve, Threshold
from megalopta.plotting.style import BLACK, RULE
from megalopta.report.light_section import signal_chart
from megalopta.report.motion_section import speed_chart
from megalopta.report.thresholds import error_chart

from .budgets import budget

FLUXES = np.geomspace(1e3, 1e9, 7)


BUDGETS = [
    budget("spadcam", "twilight", 1.0, photons_per_frame=1e4),
    budget("spadcam", "starlight", 1e-3, 0.01, photons_per_frame=10.0),
    budget("ideal", "twilight", 1.0, 100.0, photons_per_frame=1e8),
    budget("ideal", "starlight", 1e-3, 0.0),
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


def test_descriptions_are_escaped():
    svg = str(error_chart([], "chart", 0.25, 'a "chart" <of> errors'))
    assert 'aria-label="a &#34;chart&#34; &lt;of&gt; errors"' in svg


def test_undefined_and_zero_errors_leave_gaps():
    errors = np.array([np.nan, 3.0, 1.0, 0.3, 0.1, 0.0, 0.0])
    svg = str(error_chart([curve("BM", errors)], "gaps", 0.25, "gaps"))
    assert "nan" not in svg
    assert svg.count("<use") >= 4  # one marker per drawn error, beside those of the ticks


@pytest.mark.parametrize("speed", [0.0, 1.6667])
def test_an_image_that_moves_everywhere_alike_has_its_speed_chart(speed):
    speeds = np.full(500, speed, np.float32) + np.float32(1e-6) * np.arange(500) / 500
    svg = speed_chart(speeds, speed)
    assert "share of pixels (%)" in texts(svg)
