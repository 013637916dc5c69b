"""Faults of a recording: each is named and located, and no wrong cause is stated."""

from collections import Counter

import numpy as np
import pytest

from megalopta.sensor import changed, preset
from megalopta.sensor.compare.model import Model
from megalopta.sensor.compare.recordings import compare_levels
from megalopta.sensor.spad.device import draw_fixed_pattern

from . import composed
from .faulty import CAMERAS, FAULTS, compared, moved, of_readings, recorded, said, together, written
from .judgment import Recipe

CODES = FAULTS["codes"]


PLACES = {
    "dead row": "dead row 5",
    "dead column": "dead column 9",
    "stuck pixel": "stuck pixel (row 5, column 6), at code 2000",
    "telegraph noise": "telegraph noise in pixels (row 2, column 3), (7, 11), (13, 5)",
    "hot pixel": "hot pixel (row 4, column 9), of ",
    "stuck bit": "bit 5 of all pixels is stuck at 1",
    "flicker 60 Hz": "flicker of 60 Hz, ±10 %",
    "banding 60 Hz": "row banding of 60 Hz",
    "frames twice": "200 of 400 frames repeat the one before",
    "frames lost": "3 frames are missing in one place",
    "light +10 % to the right": "the light is uneven, by 1",
    "bent output": "frames differ; none of the known causes explains the difference.",
    "dead time": "With this dead time, frames kept from the fit are predicted over 1000 times better",
}


QUICK = "dead row", "flicker 60 Hz", "row offset 8 mV", "dead time", "bent output", "gain +10 %"


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name in QUICK else pytest.mark.slow) for name in CODES]
)
def test_a_fault_is_named_and_located_and_no_other(name):
    wanted, how = CODES[name]
    found = compared(2, **how)
    # what is left of a fault that was taken out may be said, too
    assert wanted in said(found) <= {wanted, "none"}
    assert PLACES.get(name, "") in found.sentence


@pytest.mark.parametrize("name", ["flicker 60 Hz", "banding 60 Hz"])
def test_lost_frames_do_not_split_a_line(name):
    wanted, how = FAULTS["counts"][name]
    found = compared(1, CAMERAS["counts"], **together(how, FAULTS["counts"]["frames lost"][1]))
    assert said(found) == {wanted, "missing frames"}
    assert sum("of 60 Hz" in each.text for each in found.faults) == 1


@pytest.mark.parametrize(
    ("words", "move"),
    [
        ("transposed", lambda codes: codes.transpose(0, 2, 1)),
        ("rows in reverse order", lambda codes: codes[:, ::-1]),
        ("turned by 90° to the left", lambda codes: np.rot90(codes, axes=(1, 2))),
        ("2 of 16 rows in another order", lambda codes: codes[:, [1, 0, *range(2, 16)]]),
        ("16 of 16 rows", lambda codes: codes[:, np.arange(16) ^ 1]),
    ],
)
def test_another_order_of_pixels_is_told(words, move):
    assert words in compared(2, **moved(move)).sentence


COUNTS = CAMERAS["counts"]._replace(shape=(16, 16))


def test_pixels_are_tested_without_all_that_is_named():
    other = {"sensor": {"dead_time": {"dead_time_s": 1e-7}}}
    found = compared(3, COUNTS, **together(FAULTS["counts"]["hot pixel"][1], other))
    assert said(found) == {"hot pixel", "dead time"}
    assert "hot pixel (row 4, column 9), of " in found.sentence
    # discoveries of 2 · 6 · 255 tests at a rate of 0.002, of which none is a difference
    assert sum(test.differs.sum() for test in found.tests.values()) <= 1
    assert np.isnan(found.tests["mean"].p[:, 4, 9]).all()
    # of a counter without a step, none is fitted, and a leak is none: no number is absurdly small
    assert "step" not in [each.name for each in found.differences]
    (leak,) = (each for each in found.differences if each.name == "light leak")
    assert leak.high - leak.low > 1e-5 and "⁻" not in leak.relative_text
    assert "pixels, without 1 that" in found.differences[0].unit


@pytest.mark.parametrize(("factor", "told"), [(1e4, "times as many"), (1 / 30, "1/28 as many")])
def test_light_that_is_far_from_the_stated_one_is_told_by_its_factor(factor, told):
    camera = COUNTS._replace(levels=((1e-3, 0.0, 900), (1e-3, 1e6 / max(factor, 1), 900)))
    found = compared(3, camera, light=lambda *_: np.full((1, 1, 1), factor))
    assert said(found) == {"light"} and told in found.sentence
    # 0.4 · 10⁶ events per second, each followed by 50 ns
    assert factor < 1 or 9000 < float(found.sentence.split("but ")[1].split(" times")[0]) < 10_100
    assert "photons per second on a pixel" in found.sentence


