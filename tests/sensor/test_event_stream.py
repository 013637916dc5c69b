import numpy as np

from megalopta.sensor import Crosstalk, DeadTime, Jitter, changed, expose_events, preset
from megalopta.sensor.quantities import histogram
from megalopta.sensor.sampling.streams import generator, light_key, sensor_stream
from megalopta.sensor.spad.simulation import simulate_frame

IDEAL = preset("ideal")
RATE = np.random.default_rng(0).uniform(0, 300, (6, 5, 7))


def draw(rate=RATE, sensor=IDEAL, **place):
    return expose_events(rate, sensor, **({"seed": 0, "stream": "s"} | place))


def test_no_two_events_of_a_pixel_are_closer_than_the_dead_time():
    dead_time = DeadTime(kind="nonparalyzable", dead_time_s=1e-3)
    sensor = changed(IDEAL, dead_time=dead_time, crosstalk=Crosstalk(mean_fired_neighbors=0.2))
    events = draw(np.full((2, 4, 4), 2000.0), sensor)
    key = (events.frame * 4 + events.row) * 4 + events.column
    order = np.lexsort((events.time_s, key))
    gaps = np.diff(events.time_s[order])[np.diff(key[order]) == 0]
    assert gaps.size > 1000
    assert gaps.min() >= 1e-3 * (1 - 1e-9)


def test_jitter_moves_time_stamps_and_nothing_else():
    still, shaken = (
        draw(sensor=changed(IDEAL, jitter=jitter)) for jitter in (Jitter(), Jitter(sigma_s=1e-4))
    )
    np.testing.assert_array_equal(histogram(still), histogram(shaken))
    assert np.any(still.time_s != shaken.time_s)


def test_events_of_the_same_time_stay_in_the_order_of_the_simulation():
    # crosstalk fires neighbors at the very time of an avalanche, which comes first
    sensor = changed(IDEAL, crosstalk=Crosstalk(mean_fired_neighbors=0.3))
    rate = np.full((8, 8), 100.0)
    named = sensor_stream("s", sensor, np.zeros_like(rate)), light_key(rate)
    rng = generator(0, "events", *named, 0)
    frame = simulate_frame(rng, rate, sensor.exposure_s, sensor.avalanche_effects)
    times, pixels = frame.times_s, frame.pixels
    order = np.argsort(times, kind="stable")
    assert np.count_nonzero(np.diff(times[order]) == 0) > 20
    events = draw(rate[np.newaxis], sensor)
    np.testing.assert_array_equal(events.pixel, pixels[order])
    np.testing.assert_array_equal(events.time_s, times[order])
