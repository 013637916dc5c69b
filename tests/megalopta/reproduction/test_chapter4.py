"""Chapter 4: the figures' trials, the table, the scenes, and the claim about denominators."""

import csv
import json
import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from megalopta.benchmark import trial as templates
from megalopta.benchmark.panoramas import NATURAL_PANORAMAS
from megalopta.benchmark.runner import run_trials
from megalopta.benchmark.trial import measure_trial
from megalopta.flow.detectors.registry import METHODS
from megalopta.flow.metrics.photon_threshold import ErrorCurve, Threshold
from megalopta.flow.stimuli.statistics import image_statistics
from megalopta.reproduction import chapter4_scenes, drawing as module
from megalopta.reproduction.chapter4_conventions import FLOORS, floored_errors
from megalopta.reproduction.chapter4_curves import MOTION, PHOTOGRAPHED, SWEEPS, beside_printed
from megalopta.reproduction.chapter4_scenes import (
    implied_information,
    information_per_photon,
    needed_of,
)
from megalopta.reproduction.chapter4_table import PRINTED, least
from megalopta.reproduction.drawing import Run, find, reproduce
from megalopta.reproduction.sweep_figure import mean_threshold, sweep_curve

from ..figures import canvas_of, check_words, made


def crossing(flux):
    return Threshold("crossing", 0.25, 1e3, 1e12, flux, 0.9 * flux, 1.1 * flux)


def curves(flux_of):
    """Curves of all methods in both metrics; ratio needs half of the light."""
    return tuple(
        ErrorCurve(
            name, name, (60, 60), metric, (1e5, 1e6), (0.3, 0.2), (0.0, 0.0), 4, {2: threshold}
        )
        for name in METHODS
        for metric, factor in (("literal", 1.0), ("ratio", 0.5))
        for threshold in [crossing(factor * flux_of(name))]
    )


def results(trials):
    """Thresholds that grow with distance from f = 7 or v = 8, and with the number of the forest."""
    found = {}
    for trial in trials:
        if trial.template.kind == "grating":
            away = abs(trial.template.cycles_per_frame - 7) + abs(trial.velocity_px - 5) / 100
            flux = 1e5 * (1 + away)
        else:
            forest = list(NATURAL_PANORAMAS).index(trial.template.name)
            flux = 1e6 * (1 + abs(trial.velocity_px - 8)) * (1 + forest) * (1 + trial.blurred)
        found[trial] = curves(lambda name, flux=flux: flux)
    return found


@pytest.mark.parametrize("name", SWEEPS)
def test_fixed_parameters_are_those_of_the_text(name):
    sweep = SWEEPS[name]
    for trial in sweep.trials:
        if sweep.vary != "velocity_px":
            assert trial.velocity_px == 5
        if sweep.vary != "search.dark_counts":
            assert trial.search.dark_counts == 0.1
        if trial.template.kind == "grating":
            assert sweep.vary == "template.contrast" or trial.template.contrast == 0.9
            assert sweep.vary == "template.cycles_per_frame" or trial.template.cycles_per_frame == 5
    assert {trial.blurred for trial in sweep.trials} == {name == "fig-4.12"}


def test_table_takes_the_least_of_all_experiments_and_the_mean_of_the_forests():
    (recipe,) = find("table-4.1")
    found = results(recipe.trials(False))
    synthetic = least(found, "synthetic", "BM", "literal")
    assert (synthetic.threshold.flux, synthetic.where) == (pytest.approx(1e5), "f = 7")
    natural = least(found, "natural", "EMD", "ratio")
    assert natural.threshold[:3] == pytest.approx((0.5 * 2.5e6, 0.5e6, 2e6))
    assert natural.where == "v = 8"


def pictures(of_templates, cache=None):
    """Two pixels for each template: of contrast 1 in light, ½ in gray values."""
    pixels = {"linear": np.array([[0.0, 2.0]]), "srgb": np.array([[1.0, 3.0]])}
    return {each: pixels[getattr(each, "coding", "linear")] for each in of_templates}


def drawn(name, is_quick=False, pixels=pictures):
    (recipe,) = find(name)
    trials = recipe.trials(is_quick)
    return recipe.make(Run(is_quick, results(trials), pixels(trial.template for trial in trials)))


def textured(of_templates):
    rng = np.random.default_rng(0)
    return {each: rng.uniform(1, 2, (251, 502)) for each in set(of_templates)}


