import hashlib
import io
import pickle

import numpy as np
import pytest
import yaml

from megalopta import sensor as sensors
from megalopta.sensor.spad.device import draw_fixed_pattern

SHAPE = (6, 9)
RNG = np.random.default_rng(0)
MAPS = {
    "dark_counts": RNG.uniform(0, 500, SHAPE),
    "efficiency": RNG.uniform(0.8, 1.2, SHAPE),
    "breakdown": RNG.normal(0, 0.04, SHAPE),
}


@pytest.fixture
def folder(tmp_path):
    for name, values in MAPS.items():
        np.save(tmp_path / f"{name}.npy", values)
    write(tmp_path, {"preset": "spadcam", "name": "mine", "measured": maps(*MAPS)})
    return tmp_path


def maps(*names):
    return {name: {"path": f"{name}.npy"} for name in names}


def write(folder, values):
    (folder / "device.yaml").write_text(yaml.safe_dump(values))


def load(folder):
    return sensors.load_sensor(folder / "device.yaml")


@pytest.mark.parametrize("measured", [("dark_counts", "efficiency"), tuple(MAPS)])
@pytest.mark.parametrize("sigma", [0, 0.042])
def test_at_the_reference_bias_a_device_is_as_measured(folder, measured, sigma):
    bias = {"breakdown_sigma_v": sigma}
    write(folder, {"preset": "spadcam", "measured": maps(*measured), "bias": bias})
    device = draw_fixed_pattern(load(folder), SHAPE)
    np.testing.assert_array_equal(device.dark_counts_hz, MAPS["dark_counts"])
    np.testing.assert_array_equal(device.efficiency_factor, MAPS["efficiency"])


def test_record_of_a_measured_device_carries_its_hashes_and_survives_json(folder):
    sensor = load(folder)
    content = (folder / "breakdown.npy").read_bytes()
    assert sensor.measured.breakdown.sha256 == hashlib.sha256(content).hexdigest()
    assert type(sensor).model_validate_json(sensor.model_dump_json()) == sensor


def with_fit(folder, fit):
    write(folder, {"preset": "spadcam", "measured": {**maps(*MAPS), "fit": fit}})
    return load(folder)


@pytest.mark.parametrize(
    ("fit", "window"), [("top_left", np.s_[:3, :4]), ("center", np.s_[1:4, 2:6])]
)
def test_a_window_of_a_larger_device_is_used_where_it_is_asked_for(folder, fit, window):
    device = draw_fixed_pattern(with_fit(folder, fit), (3, 4))
    np.testing.assert_array_equal(device.dark_counts_hz, MAPS["dark_counts"][window])
    np.testing.assert_array_equal(device.efficiency_factor, MAPS["efficiency"][window])


def saved(values, **options):
    file = io.BytesIO()
    np.save(file, values, **options)
    return file.getvalue()


GOOD = saved(MAPS["dark_counts"])


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (saved(np.full(SHAPE, -1.0)), "below 0 or not finite"),
        (saved(np.full(SHAPE, np.nan)), "below 0 or not finite"),
        (saved(np.full(SHAPE, {}, object), allow_pickle=True), "plain numbers"),
        (saved(np.ones((*SHAPE, 1))), r"\(rows, columns\) of plain numbers"),
        (pickle.dumps(MAPS["dark_counts"]), "plain numbers"),
        (b"", "plain numbers"),
        (GOOD[:-1], "plain numbers"),
    ],
)
def test_impossible_map_is_refused_in_one_sentence(folder, content, message):
    (folder / "dark_counts.npy").write_bytes(content)
    with pytest.raises(ValueError, match=rf"measured\.dark_counts: .*{message}") as refusal:
        draw_fixed_pattern(load(folder), SHAPE)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"preset": "spadcam", "exposure": 1}, "exposure: unknown key; did you mean .exposure_s"),
        ({"name": "mine"}, "pitch_m: missing"),
        ({"preset": "spadcam", "measured": {"dark_counts": 5}}, "5 is not a file; give the path"),
        ({"preset": "spadcam", "measured": {"dark_counts": ".", "fit": "exact"}}, "cannot be read"),
        ({"preset": "spadcam", "measured": {"dark_counts": "a\0b"}}, "is not in the folder"),
        ({"preset": "spadcam", "efficiency": {"path": "none.csv"}}, "efficiency: .*no such file"),
    ],
)
def test_impossible_device_is_refused_in_one_sentence(folder, values, message):
    write(folder, values)
    with pytest.raises(ValueError, match=message) as refusal:
        sensors.load_sensor(str(folder / "device.yaml"))
    assert "\n" not in str(refusal.value)


HOT = r"dark_counts in Hz: .*; lower it, its spread, bias\.excess_v .*celsius"
PERFECT = {"wavelengths_nm": (400, 700), "values": (0.95, 0.95)}
WARM = {"celsius": 40, "breakdown_v_per_k": 0.02}


@pytest.mark.parametrize(
    ("name", "changes", "message"),
    [
        ("spadcam", {"bias": {"excess_v": 100.0}}, HOT),
        ("spadcam", {"temperature": {"celsius": 500.0, "dcr_doubling_k": 1e-3}}, HOT),
        ("spadcam", {"efficiency": PERFECT}, r"efficiency: 1\.\d+ in the worst pixel; lower"),
        ("ideal", {"temperature": WARM}, r"temperature\.breakdown_v_per_k: 0\.02, but nothing"),
    ],
)
def test_impossible_pixels_are_refused_with_what_makes_them(name, changes, message):
    with pytest.raises(ValueError, match=message):
        draw_fixed_pattern(sensors.changed(sensors.preset(name), **changes), (64, 64))


