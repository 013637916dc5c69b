import numpy as np
import pytest

from megalopta import sensor as sensors

BANDS = np.array([[400.0, 475.0], [475.0, 550.0], [550.0, 600.0], [620.0, 700.0]])
RNG = np.random.default_rng(0)
RADIANCE = RNG.uniform(0, 2e-9, (40, 12, 15, 4)).astype(np.float32)
SENSORS = {
    "ideal": sensors.preset("ideal"),
    "spadcam": sensors.preset("spadcam"),
    "nonparalyzable": sensors.changed(
        sensors.preset("spadcam"), dead_time={"kind": "nonparalyzable", "dead_time_s": 1e-3}
    ),
}


def expose_frames(sensor, radiance=RADIANCE, **place):
    return sensors.expose(radiance, BANDS, sensor, **({"seed": 0, "stream": "forest"} | place))


def signal_to_noise(sensor, radiance=RADIANCE):
    brighter = sensors.expectation(1.01 * radiance.astype(float), BANDS, sensor)
    return sensors.expectation(radiance, BANDS, sensor).signal_to_noise(brighter, 0.01)


@pytest.mark.parametrize("name", SENSORS)
@pytest.mark.parametrize("frames", [slice(0, 1), slice(5, 29)])
def test_frames_have_the_same_bytes_drawn_alone_or_among_others(name, frames):
    all_frames = expose_frames(SENSORS[name])
    part = expose_frames(SENSORS[name], RADIANCE[frames], first_frame=frames.start)
    assert part.counts.tobytes() == all_frames.counts[frames].tobytes()
    assert part.saturated.tobytes() == all_frames.saturated[frames].tobytes()


def test_same_seed_same_bytes_and_any_other_name_other_counts():
    sensor = SENSORS["ideal"]
    reference = expose_frames(sensor)
    assert expose_frames(sensor).counts.tobytes() == reference.counts.tobytes()
    for name in ({"seed": 1}, {"stream": "grating"}, {"first_frame": 1}):
        assert np.mean(expose_frames(sensor, **name).counts != reference.counts) > 0.5


PIXELS = (4, 80, 80)
CHANGES = [
    ({}, 2.0), ({}, 1.001), ({"exposure_s": 2e-3}, 1), ({"dark_counts": {"bulk_mean_hz_um2": 1e-4}}, 1),
    ({"dead_time": {"kind": "nonparalyzable", "dead_time_s": 1e-7}}, 1), ({"device_seed": 5}, 1),
    ({"crosstalk": {"mean_fired_neighbors": 0.01}}, 1), ({"counter": {"capacity": 4000}}, 1),
    ({"pitch_m": 2e-5}, 1), ({"temperature": {"celsius": 31.0}}, 1),
]  # fmt: skip


def drawn(sensor, factor, how):
    rate = np.full(PIXELS, 20.0 * factor) / sensors.preset("ideal").exposure_s
    read = how(rate, sensor, seed=0, stream="one")
    counts = np.unpackbits(read) if read.__class__ is np.ndarray else read.counts
    return counts.ravel().astype(float)


@pytest.mark.parametrize("how", [sensors.expose_rate, sensors.expose_binary])
@pytest.mark.parametrize(("change", "factor"), CHANGES)
def test_exposures_that_differ_in_anything_are_independent(change, factor, how):
    dim = 0.02 if how is sensors.expose_binary else 1.0
    one = drawn(sensors.preset("ideal"), dim, how)
    changed_counts = drawn(sensors.changed(sensors.preset("ideal"), **change), dim * factor, how)
    # 25,600 pixels or bits: |r|·√n > 5 by chance once in 1.7 million
    assert abs(np.corrcoef(one, changed_counts)[0, 1]) < 5 / np.sqrt(one.size)
    np.testing.assert_array_equal(one, drawn(sensors.preset("ideal"), dim, how))


