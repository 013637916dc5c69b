"""The opening, its remarks on noise, and a row of what came out for each sensor."""

from dataclasses import replace

import pytest

from megalopta.config.model import Configuration
from megalopta.dataset.flow_record import FlowRecord
from megalopta.plotting.text import title
from megalopta.report.page import OUTCOME, lead, outcome
from megalopta.report.source import rendering, rendering_errors

from .budgets import budget

BUDGET = budget("spadcam", "twilight", 1.0, detected=14.0, dark=64.0)


def configured(**values):
    return Configuration.model_validate(values)


def test_the_title_goes_from_the_brightest_light_to_the_darkest():
    settings = configured(name="my_forest", light_levels=["starlight", "twilight", 10])
    assert title(settings).replace("\u00a0", " ") == "My forest, from 10 lux to starlight"


@pytest.mark.parametrize(
    ("trajectory", "words"),
    [
        ({}, "The camera stands still."),
        ({"rotation_deg_s": -12}, "The camera turns right by 12° per second."),
        (
            {"rotation_deg_s": 5, "velocity_m_s": [3, 4, 0]},
            "The camera turns left by 5° per second and moves at 5 m per second.",
        ),
    ],
)
def test_the_lead_tells_how_the_camera_moves(trajectory, words):
    assert words in lead(configured(trajectory=trajectory), {})


def record(method, level, error, sensor="ideal", corrected=None):
    def blocks(median):
        names = "missing_fraction", "endpoint_error_px", "angular_error_deg", "outlier_fraction"
        pairs = {"bias_px": (0.0, 0.0), "spread_px": (0.0, 0.0)}
        medians = {"endpoint_error_median_px": 1.0, "relative_error_median": median}
        return {"blocks": 9, **dict.fromkeys(names, 0.5), **pairs, **medians}

    truth = {"ideal": blocks(0.0), "counts": blocks(error)}
    if corrected is not None:
        truth["corrected"] = blocks(corrected)
    place = {"sensor": sensor, "level": level, "method": method, "warm_up_frames": 0}
    error = {"literal": 0.0, "ratio": 0.0}
    return FlowRecord.model_validate({**place, "error": error, "truth": truth})


def told(records=(), budgets=()):
    """Rows by the heads of their columns."""
    rows = (dict(zip(OUTCOME, row, strict=True)) for row in outcome(records, budgets))
    return [{name: text.replace("\u00a0", " ") for name, text in row.items()} for row in rows]


def best(*records):
    (row,) = told(records)
    return tuple(row[name] for name in OUTCOME[1:4])


def test_the_method_that_reaches_the_darkest_light_is_named_with_its_error_there():
    found = best(
        *(record("PF", level, error) for level, error in ((10, 0.1), (1, 0.2), (0.1, 0.3))),
        *(record("BM", level, error) for level, error in ((10, 0.05), (1, 0.4), (0.1, 0.9))),
    )
    assert found == ("PF", "1 lux", "20 %")


@pytest.mark.parametrize(
    ("levels", "darkest"),
    [
        (((10, 0.1), (1, 0.5), (0.1, 0.1)), "10 lux"),  # accuracy is lost in between
        (((1e4, 1.0), (10, 0.1), (1, 0.5)), "10 lux"),  # the brightest saturates
    ],
)
def test_reach_ends_where_accuracy_does(levels, darkest):
    assert best(*(record("PF", level, error) for level, error in levels))[1] == darkest


def test_dark_counts_are_named_at_every_light_that_they_drown_and_at_no_other():
    bright = replace(BUDGET, illuminance_lux=10.0, level=10.0, detected=140.0)
    dark = replace(BUDGET, illuminance_lux=1e-3, level="starlight", detected=0.014)
    (row,) = told(budgets=[bright, dark, BUDGET])
    assert row[OUTCOME[-1]] == "twilight, starlight"
    assert told(budgets=[bright])[0][OUTCOME[-1]] == "–"


def measured(relative, **more):
    photons = 1 / relative**2 if relative else None
    return {
        "monte_carlo": {
            "median_relative": relative,
            "rms_over_mean": 0.12,
            "equivalent_photons_per_pixel": photons,
            **more,
        }
    }


@pytest.mark.parametrize(("relative", "caution"), [(0.05, False), (0.1, False), (0.11, True)])
def test_more_than_a_tenth_is_a_caution(relative, caution):
    text = rendering(measured(relative), "So.")
    assert f"as noisy as {1 / relative**2:.3g} photons per pixel" in text
    assert ("Caution" in text) == caution


def test_errors_on_surfaces_and_in_the_sky_are_told_apart():
    surface = {"rms": 0.06, "p95": 0.2, "gradient": 0.04, "standing": 0.02}
    surface["standing_gradient"] = 0.01
    record = measured(0.05, surface=surface, sky={"rms": 0.001})
    record["light_left_out"] = [0.01, 0.3]
    texts = [text.replace("\u00a0", " ") for _, text in rendering_errors(record)]
    assert texts == ["12 %", "6.0 %", "20 % or less", "4.0 %", "2.0 %", "1.0 %", "0.10 %", "30 %"]
