"""What a frame keeps of the one before: image lag and incomplete resets, against plain loops."""

import numpy as np
import pytest

from megalopta import sensor as sensors
from megalopta.sensor.expectations import moments
from megalopta.sensor.exposure import draw_frames
from megalopta.sensor.sampling.streams import Draw

IDEAL = sensors.preset("ideal")
ANALOG = {"kind": "analog", "step_v": 0.01, "swing_v": 2.0, "residue_share": 0.15}
CTIA = sensors.changed(
    sensors.CTIA_PRESETS["ctia_si"],
    **{"residue_share": 0.2, "offset_sigma_v": 0.0, "gain_sigma_db": 0.0, "dark_sigma": 0.0},
)
FRAMES, PIXELS = 6, 20_000
LIGHT = np.array([3.0, 60.0, 20.0, 20.0, 0.0, 0.0])


def drawn(sensor, light=LIGHT, pixels=PIXELS):
    rates_hz = np.broadcast_to((light / sensor.exposure_s)[:, None, None], (len(light), 1, pixels))
    exposure, _ = draw_frames(rates_hz, sensor, Draw(5, "memory"))
    stated = moments(rates_hz[..., :1], sensor)
    return exposure.counts[:, 0].astype(np.float64), stated[2][:, 0, 0], stated[3][:, 0, 0]


def agree(seen, expected, error):
    """Within five standard errors: a false alarm in 1.7e6 for each number."""
    return (np.abs(seen - expected) < 5 * error).all()


def test_each_detection_of_lag_comes_late_by_a_geometric_number_of_frames():
    share, rng = 0.3, np.random.default_rng(1)
    light = np.concatenate((np.full(30, LIGHT[0]), LIGHT[1:]))  # steady light before
    plain = np.zeros((len(light) + 40, PIXELS))
    for frame, mean in enumerate(light):
        left = rng.poisson(mean, PIXELS)
        for later in range(40):
            stays = rng.binomial(left, share)
            plain[frame + later] += left - stays
            left = stays
    plain = plain[29 : len(light)]
    seen, mean, variance = drawn(sensors.changed(IDEAL, lag_share=share))
    error = np.sqrt(variance / PIXELS)
    assert agree(plain.mean(axis=1), mean, error) and agree(seen.mean(axis=1), mean, error)
    spread = np.sqrt((2 * variance**2 + variance) / PIXELS)
    assert agree(seen.var(axis=1), variance, spread) and agree(plain.var(axis=1), variance, spread)
    # frames are independent, as two parts of a Poisson number are
    between = np.cov(seen)[np.triu_indices(FRAMES, 1)]
    products = np.sqrt(np.outer(variance, variance)[np.triu_indices(FRAMES, 1)] / PIXELS)
    assert agree(between, 0, products + 1e-9)


def test_lag_keeps_every_detection_and_changes_no_steady_light():
    sensor = sensors.changed(IDEAL, lag_share=0.4)
    light = np.array([0.0, 0.0, 50.0, *np.zeros(40)])
    _, mean, _ = drawn(sensor, light, 1)
    np.testing.assert_allclose(mean.sum(), 50, rtol=1e-12)
    _, steady, _ = drawn(sensor, np.full(3, 7.0), 1)
    np.testing.assert_allclose(steady, 7, rtol=1e-12)


def test_an_incomplete_reset_leaves_a_share_of_the_former_count():
    rng, share, held = np.random.default_rng(2), 0.15, np.zeros(PIXELS)
    seen, mean, variance = drawn(sensors.changed(IDEAL, counter=ANALOG))
    for frame, light in enumerate(LIGHT):
        held = rng.poisson(light, PIXELS) + share * held
        read = np.rint(held)
        noise = np.sqrt((read.var() + 1e-3) * 2 / PIXELS)
        assert agree(seen[frame].mean(), read.mean(), noise)
        fourth = ((read - read.mean()) ** 2).var() + 1e-3
        assert agree(seen[frame].var(), read.var(), np.sqrt(2 * fourth / PIXELS))
        # counters read whole numbers, which moments of few counts neglect
        assert abs(mean[frame] - read.mean()) < 0.2 + 5 * noise
        assert abs(variance[frame] - read.var()) < 0.25 + 5 * np.sqrt(fourth / PIXELS)


def test_a_full_counter_leaves_a_share_of_its_swing():
    light = np.array([2000.0, 0.0, 0.0])
    seen, mean, variance = drawn(sensors.changed(IDEAL, counter=ANALOG), light, 50)
    for values in (*seen.T, mean):
        np.testing.assert_allclose(values, [200, 30, np.rint(30 * 0.15)], atol=0.5)
    np.testing.assert_allclose(variance, 0, atol=1e-9)