@pytest.mark.parametrize("name", SENSORS)
def test_expectation_is_the_same_with_and_without_draws_and_at_any_rate(name):
    sensor = SENSORS[name]
    stated = sensors.expectation(RADIANCE, BANDS, sensor)
    beside = expose_frames(sensor, expectation=True).expectation
    assert expose_frames(sensor).expectation is None
    for field, values in vars(stated).items():
        assert values.dtype == np.float64
        np.testing.assert_array_equal(getattr(beside, field), values)
    rate = sensors.detection_rate(RADIANCE, BANDS, sensor)
    np.testing.assert_array_equal(
        sensors.event_moments(rate, sensor), (stated.mean_events, stated.events_variance)
    )
    np.testing.assert_array_equal(
        sensors.reading_moments(rate, sensor), (stated.mean_reading, stated.reading_variance)
    )


def test_photon_rate_is_the_textbook_formula():
    radiance, lower, upper = 1e-6, 500.0, 520.0
    sensor = sensors.Sensor(
        name="textbook",
        pitch_m=10e-6,
        fill_factor=0.5,
        exposure_s=0.01,
        lens={"f_number": 2.0, "transmission": 0.8},
        efficiency={"wavelengths_nm": (400, 700), "values": (0.25, 0.25)},
    )
    irradiance = np.pi * radiance * 0.8 / (4 * 2.0**2 + 1)
    photons = irradiance * 20.0 * 510e-9 / 1.98644586e-25 * 10e-6**2
    arguments = np.full((1, 2, 2, 1), radiance), [(lower, upper)], sensor
    np.testing.assert_allclose(sensors.photon_rate(*arguments), photons, rtol=1e-12)
    np.testing.assert_allclose(sensors.detection_rate(*arguments), photons * 0.5 * 0.25, rtol=1e-12)
    stated = sensors.expectation(*arguments)
    np.testing.assert_allclose(stated.photons, photons * 0.01, rtol=1e-12)
    np.testing.assert_allclose(stated.mean_events, photons * 0.125 * 0.01, rtol=1e-12)


def test_dark_counts_are_noise_and_not_signal():
    sensor = sensors.changed(SENSORS["ideal"], dark_counts={"bulk_mean_hz_um2": 2.0})
    dark = 2.0 * sensor.active_area_m2 * 1e12 * sensor.exposure_s
    signal = sensors.detection_rate(RADIANCE, BANDS, sensor) * sensor.exposure_s
    np.testing.assert_allclose(signal_to_noise(sensor), signal / np.sqrt(signal + dark), rtol=1e-9)


@pytest.mark.parametrize("place", [{"seed": 0.5}, {"stream": None}])
def test_seed_and_sequence_that_name_nothing_are_refused(place):
    with pytest.raises(TypeError, match=r"(0\.5|None) cannot name random numbers; give a whole"):
        expose_frames(SENSORS["ideal"], **place)


NOT_A_NUMBER = np.where(RADIANCE[3, 2, 1, 0] == RADIANCE, np.nan, RADIANCE)


@pytest.mark.parametrize(
    ("light", "message"),
    [
        (NOT_A_NUMBER, r"radiance: .* \[3, 2, 1, 0\]"),
        (-RADIANCE, r"radiance: .* \[0, 0, 0, 0\]"),
        (RADIANCE.astype(complex), "radiance: complex128 values; give real numbers"),
        (np.full((1, 2, 2, 4), 1e30), r"radiance: so bright that a pixel detects \S+ photons"),
        (np.zeros((2, 12, 15, 3)), r"give \(frames, rows, columns, 4\)"),
        (np.full((1, 2, 2), 1e17), r"detections_hz: .* at most 1e\+16 Hz"),
        (np.full((1, 2, 2), np.nan), "detections_hz"),
        (np.zeros((3, 4)), r"give \(frames, rows, columns\)"),
    ],
)
def test_impossible_light_is_refused(light, message):
    with pytest.raises(ValueError, match=message):
        if light.ndim == 4:
            expose_frames(SENSORS["ideal"], light)
        else:
            sensors.expose_rate(light, SENSORS["ideal"], seed=0, stream="x")


def test_a_sensor_by_its_name():
    light, bands, draws = np.full((1, 4, 4, 1), 1e-9), [(500, 600)], {"seed": 0, "stream": "a"}
    named = sensors.expose(light, bands, "spadcam", **draws)
    np.testing.assert_array_equal(
        named.counts, sensors.expose(light, bands, sensors.preset("spadcam"), **draws).counts
    )
    with pytest.raises(ValueError, match="'spadca' is unknown; did you mean 'spadcam'"):
        sensors.expose(light, bands, "spadca", **draws)
