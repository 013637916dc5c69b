"""Histograms of photon times: closed forms, an event-by-event simulation, and its inverse."""

import numpy as np
import pytest
from scipy.stats import chi2, exponnorm, kstest, norm

from megalopta import sensor as sensors
from megalopta.sensor.effects.timing import sorted_in_time, stamp
from megalopta.sensor.histograms import periods

from ..plainest import brute_force_events

LASER = {"bins": 100, "period_s": 20e-9, "pulse_sigma_s": 0.1e-9, "decay_s": 3e-9, "delay_s": 2e-9}
RESPONSE = {"sigma_s": 0.2e-9, "tail_share": 0.3, "tail_s": 0.5e-9}
TCSPC = sensors.changed(sensors.preset("ideal"), exposure_s=1e-3, tcspc=LASER, jitter=RESPONSE)


def rate_of(photons_per_period, sensor=TCSPC, shape=(1, 1, 1)):
    return np.full(shape, photons_per_period / sensor.tcspc.period_s)


def agree(seen, expected):
    """Seen numbers are Poisson about expected ones: a false alarm at 1e-6."""
    used = expected > 10
    square = float(((seen - expected)[used] ** 2 / expected[used]).sum())
    return used.sum() > 20 and chi2.sf(square, used.sum()) > 1e-6


def test_faint_light_is_pulse_decay_and_response_convolved():
    rng, number = np.random.default_rng(1), 2_000_000
    times = 2e-9 + np.hypot(0.1e-9, 0.2e-9) * rng.standard_normal(number)
    times += rng.exponential(3e-9, number) + (rng.random(number) < 0.3) * rng.exponential(
        0.5e-9, number
    )
    seen = np.histogram(times % 20e-9, 100, (0, 20e-9))[0]
    mean = sensors.mean_histograms(rate_of(1e-6), TCSPC)[0, 0, 0]
    assert agree(seen, number * mean / mean.sum())


@pytest.mark.parametrize("photons", [0.01, 1.0, 5.0])
def test_pile_up_of_constant_light_is_exponential(photons):
    sensor = sensors.changed(
        TCSPC, tcspc={"pulsed_share": 0.0}, jitter={"sigma_s": 0, "tail_share": 0}
    )
    chances = sensors.mean_histograms(rate_of(photons, sensor), sensor)[0, 0, 0] / periods(sensor)
    ends = np.arange(101) / 100
    np.testing.assert_allclose(chances, -np.diff(np.exp(-photons * ends)), rtol=1e-9)


def test_every_pixel_has_the_delay_of_its_own():
    later = np.array([[[0.0, 3.21e-9, 18.9e-9], [40.1e-9, 1e-9, np.inf]]])
    sensor = sensors.changed(TCSPC, tcspc={"from_camera": True})
    late = sensors.mean_histograms(rate_of(1.0, shape=later.shape), sensor, later)
    for place in np.ndindex(2, 3):
        delay_s = later[0][place]
        fixed = {"pulsed_share": 0.0} if np.isinf(delay_s) else {"delay_s": 2e-9 + delay_s}
        alone = sensors.mean_histograms(rate_of(1.0), sensors.changed(TCSPC, tcspc=fixed))[0, 0, 0]
        # between parts of a bin the pulse is a mixture: 1 % of its steepest bins
        np.testing.assert_allclose(late[0][place], alone, atol=0.01 * alone.max(), rtol=1e-3)


def test_a_pulse_without_width_falls_into_the_bin_of_its_delay():
    bare = {"pulse_sigma_s": 0, "decay_s": 0, "delay_s": 0, "from_camera": True}
    sensor = sensors.changed(TCSPC, tcspc=bare, jitter=sensors.Jitter())
    later = np.array([[[0.05e-9, 0.25e-9, 19.99e-9, 20.3e-9]]])  # bins of 0.2 ns
    drawn = sensors.expose_histograms(
        rate_of(0.5, shape=later.shape), sensor, seed=1, stream="a", later_s=later
    )
    assert drawn[0, 0].argmax(axis=-1).tolist() == [0, 1, 99, 1]
    assert (np.sort(drawn[0, 0], axis=-1)[:, :-1] == 0).all()