def test_a_ctia_pixel_starts_from_a_share_of_its_last_reading():
    full_e = CTIA.swing_v * CTIA.capacitance_f / 1.602176634e-19
    light = full_e * np.array([0.1, 0.9, 0.1, 0.1, 0.0])
    seen, mean, variance = drawn(CTIA, light)
    alone, *_ = drawn(sensors.changed(CTIA, residue_share=0.0), light)
    plain = alone.copy()
    for frame in range(1, len(light)):
        plain[frame] += 0.2 * plain[frame - 1]
    for values in (seen, plain):
        assert agree(values.mean(axis=1), mean, np.sqrt(variance / PIXELS))
        assert agree(values.var(axis=1), variance, variance * np.sqrt(2 / PIXELS))
    # a reading and the one before share noise
    together = [np.cov(values[2], values[1])[0, 1] for values in (seen, plain)]
    assert agree(*together, np.sqrt(2 * variance[1] * variance[2] / PIXELS))


SENSORS = {
    "lag": sensors.changed(IDEAL, lag_share=0.2),
    "lag, dead time": sensors.changed(
        IDEAL, lag_share=0.2, dead_time={"kind": "paralyzable", "dead_time_s": 1e-3}
    ),
    "lag, sums": sensors.changed(IDEAL, lag_share=0.2, counter={"capacity": 3, "sums": 4}),
    "counter": sensors.changed(
        IDEAL,
        counter={**ANALOG, "read_noise_v": 2e-3, "adc_bits": 12},
        afterpulsing={"mean_carriers": 0.1, "delay_s": 1e-3},
    ),
    "CTIA": CTIA,
    "CTIA, aging gate": sensors.CTIA_PRESETS["ctia_ingaas_quiet"],
    "multiplied electrons": sensors.FRAME_PRESETS["ixon-888"],
    "lag of a frame camera": sensors.changed(sensors.FRAME_PRESETS["imx174"], lag_share=0.2),
}


@pytest.mark.parametrize("name", SENSORS)
def test_frames_drawn_in_pieces_are_those_drawn_at_once(name, monkeypatch):
    sensor = SENSORS[name]
    scale = 1e6 if name.startswith("CTIA") else 1.0
    rates_hz = np.random.default_rng(0).uniform(0, 100, (7, 40, 50)) * scale / sensor.exposure_s
    whole, last = draw_frames(rates_hz, sensor, Draw(1, "pieces", 3))
    monkeypatch.setattr("os.cpu_count", lambda: 3)
    state, pieces, stated = None, [], []
    for first, end in ((0, 1), (1, 4), (4, 7)):
        piece, after = draw_frames(
            rates_hz[first:end], sensor, Draw(1, "pieces", 3 + first), state=state
        )
        if name.startswith("lag"):
            stated.append(moments(rates_hz[first:end], sensor, state=state)[2])
        pieces.append(piece.counts)
        state = after
    np.testing.assert_array_equal(np.concatenate(pieces), whole.counts)
    np.testing.assert_equal(state, last)
    if stated:
        np.testing.assert_array_equal(np.concatenate(stated), moments(rates_hz, sensor)[2])


@pytest.mark.parametrize(
    "nothing",
    [
        {"lag_share": 0.0},
        {"counter": {"kind": "digital", "capacity": 15, "sums": 1}},
        {"counter": {**ANALOG, "residue_share": 0.0}},
    ],
)
def test_a_share_of_nothing_is_no_setting(nothing):
    plain = {name: part for name, part in nothing.items() if name != "lag_share"}
    if counter := plain.get("counter"):
        plain["counter"] = {k: v for k, v in counter.items() if k not in ("sums", "residue_share")}
    with_it, without_it = (sensors.changed(IDEAL, **change) for change in (nothing, plain))
    assert with_it.model_dump_json() == without_it.model_dump_json()  # which names random streams


def test_codes_of_an_incomplete_reset_do_not_depend_on_how_many_are_drawn_together():
    sensor = sensors.changed(IDEAL, counter={**ANALOG, "adc_bits": 10})
    rates_hz = np.broadcast_to((LIGHT / sensor.exposure_s)[:, None, None], (FRAMES, 4, 5))
    codes = [
        sensors.expose_adc(rates_hz, sensor, seed=1, stream="s", together=together)
        for together in (1, 4)
    ]
    np.testing.assert_array_equal(*codes)