def test_a_warm_camera_in_dim_light_has_dark_counts_and_no_wrong_light():
    camera = COUNTS._replace(levels=((1e-2, 0.0, 90), (1e-2, 100.0, 90)))
    dark_hz = draw_fixed_pattern(camera.sensor, camera.shape).dark_counts_hz
    assert "light" not in said(compared(3, camera, extra=lambda *_: 14 * dark_hz[None]))


@pytest.mark.slow
def test_sizes_are_those_that_were_made():
    found = compared(4, **CODES["afterpulsing"][1]).causes[0]
    # 0.05 carriers, known to about 3 %: five standard errors
    assert found.captured == pytest.approx(0.05, abs=0.0075)
    assert "at a delay of" in str(found)
    found = compared(4, **CODES["read noise ×2"][1]).causes[0]
    # noise of 2 mV and rounding by 0.81 mV/√12 over 1 mV and that: 1.97; known to 4 %
    assert found.captured / found.expected == pytest.approx(1.97, abs=0.2)
    for name in ("step", "efficiency"):  # by 10 and 20 %
        (cause,) = compared(2, **CODES[name][1]).causes
        assert cause.relative == pytest.approx(0.1 * (1 + (name == "efficiency")), abs=0.06)


@pytest.mark.parametrize("kind", [pytest.param("counts", marks=pytest.mark.slow), "bits"])
def test_counts_and_bits_are_compared_likewise(kind):
    camera = CAMERAS[kind]
    assert not compared(2, camera).alarms
    for name in ("dead row", "mirrored columns", "efficiency"):
        wanted, how = FAULTS[kind][name]
        assert wanted in said(compared(2, camera, **how)) <= {wanted, "none"}


def test_of_two_faults_both_are_named():
    one, other = CODES["flicker 60 Hz"], CODES["dead row"]
    assert said(compared(2, **together(one[1], other[1]))) == {one[0], other[0]}


@pytest.mark.slow
def test_rates_over_seeds():
    assert compared(1).sentence.startswith("Captured and simulated frames agree: no difference is")
    untouched = sum(bool(compared(seed).alarms) for seed in range(100, 120))
    # 5 % allowed; at the stated 1 %, 6 or more of 20 have a chance below 1e-6
    assert untouched < 6
    wrong, silent, seeds = Counter(), Counter(), range(100, 103)
    for name, (wanted, how) in CODES.items():
        for seed in seeds:
            found = said(compared(seed, **how))
            wrong[name] += bool(found - {wanted, "none"})
            silent[name] += not found
    total = len(seeds) * len(CODES)
    assert wrong.total() <= 0.02 * total, {name for name in wrong if wrong[name]}
    assert silent.total() <= 0.05 * total, {name for name in silent if silent[name]}


