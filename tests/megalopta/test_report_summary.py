from dataclasses import replace

import pytest

from megalopta import files
from megalopta.configuration import Configuration
from megalopta.dataset import Dataset
from megalopta.flow.threshold import Threshold
from megalopta.report.budget import Budget
from megalopta.report.detectors import DetectorSection, Verdict, VerdictGroup
from megalopta.report.motion import MotionSection, Wheel
from megalopta.report.summary import (
    dark_findings,
    facts,
    lead,
    light_finding,
    motion_findings,
    need_finding,
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
MOTION = MotionSection(Wheel("", 6.0), (), "", 1.9, "12 %", 1030)


def configured(**values):
    return Configuration.model_validate(values)


def curve(method, rows, flux, metric="literal"):
    need = Threshold("crossing", 0.25, 1e3, 1e12, flux, flux, flux)
    thresholds = {"N_2b": need.to_dict()}
    return {"method": method, "shape": [rows, rows], "metric": metric, "thresholds": thresholds}


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
    assert words in lead(configured(trajectory=trajectory))


def test_the_lead_names_a_camera_that_is_no_pinhole():
    panorama = configured(camera={"kind": "cylindrical"})
    assert "The cylindrical camera stands still." in lead(panorama)


def test_the_lead_tells_what_stands_there():
    assert "150 trees (beech, birch and spruce)" in lead(configured())
    assert "sine grating of contrast 0.9" in lead(configured(scene={"kind": "grating"}))


def test_objects_and_triangles_are_told_where_the_renderer_noted_them(tmp_path):
    dataset = Dataset(tmp_path, configured())
    assert "triangles" not in [fact.label for fact in facts(dataset, MOTION)]
    files.write_json(dataset.scene_record, {"objects": 2534, "triangles": 1035334})
    told = {fact.label: fact.value for fact in facts(dataset, MOTION)}
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


def test_dark_counts_are_told_from_the_brightest_light_that_they_drown():
    bright = replace(BUDGET, illuminance_lux=10.0, level=10.0, detected=140.0)
    dark = replace(BUDGET, illuminance_lux=1e-3, level="starlight", detected=0.014)
    (told,) = dark_findings([bright, dark, BUDGET])
    assert "at twilight (64.0 to 14.0 per pixel and frame) and below" in told
    assert dark_findings([bright]) == []


def test_motion_is_read_where_both_errors_are_small_and_intensity_does_not_count():
    both, ratio = Verdict("both", ""), Verdict("ratio", "")
    rows = {"BM": (both, ratio), "EMD": (both, ratio), "IM": (both, both)}
    seeing = VerdictGroup("ideal", ("twilight", "starlight"), rows)
    blind = VerdictGroup("spadcam", ("twilight",), {"BM": (ratio,), "IM": (both,)})
    nothing = VerdictGroup("ideal", ("twilight",), {"IM": (both,)})
    groups = (seeing, blind, nothing)
    first, second = motion_findings(DetectorSection(0, None, (), (), None, None, groups))
    assert "of 2 motion detectors" in first
    assert first.endswith("2 at twilight, none at starlight.")
    assert "no motion detector" in second


def test_needs_are_compared_at_the_largest_size_without_intensity():
    curves = [curve("NDS", 60, 1.0e3), curve("NDS", 120, 2.43e6), curve("EMD", 120, 2.38e8)]
    curves += [curve("BM", 120, 9e6), curve("IM", 120, 1e4), curve("BM", 120, 1e3, "ratio")]
    told = need_finding({"curves": curves, "settings": {"metrics": ["literal", "ratio"]}})
    assert "120 × 120 px, NDS needs the fewest photons" in told
    assert "2.43M per frame, and EMD the most, 238M" in told


def test_without_any_crossing_there_is_no_need_to_tell():
    nothing = curve("BM", 60, 1e3)
    nothing["thresholds"] = {"N_2b": Threshold("above", 0.25, 1e3, 1e12).to_dict()}
    assert need_finding({"curves": [nothing], "settings": {"metrics": ["literal"]}}) is None