@pytest.mark.parametrize(("is_from_camera", "later"), [(True, None), (False, np.zeros((1, 1, 1)))])
def test_delays_belong_to_a_source_at_the_camera(is_from_camera, later):
    sensor = sensors.changed(TCSPC, tcspc={"from_camera": is_from_camera})
    with pytest.raises(ValueError, match=r"tcspc\.from_camera: .* needs later_s"):
        sensors.mean_histograms(rate_of(1.0), sensor, later)


def test_first_photons_of_simulated_pulses_have_the_same_histogram():
    rng, pulses, pixels, period_s = np.random.default_rng(2), 100_000, 3, 20e-9
    sensor = sensors.changed(TCSPC, exposure_s=period_s * pulses, tcspc={"pulsed_share": 0.8})
    number = rng.poisson(0.9 * pulses, pixels)
    pixel = np.repeat(np.arange(pixels), number)
    late = 2e-9 + 0.1e-9 * rng.standard_normal(pixel.size) + rng.exponential(3e-9, pixel.size)
    late = np.where(
        rng.random(pixel.size) < 0.8, late % period_s, period_s * rng.random(pixel.size)
    )
    times = period_s * rng.integers(pulses, size=pixel.size) + late
    sorted_times = sorted_in_time(times, pixel, pixels, sensor.tcspc)
    plain = sensors.changed(sensor, jitter={"sigma_s": 0, "tail_share": 0})
    mean = sensors.mean_histograms(rate_of(0.9, shape=(1, 1, pixels)), plain)[0, 0]
    assert sorted_times.sum() < 0.7 * pixel.size  # pile-up
    assert agree(sorted_times.sum(axis=0), mean.sum(axis=0))
    # stamps scatter after the first avalanche is chosen
    stamps = period_s * (np.arange(100) + rng.random((pixels, 1))) / 100
    moved = np.repeat(np.broadcast_to(stamps, sorted_times.shape).ravel(), sorted_times.ravel())
    moved = moved + 0.2e-9 * rng.standard_normal(moved.size)
    moved += (rng.random(moved.size) < 0.3) * rng.exponential(0.5e-9, moved.size)
    seen = np.histogram(moved % period_s, 100, (0, period_s))[0]
    blurred = sensors.mean_histograms(rate_of(0.9, shape=(1, 1, pixels)), sensor)[0, 0].sum(axis=0)
    # counting makes 0.8 · √(100/170 000) = 1.9 %, stamps spread evenly over a bin less than that
    assert np.abs(seen - blurred).sum() < 0.03 * blurred.sum()


def test_drawn_histograms_have_the_stated_mean_and_variance():
    shape = (3, 40, 50)
    drawn = sensors.expose_histograms(rate_of(0.5, shape=shape), TCSPC, seed=1, stream="a")
    mean = sensors.mean_histograms(rate_of(0.5), TCSPC)[0, 0, 0]
    variance = mean * (1 - mean / periods(TCSPC))
    seen, many = drawn.reshape(-1, 100), 6000
    # 100 bins: five standard errors have a chance of 6e-5, six of 2e-7
    assert (np.abs(seen.mean(axis=0) - mean) < 6 * np.sqrt(variance / many)).all()
    assert (np.abs(seen.var(axis=0) / variance - 1) < 6 * np.sqrt(2 / many)).all()
    again = sensors.expose_histograms(
        rate_of(0.5, shape=shape)[1:2], TCSPC, seed=1, stream="a", first_frame=1
    )
    np.testing.assert_array_equal(again[0], drawn[1])