def test_maps_of_avalanche_effects_are_factors_on_their_fields(tmp_path):
    rng = np.random.default_rng(5)
    factors = {name: rng.uniform(0.8, 1.2, (4, 5)) for name in ("dead_time", "crosstalk")}
    for name, values in factors.items():
        np.save(tmp_path / f"{name}.npy", values)
    files = {name: {"path": str(tmp_path / f"{name}.npy")} for name in factors}
    sensor = sensors.changed(
        sensors.preset("ideal"),
        dead_time={"kind": "nonparalyzable", "dead_time_s": 1e-6, "mismatch_sigma": 0.3},
        crosstalk={"mean_fired_neighbors": 0.1},
        measured=files,
    )
    maps = draw_fixed_pattern(sensor, (4, 5)).avalanches
    np.testing.assert_array_equal(maps.dead_time, factors["dead_time"])
    np.testing.assert_array_equal(maps.crosstalk, factors["crosstalk"])
    assert (maps.afterpulsing == 1).all()
    with pytest.raises(ValueError, match=r"measured\.crosstalk: a map of factors on crosstalk"):
        sensors.changed(sensor, crosstalk={"mean_fired_neighbors": 0})


LARGER = r"has 6 × 9, the image \d × \d .*set measured\.fit to top_left or center"
SMALLER = r"has 6 × 9, the image .*lower camera\.height"


@pytest.mark.parametrize(
    ("fit", "shape", "message"),
    [("exact", (3, 4), LARGER), ("exact", (9, 6), SMALLER), ("center", (6, 10), SMALLER)],
)
def test_map_that_does_not_fit_is_refused_with_what_helps(folder, fit, shape, message):
    with pytest.raises(ValueError, match=message):
        draw_fixed_pattern(with_fit(folder, fit), shape)


@pytest.mark.parametrize(
    ("name", "field", "times"),
    [("step", "step_v", 1), ("leak", "leaked_v", 0.5), ("offset", "offset_v", 1)],
)
def test_a_map_is_what_the_counters_have(tmp_path, name, field, times):
    values = np.linspace(5e-3, 2e-2, 12).reshape(3, 4)
    np.save(tmp_path / "map.npy", values)
    maps = {name: str(tmp_path / "map.npy")}
    sensor = sensors.changed(sensors.preset("spadcam"), measured=maps, exposure_s=0.5)
    counters = draw_fixed_pattern(sensor, (3, 4)).counters
    np.testing.assert_allclose(getattr(counters, field), times * values)
    np.save(tmp_path / "map.npy", np.zeros((3, 4)) - (name != "step") * np.inf)
    with pytest.raises(ValueError, match=rf"measured\.{name}"):
        draw_fixed_pattern(sensor, (3, 4))


def with_stuck(folder, capacity=255):
    readings = np.full(SHAPE, -1)
    readings[1, 2], readings[3, 8] = 0, 100 if capacity > 100 else 1
    np.save(folder / "stuck.npy", readings)
    counter = {"kind": "digital", "capacity": capacity}
    write(folder, {"preset": "ideal", "counter": counter, "measured": maps("stuck")})
    return load(folder)


def test_stuck_pixels_read_the_same_in_every_frame(folder):
    sensor = with_stuck(folder)
    rate = np.full((5, *SHAPE), 1e3)
    counts = sensors.expose_rate(rate, sensor, seed=1, stream="stuck").counts
    np.testing.assert_array_equal(counts[:, 1, 2], 0)
    np.testing.assert_array_equal(counts[:, 3, 8], 100)
    mean, variance = sensors.reading_moments(rate, sensor)
    assert (mean[0, 3, 8], variance[0, 3, 8]) == (100, 0)
    working = sensors.changed(sensor, measured={"stuck": None})
    all_work = sensors.expose_rate(rate, working, seed=1, stream="stuck").counts
    works = np.delete(np.arange(counts[0].size), [1 * 9 + 2, 3 * 9 + 8])
    np.testing.assert_array_equal(
        *(frames.reshape(5, -1)[:, works] for frames in (counts, all_work))
    )


def test_stuck_bits_are_those_of_every_binary_frame(folder):
    sensor = with_stuck(folder, capacity=1)
    packed = sensors.expose_binary(np.full((9, *SHAPE), 50.0), sensor, seed=1, stream="stuck")
    bits = np.unpackbits(packed, axis=-1)
    assert bits[:, 1, 2].max() == 0
    assert bits[:, 3, 8].min() == 1
    assert 0 < bits[:, 0].mean() < 1


@pytest.mark.parametrize("reading", [256, 1e30, 2.5, -0.5])
def test_readings_that_a_counter_cannot_have_are_refused(folder, reading):
    sensor = with_stuck(folder)
    np.save(folder / "stuck.npy", np.full(SHAPE, reading))
    unchecked = sensors.changed(sensor, measured={"stuck": str(folder / "stuck.npy")})
    with pytest.raises(ValueError, match=r"measured\.stuck: .* no reading of this counter; give"):
        sensors.expose_rate(np.full((1, *SHAPE), 1e3), unchecked, seed=1, stream="stuck")


def test_another_fill_factor_than_that_of_a_calibrated_efficiency_is_refused(folder):
    device = {"preset": "ideal", "name": "mine", "fill_factor": 0.3}
    of_map = {"path": "efficiency.npy", "fill_factor": 0.3}
    write(folder, {**device, "measured": {"efficiency": of_map}})
    assert load(folder).measured.efficiency.fill_factor == 0.3
    write(folder, {**device, "measured": {"efficiency": {**of_map, "fill_factor": 1.0}}})
    with pytest.raises(
        ValueError, match="fill_factor: 0.3, but measured.efficiency was calibrated"
    ):
        load(folder)