def test_mean_over_templates_spans_the_least_to_the_most_and_one_keeps_its_interval():
    assert mean_threshold([crossing(1.0), crossing(3.0)]) == (2, 1, 3, "[1.00, 3.00]")
    assert mean_threshold([crossing(2.0)])[:3] == pytest.approx((2, 1.8, 2.2))
    above = Threshold("above", 0.25, 1e3, 1e12)
    assert math.isnan(mean_threshold([crossing(1.0), above]).flux)


def power_law(sweep, power, of=MOTION):
    """Results in which photons of some methods go with a power of the varied parameter."""
    return {
        point.trial: curves(lambda name, x=point.value: 1e5 * (x**power if name in of else 1.0))
        for point in sweep.points
    }


@pytest.mark.parametrize(
    ("name", "quantity", "power", "value"),
    [
        # over 9 frequencies, one decade
        ("fig-4.5", "Decades that EMD moves", 2 * math.log(10) / math.log(9), "2"),
        ("fig-4.6", "Exponent of contrast, motion detectors", -2, "−2"),
        ("fig-4.7", "Last exponent of dark counts, motion detectors", 0.5, "0.5"),
        ("fig-4.8", "BM at 1.43 px per resized frame over beside", 0, "1"),
        ("fig-4.9", "BM: largest over smallest frames", 1, "4"),
        ("fig-4.11", "EMD by Eq. 4.5 over quotient of means", 0, "2"),
    ],
)
def test_numbers_below_a_figure_are_those_of_its_curves(name, quantity, power, value):
    sweep = SWEEPS[name]
    ours, _ = beside_printed(name, sweep, power_law(sweep, power))[quantity]
    assert ours == value


def test_error_diverges_with_the_logarithm_of_the_floor_where_responses_pass_zero():
    # Δ = 1 and R uniform in (−1, 1): the mean of 1/max(|R|, ε) is 1 − ln ε, 7.9 at ε = 1e-3. Its
    # standard error is 0.045 (the variance of 1/R is 2/ε): five are 2.8 %.
    ideal = np.random.default_rng(0).uniform(-1, 1, 1_000_000)
    errors = floored_errors(ideal, ideal + 1)
    floors = FLOORS * np.abs(ideal).mean()
    large = floors > 1e-3
    np.testing.assert_allclose(errors[large], 1 - np.log(floors[large]), rtol=0.03)


@pytest.mark.slow
def test_chapter_4_is_written_and_measured_once(tmp_path, monkeypatch):
    asked = []

    def counted(trials, templates, store, workers, scheduler):
        asked.append(set(trials))
        return results(trials)

    monkeypatch.setattr(module, "run", counted)
    monkeypatch.setattr(module, "template_pixels", pictures)
    paths = reproduce(["fig-4.9", "fig-4.13", "table-4.1", "fig-4.9"], tmp_path, is_quick=True)
    assert len(asked) == 1
    assert {path.name for path in paths} == {
        *(
            f"{n}.{kind}"
            for n in ("fig-4.9", "fig-4.13", "table-4.1")
            for kind in ("png", "svg", "csv", "json")
        ),
        "chapter-4.html",
    }
    assert all(path.is_file() for path in paths)
    assert {path.parent for path in paths} == {tmp_path / "quick"}
    record = json.loads((tmp_path / "quick" / "fig-4.9.json").read_text("utf-8"))
    assert record["sweep"]["vary"] == "size"
    assert record["quick"] is True
    assert "quick form" in record["title"]
    with (tmp_path / "quick" / "fig-4.9.csv").open(newline="", encoding="utf-8") as file:
        assert len(list(csv.DictReader(file))) == len(record["rows"])


@pytest.mark.parametrize(
    "name", [*SWEEPS, "table-4.1", "denominators", "natural-information", "normalizations"]
)
def test_words_name_the_figure_and_are_few(name):
    check_words(drawn(name, True, textured))


@pytest.mark.parametrize(
    ("method", "name", "value"),
    [
        ("BM", "fig-4.5", 8),
        ("IIA", "fig-4.5", 9),
        ("EMD", "fig-4.5", 7),
        ("NDM", "fig-4.8", 10),
        ("NDS", "fig-4.8", 10),
    ],
)
def test_synthetic_column_is_within_a_factor_of_2_2_of_the_printed_one(method, name, value):
    # where each method needs the fewest photons; intervals are within 4 %
    (point,) = (each for each in SWEEPS[name].points if (each.size, each.value) == (60, value))
    trial = point.trial.model_copy(update={"methods": (method,)})
    found = measure_trial(trial, trial.template.pixels(), "test")[0].thresholds[2].flux
    assert 1 / 2.2 < found / PRINTED[method][0] < 2.2