FROM = np.s_[200:]
COMPOSED = {
    "lost rows": ({"lost parts"}, lambda r: _put(r, np.s_[::20, 8:16], 0)),
    "old rows": ({"lost parts"}, lambda r: _put(r, np.s_[20::20, 8:16], r[19:-1:20, 8:16])),
    "clipped": ({"capacity"}, lambda r: np.minimum(r, 22)),
    "wrapped": ({"capacity"}, lambda r: r % 16),
    "multiples": ({"lost bits"}, lambda r: r // 4 * 4),
    "bit of a column": ({"stuck bit"}, lambda r: _put(r, np.s_[:, :, 3], r[:, :, 3] | 8)),
    "copied columns": ({"copied columns"}, lambda r: _put(r, np.s_[:, :, 1::2], r[:, :, ::2])),
    "odd frames": ({"odd frames"}, lambda r: _put(r, np.s_[7::25], r[7::25] // 2)),
    "odd block": ({"odd block"}, lambda r: _put(r, np.s_[:, :8, :8], r[:, :8, :8] + 2)),
    "rows from a frame on": ({"copied rows"}, lambda r: _put(r, np.s_[200:, 3:6], r[200:, 4:7])),
    "turned from a frame on": (set(), lambda r: _put(r, FROM, r[FROM, ::-1])),
}
"""What may be named beside "none", and how readings are spoiled"""


def _put(readings, place, values):
    readings = readings.copy()
    readings[place] = values
    return readings


@pytest.mark.slow
@pytest.mark.parametrize("name", COMPOSED)
def test_composed_faults_are_named_or_none(name):
    names, spoil = COMPOSED[name]
    camera = CAMERAS["counts"]._replace(shape=(16, 16))
    found = compared(3, camera, spoil=of_readings(lambda readings, _: spoil(readings)))
    assert said(found) and said(found) <= names | {"none"}
    assert not names or names <= said(found)
    assert found.sentence.startswith("Captured and simulated frames differ")


def test_a_scale_of_light_and_dark_is_exposure():
    camera = CAMERAS["counts"]._replace(shape=(16, 16))
    longer = {"light": lambda *_: np.full((1, 1, 1), 1.2)}
    dark_hz = draw_fixed_pattern(camera.sensor, camera.shape).dark_counts_hz
    longer["extra"] = lambda *_: 0.2 * dark_hz[None]
    assert said(compared(5, camera, **longer)) == {"exposure"}


def running_mean(readings, _):
    both = np.add(readings[1:], readings[:-1], dtype=np.int64)
    return np.concatenate((readings[:1], (both + 1) // 2))


def lagging(readings, _):
    """A twentieth of the counts of every frame appear in the next."""
    late = np.random.default_rng(3).binomial(readings[:-1], 0.05)
    return np.concatenate((readings[:1], readings[1:] + late))


@pytest.mark.parametrize(
    ("camera", "spoil"),
    [*((each, running_mean) for each in ("codes", "counts", "bits")), ("counts", lagging)],
)
def test_frames_that_depend_on_those_before_quieten_tests_that_assume_none(camera, spoil):
    camera = CAMERAS[camera]._replace(shape=(16, 16))
    found = compared(1, camera, spoil=of_readings(spoil))
    assert said(found) == {"lag"}
    assert len(found.alarms) == 1 and "correlated by" in found.sentence


@pytest.mark.parametrize("value", [0, 1, 100])
def test_an_array_without_a_working_pixel_is_compared(value):
    camera = CAMERAS["counts"]._replace(shape=(8, 8))
    found = compared(1, camera, **written(np.s_[:], value))
    assert found.alarms and not found.causes


def test_frames_that_never_change_on_either_side_are_refused():
    levels = recorded(CAMERAS["counts"]._replace(shape=(8, 8)), 1, **written(np.s_[:], 3))
    with pytest.raises(ValueError, match="counters are full or empty; capture with another light"):
        compare_levels(levels, levels, Model(preset("spadcam"), []))


def test_frames_all_at_the_counters_end_are_no_repetition():
    camera = CAMERAS["counts"]._replace(shape=(8, 8))
    found = compared(1, camera, **written(np.s_[:], lambda counts: np.minimum(counts, 3)))
    assert "repeated frames" not in said(found)


def test_crosstalk_of_the_known_kernel_is_found_with_its_size():
    shares = {"distance_two": 0.5, "distance_three": 1.0}
    known = changed(preset("ideal"), crosstalk={"mean_fired_neighbors": 0.02, **shares})
    camera = CAMERAS["counts"]._replace(sensor=known, shape=(24, 24), levels=((1e-3, 7.5e4, 900),))
    found = compared(1, camera, sensor={"crosstalk": {"mean_fired_neighbors": 0.12}})
    assert found.explained.accepted[0].names == ("crosstalk",)
    # known to about 4 %, five of which; means, variances and covariances agree
    assert found.causes[0].captured == pytest.approx(0.12, rel=0.2)


def test_a_composed_fault_is_named_and_an_identical_device_raises_no_alarm(monkeypatch):
    _, levels, dead_s = composed.CAMERAS["bits"]
    monkeypatch.setitem(composed.CAMERAS, "bits", ((24, 24), levels, dead_s))
    assert not composed.compared("bits", (), 0, 3).alarms
    fault = Recipe("bits", "noise of rows")
    assert composed.verdict((fault,), 2, 3)[0] == "right"


@pytest.mark.slow
def test_identical_devices_raise_no_alarm():
    alarms = sum(
        bool(composed.compared(list(composed.CAMERAS)[seed % 3], (), 0, seed).alarms)
        for seed in range(9)
    )
    # at the stated 1 %, 4 or more of 9 have a chance of 1.2e-6, 5 or more of 1.2e-8
    assert alarms < 5


@pytest.mark.slow
def test_composed_faults_are_named_or_left_unexplained():
    outcomes = Counter(
        composed.verdict((composed.compose(seed, reserved=False),), seed % 3, seed)[0]
        for seed in range(16)
    )
    # at 95 % right or none, 8 or fewer of 16 have a chance below 1e-6; at 2 % wrong, 6 or more
    assert outcomes["right"] + outcomes["none"] > 8, outcomes
    assert outcomes["wrong"] < 6, outcomes
