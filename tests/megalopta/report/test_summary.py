from dataclasses import replace

import pytest

from megalopta.config.model import Configuration
from megalopta.flow.metrics.curve import ErrorCurve
from megalopta.flow.metrics.photon_threshold import Threshold
from megalopta.report.budget import Budget
from megalopta.report.motion import MotionSection, Wheel
from megalopta.report.summary import (
    dark_findings,
    facts,
    lead,
    light_finding,
    threshold_finding,
    title,
)
from megalopta.sensor import PRESETS

BUDGET = Budget(
    sensor=PRESETS["spadcam"],
    level="twilight",
    illuminance_lux=1.0,
    photons=3e4,
    detected=14.0,
    dark=64.0,
    expected=78.0,
    signal_to_noise=(0.1, 0.48, 2.0),
    saturated_fraction=0.0,
    photons_per_frame=2e5,
)
MOTION = MotionSection(Wheel("", 6.0), (), "", 1.9, "12 %", 1030, "58 %")


def configured(**values):
    return Configuration.model_validate(values)


def curve(method, rows, flux, metric="literal", spread=1.1):
    need = Threshold("crossing", 0.25, 1e3, 1e12, flux, flux / spread, flux * spread)
    return ErrorCurve(method, method, (rows, rows), metric, (), (), (), 1, {2: need})


def without(method, kind):
    """A curve without a crossing."""
    return replace(curve(method, 60, 1e3), thresholds={2: Threshold(kind, 0.25, 1e3, 1e12)})


def test_the_title_goes_from_the_brightest_light_to_the_darkest():
    settings = configured(name="my_forest", light_levels=["starlight", "twilight", 10])
    assert title(settings).replace("\u00a0", " ") == "My forest, from 10 lux to starlight"


def test_one_light_is_no_span():
    settings = configured(light_levels=["full_moon"])
    assert title(settings).replace("\u00a0", " ") == "Forest, at full moon, 0.25 lux"


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


def test_the_lead_names_a_camera_that_is_no_pinhole():
    panorama = configured(camera={"kind": "cylindrical"})
    assert "The cylindrical camera stands still." in lead(panorama, {})


def test_the_lead_tells_what_stands_there():
    assert "150 trees (beech, birch and spruce)" in lead(configured(), {})
    assert "sine grating of contrast 0.9" in lead(configured(scene={"kind": "grating"}), {})


def test_the_lead_tells_what_was_measured_of_a_canopy():
    record = {"canopy": "Leaf-area index 4.99."}
    assert "per hectare. Leaf-area index 4.99. The" in lead(configured(), record)


def test_objects_and_triangles_are_told_where_the_renderer_noted_them():
    assert "triangles" not in [fact.label for fact in facts(configured(), {}, MOTION)]
    record = {"objects": 2534, "triangles": 1035334}
    told = {fact.label: fact.value for fact in facts(configured(), record, MOTION)}
    assert told["triangles"] == "1,035,334"
    assert told["objects"] == "2,534"
    assert told["trees"] == "150"


def test_the_light_finding_goes_from_bright_to_dark_whatever_the_order():
    dark = replace(BUDGET, illuminance_lux=1e-3, level="starlight", photons=30.0)
    dark = replace(dark, signal_to_noise=(0, 0.0005, 0.1))
    told = light_finding([dark, BUDGET])
    assert "From twilight to starlight" in told
    assert "from 30.0k to 30.0 per frame" in told
    assert "0.48 to 0.0005 on spadcam" in told


def test_a_single_light_is_told_without_a_span():
    told = light_finding([BUDGET, replace(BUDGET, sensor=PRESETS["ideal"])])
    assert told == (
        "At twilight, 30.0k photons per frame fall on a pixel of spadcam; a pixel's median "
        "signal-to-noise ratio is 0.48 on spadcam and 0.48 on ideal."
    )


def test_photons_that_do_not_fall_are_not_said_to_fall():
    # Airglow: fewer lux than starlight, more photons beyond the visible.
    dark = replace(BUDGET, illuminance_lux=8e-4, level="airglow", photons=9e4)
    told = light_finding([dark, BUDGET])
    assert "go from 30.0k to 90.0k per frame" in told
    assert "fall" not in told


def test_dark_counts_are_told_at_every_light_that_they_drown_and_at_no_other():
    bright = replace(BUDGET, illuminance_lux=10.0, level=10.0, detected=140.0)
    dark = replace(BUDGET, illuminance_lux=1e-3, level="starlight", detected=0.014)
    darkest = replace(BUDGET, illuminance_lux=8e-4, level="airglow", detected=100.0)
    (told,) = dark_findings([bright, dark, darkest, BUDGET])
    assert "at twilight and starlight (64.0 to 14.0 per pixel and frame at twilight)." in told
    assert dark_findings([bright]) == []


def test_needs_are_compared_at_the_largest_size_without_intensity():
    curves = [curve("NDS", 60, 1.0e3), curve("NDS", 120, 2.43e6), curve("EMD", 120, 2.38e8)]
    curves += [curve("BM", 120, 9e6), curve("IM", 120, 1e4), curve("BM", 120, 1e3, "ratio")]
    told = finding(*curves)
    assert "120 × 120 px, NDS needs the fewest photons, 2.43M per frame" in told
    assert "and EMD needs the most, 238M," in told


def finding(*curves):
    return threshold_finding(curves, "literal")


def test_needs_that_another_draw_might_reverse_are_not_ranked():
    told = finding(curve("NDS", 60, 1.0e6), curve("BM", 60, 1.05e6), curve("EMD", 60, 1e9))
    assert "NDS and BM need the fewest photons, 1.00M and 1.05M per frame" in told
    told = finding(curve("NDS", 60, 1.0e6), curve("BM", 60, 1.05e6))
    assert "fewest" not in told
    assert "most" not in told


def test_who_needs_more_or_fewer_than_was_tried_is_named():
    told = finding(curve("NDS", 60, 1.0e6), without("EMD", "above"), without("BM", "below"))
    assert (
        "BM needs fewer than 1.00k photons per frame, and EMD needs more than 1.00T photons" in told
    )


def test_without_any_threshold_there_is_no_need_to_tell():
    assert finding(without("BM", "undefined")) is None
