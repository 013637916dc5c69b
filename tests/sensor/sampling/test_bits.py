import numpy as np
import pytest

from megalopta.sensor import (
    Crosstalk,
    DarkCounts,
    DeadTime,
    Gate,
    changed,
    expose_binary,
    expose_rate,
    preset,
)
from megalopta.sensor.sampling.poisson import (
    CHANCE_ERROR,
    chance,
    fill_bits,
    unpack,
)
from megalopta.sensor.sampling.streams import generator, word_streams
from megalopta.sensor.spad.counters import DigitalCounter

IDEAL = preset("ideal")


def draw_binary(rng, means):
    packed = np.empty((means.shape[0], -(-means.shape[1] // 8)), np.uint8)
    fill_bits(word_streams(rng), means, np.zeros_like(means), 1.0, packed)
    return packed


def test_chance_is_as_close_as_it_says():
    means = np.concatenate([np.linspace(0, 20, 20_000), np.logspace(-9, 3, 1000)]).astype("f4")
    error = [float(chance(mean)) + np.expm1(-float(mean)) for mean in means]
    assert np.abs(error).max() < CHANCE_ERROR


@pytest.mark.slow
@pytest.mark.parametrize("p", [0.0, 1e-4, 0.3, 1 - 1e-4, 1.0])
def test_ones_come_with_their_probability(p):
    mean = -np.log1p(-p) if p < 1 else np.inf
    bits = unpack(draw_binary(generator(3), np.full((1000, 1003), mean)), 1003)
    # 5 standard errors: false alarm 6e-7
    assert abs(bits.mean() - p) <= 5 * np.sqrt(p * (1 - p) / bits.size)


def test_probability_finer_than_the_sixteen_bits_of_a_lot_is_kept():
    p = 0.4 / 65536
    means = np.full((1000, 1000), -np.log1p(-p))
    ones = sum(int(unpack(draw_binary(generator(k), means), 1000).sum()) for k in range(20))
    assert abs(ones - 2e7 * p) < 5 * np.sqrt(2e7 * p)  # false alarm 6e-7


def test_packing_is_that_of_numpy_along_the_width_most_significant_bit_first():
    pattern = np.random.default_rng(0).integers(0, 2, (5, 21)).astype(float)
    packed = draw_binary(generator(0), np.where(pattern == 1, np.inf, 0.0))
    np.testing.assert_array_equal(packed, np.packbits(pattern.astype(np.uint8), axis=-1))


@pytest.mark.slow
def test_bits_agree_with_a_counter_of_one_bit():
    sensor = changed(
        IDEAL,
        counter=DigitalCounter(capacity=1),
        dark_counts=DarkCounts(bulk_mean_hz_um2=1e-3),
        dead_time=DeadTime(kind="paralyzable", dead_time_s=1e-3),
    )
    rate = np.full((40, 50, 50), 8.0)
    bits = unpack(expose_binary(rate, sensor, seed=1, stream="a"), 50)
    counts = expose_rate(rate, sensor, seed=1, stream="a").counts
    error = np.sqrt((bits.var() + counts.var()) / bits.size)
    assert abs(bits.mean() - counts.mean()) < 5 * error  # false alarm 6e-7


def test_bits_are_ones_as_often_as_the_open_gate_lets_them():
    gate = Gate(period_s=1e-2, width_s=2e-3, phase_s=5e-3)
    sensor = changed(IDEAL, gate=gate)
    bits = unpack(expose_binary(np.full((40, 50, 50), 30.0), sensor, seed=1, stream="a"), 50)
    p = 1 - np.exp(-30.0 * 10 * 2e-3)  # ten openings in 0.1 s
    assert abs(bits.mean() - p) < 5 * np.sqrt(p * (1 - p) / bits.size)  # false alarm 6e-7


def test_frames_have_the_same_bytes_drawn_alone_or_among_others():
    rate = np.random.default_rng(0).uniform(0, 20, (30, 9, 13))
    whole = expose_binary(rate, IDEAL, seed=0, stream="s")
    alone = expose_binary(rate[11:12], IDEAL, seed=0, stream="s", first_frame=11)
    assert whole[11].tobytes() == alone[0].tobytes()


@pytest.mark.parametrize(
    ("update", "message"),
    [
        ({"crosstalk": Crosstalk(mean_fired_neighbors=0.1)}, "crosstalk"),
        (
            {"dead_time": DeadTime(kind="paralyzable", dead_time_s=1e-6, start="stationary")},
            "start live",
        ),
    ],
)
def test_bits_that_depend_on_more_than_the_rate_are_refused(update, message):
    with pytest.raises(ValueError, match=message):
        expose_binary(np.ones((1, 2, 2)), changed(IDEAL, **update), seed=0, stream="s")
