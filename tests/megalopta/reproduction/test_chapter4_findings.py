"""A finding is said where the numbers bear it out, and not where they do not."""

import numpy as np
import pytest

from megalopta.flow.detectors.registry import THESIS_METHODS
from megalopta.flow.metrics.curve import ErrorCurve
from megalopta.flow.metrics.photon_threshold import Threshold
from megalopta.reproduction import chapter4_findings as module
from megalopta.reproduction.chapter4_denominators import FLOORS, growth_with_floor
from megalopta.reproduction.chapter4_findings import findings
from megalopta.reproduction.chapter4_information import (
    Seen,
    apart,
    inverse_to_information,
    like_the_open_forest,
)
from megalopta.reproduction.chapter4_sweeps import SWEEPS, in_form
from megalopta.reproduction.chapter4_table import PRINTED, division_of_natural, fewer_in_light


def results(sweep, flux_of):
    """Thresholds flux_of(method, size, value, metric); 0 is below the curve, inf above, NaN none."""
    outside = {0: "below", np.inf: "above"}

    def threshold(flux):
        if 0 < flux < np.inf:
            return Threshold("crossing", 0.25, 1e3, 1e12, flux, 0.9 * flux, 1.1 * flux)
        return Threshold(outside.get(flux, "undefined"), 0.25, 1e3, 1e12)

    def curves(point):
        for method in THESIS_METHODS:
            for metric in ("literal", "ratio"):
                flux = flux_of(method, point.size, point.value, metric)
                numbers = (1e5, 1e6), (0.3, 0.2), (0.0, 0.0), 4, {2: threshold(flux)}
                yield ErrorCurve(method, method, (60, 60), metric, *numbers)

    return {point.trial: tuple(curves(point)) for point in sweep.points}


def said(function, name, flux_of, is_quick=False):
    sweep = in_form(SWEEPS[name], is_quick)
    return function(sweep, results(sweep, flux_of))


def spread_of(decades):
    """From 1e5 at f = 1, so many decades more at f = 9."""
    return lambda method, size, f, metric: 1e5 * 10 ** (decades[method] * (f - 1) / 8)


FREQUENCY = {"BM": 1, "IIA": 2, "EMD": 2.5, "NDM": 1.3, "NDS": 1.3, "IM": 0}


@pytest.mark.parametrize(
    ("change", "is_said"), [({}, True), ({"EMD": 1}, False), ({"IIA": 3}, False)]
)
def test_wide_spread_over_frequency(change, is_said):
    flux_of = spread_of({**FREQUENCY, **change})
    sentence = said(module.widely_over_frequency, "fig-4.5", flux_of)
    assert (sentence is not None) == is_said
    if sentence:
        assert "(ours: 2.5)" in sentence


@pytest.mark.parametrize(("nds", "is_said"), [(1.3, True), (0.8, False)])
def test_nonlinear_methods_over_frequency(nds, is_said):
    flux_of = spread_of({**FREQUENCY, "NDS": nds})
    assert bool(said(module.nonlinear_over_frequency, "fig-4.5", flux_of)) == is_said


@pytest.mark.parametrize(("power", "is_said"), [(-2, True), (-1, False), (-3, False)])
def test_contrast_squared(power, is_said):
    def flux_of(method, size, contrast, metric):
        return 1e5 * contrast**power

    assert bool(said(module.inverse_square_of_contrast, "fig-4.6", flux_of)) == is_said


@pytest.mark.parametrize(
    ("flux_of_dark", "is_said"),
    [
        (lambda dark: 1e5 * (1 + dark / 10) ** 0.5, True),
        (lambda dark: 1e5, False),
        (lambda dark: 1e5 * (1 + dark / 10), False),
        (lambda dark: 1e5 * dark**0.5 if dark < 50 else np.nan, False),
    ],
)
def test_root_of_dark_counts(flux_of_dark, is_said):
    def flux_of(method, size, dark, metric):
        return flux_of_dark(dark)

    assert bool(said(module.towards_root_of_dark_counts, "fig-4.7", flux_of)) == is_said


def test_two_points_do_not_show_an_ever_steeper_rise():
    def flux_of(method, size, dark, metric):
        return 1e5 * (1 + dark / 10) ** 0.5

    assert said(module.towards_root_of_dark_counts, "fig-4.7", flux_of, is_quick=True) is None


@pytest.mark.parametrize(("flux", "is_said"), [(0, True), (1e5, False), (np.nan, False)])
def test_intensity_from_dark_counts_alone(flux, is_said):
    def flux_of(method, size, dark, metric):
        return flux if dark == 1000 else 1e4

    assert bool(said(module.brightness_of_dark_counts, "fig-4.7", flux_of)) == is_said


