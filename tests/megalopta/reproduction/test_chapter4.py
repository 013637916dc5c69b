"""Chapter 4: the figures' trials and the table."""

import numpy as np
import pandas as pd
import pytest

from megalopta.benchmark.panoramas import NATURAL_PANORAMAS
from megalopta.benchmark.trial import measure_trial
from megalopta.core.errors import UserError
from megalopta.flow.detectors.registry import METHODS
from megalopta.flow.metrics.photon_threshold import ErrorCurve, Threshold
from megalopta.reproduction import sweep_figure as module
from megalopta.reproduction.chapter4 import PRINTED, reproduce, sweep, table_rows, table_trials
from megalopta.reproduction.sweep_figure import over_templates


def crossing(flux):
    return Threshold("crossing", 0.25, 1e3, 1e12, flux, 0.9 * flux, 1.1 * flux)


def curves(flux_of):
    """Curves of all methods in both metrics; ratio needs half of the light."""
    return tuple(
        ErrorCurve(name, (60, 60), metric, (1e5, 1e6), (0.3, 0.2), (0.0, 0.0), 4, {2: threshold})
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
    rows = table_rows(results(table_trials(False))).set_index(["method", "images", "metric"])
    synthetic = rows.loc["BM", "synthetic", "literal"]
    assert (synthetic.photons_per_frame, synthetic.found_at) == (pytest.approx(1e5), "f = 7")
    assert synthetic.interval == "90\u202f000 to 110\u202f000"
    natural = rows.loc["EMD", "natural", "ratio"]
    found = natural.photons_per_frame, natural.low, natural.high
    assert found == pytest.approx((0.5 * 2.5e6, 0.5e6, 2e6))
    assert natural.found_at == "v = 8"


def pictures(of_templates):
    """Two pixels for each template: of contrast 1 in light, ½ in gray values."""
    pixels = {"linear": np.array([[0.0, 2.0]]), "srgb": np.array([[1.0, 3.0]])}
    return {each: pixels[getattr(each, "coding", "linear")] for each in of_templates}


def test_mean_over_templates_spans_the_least_to_the_most_and_one_keeps_its_interval():
    case = {"size_px": 60, "method": "BM", "metric": "literal", "bits": 2}
    rows = [(1, "a", 1.0), (1, "b", 3.0), (2, "a", 2.0), (3, "a", 1.0), (3, "b", np.nan)]
    found = over_templates(
        pd.DataFrame(
            {**case, "value": value, "template": template, "photons_per_frame": flux}
            | {"low": 0.9 * flux, "high": 1.1 * flux}
            for value, template, flux in rows
        )
    )
    numbers = found[["photons_per_frame", "low", "high"]].to_numpy()
    np.testing.assert_allclose(numbers, [[2, 1, 3], [2, 1.8, 2.2], [np.nan] * 3])


@pytest.mark.slow
def test_chapter_4_is_written_and_measured_once(tmp_path, monkeypatch):
    asked = []

    def counted(trials, templates, store, workers):
        asked.append(set(trials))
        return results(trials)

    monkeypatch.setattr(module, "run", counted)
    monkeypatch.setattr(module, "template_pixels", pictures)
    paths = reproduce(["fig-4.9", "fig-4.13", "table-4.1", "fig-4.9"], tmp_path, is_quick=True)
    assert len(asked) == 1
    figures = (f"{n}.{kind}" for n in ("fig-4.9", "fig-4.13") for kind in ("png", "svg", "csv"))
    assert {path.name for path in paths} == {*figures, "table-4.1.csv", "chapter-4.html"}
    assert {path.parent for path in paths} == {tmp_path / "quick"}
    numbers = pd.read_csv(tmp_path / "quick" / "fig-4.9.csv")
    assert set(numbers["method"]) == set(METHODS) and numbers["photons_per_frame"].notna().all()
    assert "quick form" in (tmp_path / "quick" / "fig-4.9.svg").read_text("utf-8")


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
    (point,) = (each for each in sweep(name).points if (each.size, each.value) == (60, value))
    trial = point.trial.model_copy(update={"methods": (method,)})
    found = measure_trial(trial, trial.template.pixels(), "test")[0].thresholds[2].flux
    assert 1 / 2.2 < found / PRINTED[method][0] < 2.2


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("fig-2.9", "no figure 'fig-2.9'.*examples/dissertation"),
        ("fig-4.5", "a file is in the way; give the path of a folder"),
    ],
)
def test_what_cannot_be_drawn_is_refused_before_anything_is_written(tmp_path, name, told):
    (tmp_path / "out").touch()
    with pytest.raises(UserError, match=told):
        reproduce([name], tmp_path / "out")
