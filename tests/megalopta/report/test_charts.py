"""Charts of a page take its colors, fonts and width, and keep their identifiers apart."""

import re
from xml.etree import ElementTree

import numpy as np

from megalopta.flow.metrics.photon_threshold import ErrorCurve
from megalopta.report.detectors import error_chart
from megalopta.report.style import BLACK, RULE, map_chart

FLUXES = np.geomspace(1e3, 1e9, 7)


def chart(errors, description="a chart", name="chart-7"):
    shape = (60, 60)
    numbers = (*FLUXES,), (*errors,), (*errors / 10,)
    curve = ErrorCurve("BM", shape, "literal", *numbers, 1, {})
    return str(error_chart([curve], [], name, description))


def test_charts_take_the_colors_of_the_page_and_name_their_parts():
    svg = chart(1e3 / FLUXES, 'a "chart" <of> errors')
    # what HTML allows beyond XML: xlink without its namespace
    root = ElementTree.fromstring(svg.replace("xlink:href", "href"))
    assert "photons per frame" in {element.text for element in root.iter("text")}
    assert root.get("aria-label") == 'a "chart" <of> errors'
    assert "://" not in svg and "<style" not in svg
    assert "currentColor" in svg and "var(--rule)" in svg
    assert not {BLACK.lower(), RULE.lower()} & set(re.findall("#[0-9a-f]{6}", svg))
    targets = re.findall(r'(?:url\(#|href="#)([^)"]*)', svg)
    identifiers = re.findall(r'\sid="([^"]*)"', svg)
    assert targets and set(targets) <= set(identifiers)
    other = chart(1e3 / FLUXES, name="chart-8")
    assert not set(identifiers) & set(re.findall(r'\sid="([^"]*)"', other))


def test_undefined_and_zero_errors_leave_gaps():
    svg = chart(np.array([np.nan, 3.0, 1.0, 0.3, 0.1, 0.0, 0.0]))
    assert "nan" not in svg
    assert svg.count("<use") >= 4  # one marker per drawn error, beside those of the ticks


def test_a_map_of_a_wide_array_is_as_high_as_its_picture_so_that_its_title_is_above_the_scale():
    svg = str(map_chart(np.zeros((48, 80)), "map", "mean, captured minus simulated"))
    # 258 pt by the shape of the array, and 60 pt for title and labels
    assert f'viewBox="0 0 380 {258 * 48 / 80 + 60:g}"' in svg
