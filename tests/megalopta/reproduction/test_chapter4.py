"""Chapter 4: the figures' trials and the table."""

import csv
import json
import math

import numpy as np
import pytest

from megalopta.benchmark.panoramas import NATURAL_PANORAMAS
from megalopta.benchmark.trial import measure_trial
from megalopta.flow.detectors.registry import METHODS
from megalopta.flow.metrics.photon_threshold import ErrorCurve, Threshold
from megalopta.reproduction import drawing as module
from megalopta.reproduction.chapter4_curves import SWEEPS
from megalopta.reproduction.chapter4_table import PRINTED, least, table_trials
from megalopta.reproduction.drawing import reproduce
from megalopta.reproduction.sweep_figure import mean_threshold


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


def test_table_takes_the_least_of_all_experiments_and_the_mean_of_the_forests():
    found = results(table_trials(False))
    synthetic = least(found, "synthetic", "BM", "literal")
    assert (synthetic.threshold.flux, synthetic.where) == (pytest.approx(1e5), "f = 7")
    natural = least(found, "natural", "EMD", "ratio")
    assert natural.threshold[:3] == pytest.approx((0.5 * 2.5e6, 0.5e6, 2e6))
    assert natural.where == "v = 8"


def pictures(of_templates, cache=None):
    """Two pixels for each template: of contrast 1 in light, ½ in gray values."""
    pixels = {"linear": np.array([[0.0, 2.0]]), "srgb": np.array([[1.0, 3.0]])}
    return {each: pixels[getattr(each, "coding", "linear")] for each in of_templates}


def test_mean_over_templates_spans_the_least_to_the_most_and_one_keeps_its_interval():
    assert mean_threshold([crossing(1.0), crossing(3.0)]) == (2, 1, 3, "[1.00, 3.00]")
    assert mean_threshold([crossing(2.0)])[:3] == pytest.approx((2, 1.8, 2.2))
    above = Threshold("above", 0.25, 1e3, 1e12)
    assert math.isnan(mean_threshold([crossing(1.0), above]).flux)


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