def test_bins_of_faint_light_add_up_to_its_counts():
    rate = rate_of(1e-4, shape=(5, 20, 20))
    drawn = sensors.expose_histograms(rate, TCSPC, seed=1, stream="a")
    counts = sensors.expose_rate(rate, TCSPC, seed=1, stream="a").counts
    # 10 000 photons each, of which pile-up takes 1: six standard errors of the difference
    assert abs(int(drawn.sum()) - int(counts.sum())) < 6 * np.sqrt(2e4)


@pytest.mark.parametrize(
    ("words", "change"),
    [
        ("tcspc.bins", {"tcspc": {"bins": 0}}),
        ("tcspc.period_s: 1; give at most 0.001 s", {"tcspc": {"period_s": 1.0}}),
        ("exposure_s: 0.001; give at most 4e-05 s", {"tcspc": {"period_s": 1e-14}}),
        ("tcspc.decay_s: 1; give at most 2e-06 s", {"tcspc": {"decay_s": 1.0}}),
        ("jitter.tail_s: 1; give at most 2e-06 s", {"jitter": {"tail_s": 1.0}}),
        ("telegraph.share", {"dark_counts": {"bulk_mean_hz_um2": 1}, "telegraph": {"share": 0.1}}),
        ("lag_share", {"lag_share": 0.1}),
    ],
)
def test_sensors_without_histograms_are_refused(words, change):
    with pytest.raises(ValueError, match=words):
        sensors.expose_histograms(
            rate_of(1.0), sensors.changed(TCSPC, **change), seed=1, stream="a"
        )


DEAD = {"kind": "nonparalyzable", "dead_time_s": 47e-9}
TRAPS = {"mean_carriers": 0.2, "delay_s": 30e-9}
FOLLOWED = {
    "dead time of periods": {"dead_time": DEAD},
    "afterpulses and gate": {
        "afterpulsing": TRAPS,
        "gate": {"period_s": 20e-9, "width_s": 12e-9, "phase_s": 11e-9},
    },
    "crosstalk, dead time, gate of its own": {
        "crosstalk": {"mean_fired_neighbors": 0.3},
        "dead_time": {**DEAD, "dead_time_s": 7e-9},
        "gate": {"period_s": 33e-9, "width_s": 20e-9},
    },
    "all": {
        "crosstalk": {"mean_fired_neighbors": 0.2},
        "afterpulsing": TRAPS,
        "dead_time": {**DEAD, "kind": "paralyzable", "dead_time_s": 9e-9},
    },
}


@pytest.mark.slow
@pytest.mark.parametrize("name", FOLLOWED)
def test_histograms_are_those_of_the_plainest_simulation(name):
    bins, pulses, samples, pixels = 10, 40, 4000, 3
    laser = {**LASER, "bins": bins, "pulse_sigma_s": 1e-9, "pulsed_share": 0.8}
    sensor = sensors.changed(
        TCSPC, exposure_s=pulses * 20e-9, tcspc=laser, jitter={"sigma_s": 0, "tail_share": 0},
        **FOLLOWED[name],
    )  # fmt: skip
    light = np.array([0.3, 0.1, 0.6])  # photons per pulse
    drawn = sensors.expose_histograms(
        np.broadcast_to(light / 20e-9, (samples, 1, pixels)), sensor, seed=1, stream="a"
    )
    # light in thirtieths of a bin; of all events, the first of each period
    rng = np.random.default_rng(3)
    late = 2e-9 + 1e-9 * rng.standard_normal(10**7) + rng.exponential(3e-9, 10**7)
    pulse = np.bincount((late % 20e-9 / 20e-9 * 300).astype(int), minlength=300) / 10**7
    shape = (0.8 * pulse * 300 + 0.2) / 20e-9
    rates = np.tile(shape[:, None] * light, (samples, 1, 1))
    events = brute_force_events(rng, rates, 20e-9, sensor, frames=pulses, bins=bins)
    events = events.reshape(samples, pulses, bins, pixels) > 0
    first = events & (events.cumsum(axis=2) == 1)
    plain = first.sum(axis=1).transpose(0, 2, 1)
    for part in ((), (1,), (2,)):  # each bin, sums over bins, over pixels: 43 in all, z < 5.5
        pair = [values.sum(axis=part).reshape(samples, -1) for values in (plain, drawn[:, 0])]
        for moment in (lambda x: x, lambda x: (x - x.mean(axis=0)) ** 2):
            of_plain, of_drawn = (moment(values.astype(float)) for values in pair)
            error = np.sqrt((of_plain.var(axis=0) + of_drawn.var(axis=0)) / samples)
            z = (of_plain.mean(axis=0) - of_drawn.mean(axis=0)) / np.maximum(error, 1e-9)
            assert np.abs(z).max() < 5.5, (part, z)
    again = sensors.expose_histograms(
        np.broadcast_to(light / 20e-9, (1, 1, pixels)), sensor, seed=1, stream="a", first_frame=7
    )
    np.testing.assert_array_equal(again[0], drawn[7])
    if name != "dead time of periods":
        with pytest.raises(ValueError, match="no mean is stated"):
            sensors.mean_histograms(rate_of(1.0), sensor)