@pytest.mark.slow
def test_natural_column_of_photographs_is_near_the_printed_one(tmp_path):
    # velocities in which methods need least: BM and IIA, BM, NDM and NDS
    sweep = PHOTOGRAPHED.model_copy(update={"values": (4, 8, 10)})
    trials = sweep.trials
    with ThreadPoolExecutor() as threads:
        pixels = templates.template_pixels(sweep.templates)
        found = run_trials(trials, pixels, tmp_path, threads)
    ratio = {
        method: min(
            threshold.flux / printed
            for _, threshold in sweep_curve(sweep, found, 60, method, "literal")
            if threshold.flux > 0
        )
        for method, (_, printed) in PRINTED.items()
    }
    assert all(1 / 4 < ratio[method] < 4 for method in ("BM", "NDM", "NDS"))
    assert 1 / 10 < ratio["EMD"] < 10
    # the rest is explained by one number of each picture, to about a factor of two
    seen = {}
    for method in ("BM", "IIA", "NDM", "NDS"):
        for picture in PHOTOGRAPHED.templates:
            of_picture = [trial for trial in trials if trial.template == picture]
            seen.setdefault(method, []).append(needed_of(method, of_picture, found, pixels))
        products = [each.information * each.photons for each in seen[method]]
        assert max(products) / min(products) < 2.2  # while photons vary by a factor of 2.3 to 3.3
    implied = {each: implied_information(seen[each], PRINTED[each][1]) for each in seen}
    same = [implied[method] for method in ("BM", "NDM", "NDS")]
    assert max(same) / min(same) < 1.7
    assert max(same) / implied["IIA"] < 4


def test_information_of_a_grating_meets_the_closed_form():
    # λ = 1 + C sin kx: the mean of λ'²/λ is k²·(1 − √(1 − C²)). A spline through six samples of a
    # period has 0.992 of the slope, so 1.5 % is missing.
    k, contrast = 2 * np.pi / 6, 0.3
    columns = np.arange(480) / 4  # every fourth is sampled
    template = np.tile(1 + contrast * np.sin(k * columns), (240, 1))
    expected = k**2 * (1 - np.sqrt(1 - contrast**2))
    assert information_per_photon(template) == pytest.approx(expected, rel=0.025)


def test_grating_is_the_product_of_two_turned_sines_at_the_pixels_that_pooling_keeps():
    figure = made("fig-4.2")
    row, column, brightness = np.array(figure.rows)[:, :3].T
    # floor((i + 1/2)·251/60) + 1/2, in frames of 251 pixels.
    y, x = (((2 * index + 1) * 251 // 120 + 0.5) / 251 for index in (row, column))
    along, across = ((x + y) / 2**0.5, (y - x) / 2**0.5)
    expected = 1 + np.sin(8 * np.pi * along) * np.sin(8 * np.pi * across)
    np.testing.assert_allclose(brightness, expected, atol=1e-12)


@pytest.fixture
def forests(monkeypatch):
    grown = {
        name: np.random.default_rng(recipe.forest.seed).gamma(2, 0.5, (120, 400))
        for name, recipe in NATURAL_PANORAMAS.items()
    }
    monkeypatch.setattr(chapter4_scenes, "natural_templates", lambda cache=None: grown)
    return grown


@pytest.mark.slow
def test_forests_are_drawn_with_their_statistics(forests):
    figure = made("fig-4.3")
    canvas_of(figure)
    rows = {
        name: dict(zip(figure.columns[1:], values, strict=True)) for name, *values in figure.rows
    }
    assert set(rows) == {*forests, "dead leaves"}
    for name, template in forests.items():
        # Gamma noise of shape 2 has contrast 1/√2, known from 48 000 pixels to 0.6 % (σ); five σ
        assert rows[name]["contrast"] == pytest.approx(2**-0.5, rel=0.03)
        assert rows[name] == vars(image_statistics(template))
    # Dead leaves have the scale-free spectrum that noise has not.
    assert rows["dead leaves"]["spectrum_slope"] < -1.5 < rows["open"]["spectrum_slope"]