@pytest.mark.parametrize(
    ("factor", "is_quick", "is_said"), [(5, False, True), (1, False, False), (5, True, False)]
)
def test_spike_of_block_matching(factor, is_quick, is_said):
    def flux_of(method, size, velocity, metric):
        return 1e5 * (factor if (method, size, velocity) == ("BM", 60, 6) else 1)

    found = said(module.spike_of_block_matching, "fig-4.8", flux_of, is_quick)
    assert bool(found) == is_said


@pytest.mark.parametrize(
    ("power", "is_quick", "is_said"), [(0.1, False, True), (1, False, False), (0.1, True, False)]
)
def test_flat_interpolation(power, is_quick, is_said):
    def flux_of(method, size, velocity, metric):
        return 1e5 * velocity**power

    found = said(module.flat_interpolation, "fig-4.8", flux_of, is_quick)
    assert bool(found) == is_said


@pytest.mark.parametrize(("at_four", "is_said"), [(1e4, True), (9e4, False), (np.nan, False)])
def test_interpolation_at_one_pixel(at_four, is_said):
    def flux_of(method, size, velocity, metric):
        return at_four if velocity == 4 else 1e5

    assert bool(said(module.interpolation_at_one_pixel, "fig-4.11", flux_of)) == is_said


@pytest.mark.parametrize(("slow", "is_said"), [(np.nan, True), (0, False), (1e5, False)])
def test_rest_of_block_matching(slow, is_said):
    def flux_of(method, size, velocity, metric):
        return slow if method == "BM" and velocity == 1 else 1e5

    assert bool(said(module.rest_of_block_matching, "fig-4.8", flux_of)) == is_said


@pytest.mark.parametrize(
    ("power", "start"), [(1, "BM needs 4.0 times fewer"), (0.05, None), (-0.5, "As in the dissert")]
)
def test_pooling_of_block_matching(power, start):
    def flux_of(method, size, value, metric):
        return 1e5 * size**power

    sentence = said(module.pooling_of_block_matching, "fig-4.9", flux_of)
    assert sentence.startswith(start) if start else sentence is None


@pytest.mark.parametrize(("factor", "is_said"), [(100, True), (3, False)])
def test_division_by_small_responses(factor, is_said):
    def flux_of(method, size, velocity, metric):
        return 1e5 * (factor if metric == "literal" else 1)

    sentence = said(module.division_by_small_responses, "fig-4.11", flux_of)
    assert bool(sentence) == is_said
    if sentence:
        assert "about 100 times fewer" in sentence


@pytest.mark.parametrize("is_quick", [False, True])
@pytest.mark.parametrize("name", SWEEPS)
def test_a_run_without_thresholds_bears_out_nothing(name, is_quick):
    sweep = in_form(SWEEPS[name], is_quick)
    assert findings(name, sweep, results(sweep, lambda *_: np.inf)) == ()


def table(natural, photo, emd_by_means=1.0):
    """Rows as of Table 4.1, of every method alike."""
    return [
        {
            "method": method,
            "images": images,
            "metric": metric,
            "photons_per_frame": flux * (emd_by_means if metric == "ratio" else 1),
        }
        for method in PRINTED
        for images, flux in (("natural", natural), ("photo", photo))
        for metric in ("literal", "ratio")
    ]


def test_light_needs_fewer_photons_than_gray_values_only_where_it_does():
    assert fewer_in_light(table(1e5, 2e5))
    assert fewer_in_light(table(2e5, 1e5)) is None


def test_table_tells_of_division_only_where_it_costs_an_order_of_magnitude():
    assert division_of_natural(table(1e5, 1e5, emd_by_means=0.01))
    assert division_of_natural(table(1e5, 1e5, emd_by_means=0.5)) is None


def test_error_grows_with_the_floor_only_where_it_does():
    assert growth_with_floor(1 - np.log(FLOORS))
    assert growth_with_floor(np.ones(len(FLOORS))) is None


@pytest.mark.parametrize(("power", "is_said"), [(-1, True), (0, False), (1, False)])
def test_photons_are_inverse_to_information_only_where_they_are(power, is_said):
    seen = [
        Seen(method, str(information), "srgb", information, 1e5 * information**power)
        for method in PRINTED
        for information in (0.1, 0.2, 0.5)
    ]
    assert bool(inverse_to_information(seen)) == is_said


@pytest.mark.parametrize(("star", "is_said"), [(0.1, True), (0.3, False), (0.01, False)])
def test_printed_thresholds_are_those_of_the_open_forest_only_where_they_are(star, is_said):
    seen = [Seen(method, "open", "srgb", 0.1, 1e5) for method in PRINTED]
    assert bool(like_the_open_forest(seen, dict.fromkeys(PRINTED, star))) == is_said


@pytest.mark.parametrize(("iia", "is_said"), [(0.03, True), (0.1, False)])
def test_interpolation_asks_for_another_picture_only_where_it_does(iia, is_said):
    assert bool(apart({**dict.fromkeys(PRINTED, 0.1), "IIA": iia})) == is_said