@pytest.mark.parametrize("pulse", [{}, {"pulse_sigma_s": 0, "decay_s": 0, "delay_s": 4.1e-9}])
def test_gated_histograms_are_those_of_light_that_meets_an_open_gate(pulse):
    gate = {"period_s": 10e-9, "width_s": 4e-9, "phase_s": 4e-9}
    gated = sensors.changed(TCSPC, tcspc=pulse, gate=gate)
    mean = sensors.mean_histograms(rate_of(1.0), gated)[0, 0, 0]
    # a trap that nothing fills: every photon is drawn
    followed = sensors.changed(gated, afterpulsing={"mean_carriers": 1e-12})
    drawn = sensors.expose_histograms(rate_of(1.0, shape=(1, 10, 10)), followed, seed=1, stream="a")
    assert agree(drawn.sum(axis=(0, 1, 2)), 100 * mean)
    whole = sensors.changed(gated, gate={"width_s": 10e-9, "phase_s": 0})
    open_mean = sensors.mean_histograms(rate_of(1.0), whole)
    np.testing.assert_array_equal(
        open_mean, sensors.mean_histograms(rate_of(1.0), sensors.changed(TCSPC, tcspc=pulse))
    )


def test_decays_and_pulses_that_are_nearly_zero_are_zero():
    def mean(**tcspc):
        sensor = sensors.changed(TCSPC, tcspc=tcspc, jitter={"sigma_s": 0, "tail_share": 0})
        return sensors.mean_histograms(rate_of(0.5), sensor)

    short, none = mean(pulse_sigma_s=1e-9, decay_s=1e-18), mean(pulse_sigma_s=1e-9, decay_s=0)
    np.testing.assert_allclose(short, none, rtol=1e-6, atol=1e-9)
    both = (mean(pulse_sigma_s=1e-9, decay_s=decay_s) for decay_s in (0.99e-14, 1.01e-14))
    np.testing.assert_allclose(*both, rtol=1e-5, atol=1e-5)  # both forms agree
    np.testing.assert_allclose(mean(pulse_sigma_s=1e-320), mean(pulse_sigma_s=0), rtol=1e-9)


SIGMA_S, SHARE, TAIL_S, EVENTS = 50e-12, 0.2, 300e-12, 200_000
JITTER = sensors.Jitter(sigma_s=SIGMA_S, tail_share=SHARE, tail_s=TAIL_S)


def test_stamps_are_a_mixture_of_a_normal_and_an_exponentially_modified_normal():
    late = stamp(np.random.default_rng(2), np.zeros(EVENTS), JITTER) / SIGMA_S
    tailed = exponnorm(TAIL_S / SIGMA_S)

    def mixture(x):
        return (1 - SHARE) * norm.cdf(x) + SHARE * tailed.cdf(x)

    assert kstest(late, mixture).pvalue > 1e-6  # false alarm 1e-6
