import numpy as np
import pytest

from megalopta.sensor import (
    DarkCounts,
    Telegraph,
    changed,
    event_moments,
    expose_binary,
    expose_events,
    expose_rate,
    preset,
    reading_moments,
)
from megalopta.sensor.effects.base import Frame, FrameRates
from megalopta.sensor.effects.dark_counts import active_traps

DARK = changed(preset("ideal"), dark_counts=DarkCounts(bulk_mean_hz_um2=1.0))
SLOW = Telegraph(share=0.5, step=1.0, traps=2, active_share=0.3, fastest_s=1.0, slowest_s=1.0)


def states(telegraph, frames, period_s, shape=(40, 50)):
    """Active traps (frames, H, W)."""
    rates = FrameRates(np.zeros(shape), np.ones(shape), 0)
    frame = (Frame(number, number * period_s, 12345) for number in range(frames))
    return np.array([active_traps(telegraph, rates, each) for each in frame])


def periodogram(states):
    """Power per frequency bin of the variations of each pixel, mean over the pixels."""
    varying = states - states.mean(0)
    power = np.abs(np.fft.rfft(varying, axis=0)) ** 2 / len(states)
    return power.reshape(len(power), -1).mean(1)[1:]


def sampled_lorentzian(count, period_s, time_s, share):
    """Spectrum of one trap whose state is sampled: that of an autoregressive process."""
    kept = np.exp(-period_s / time_s)
    angle = 2 * np.pi * np.arange(1, count // 2 + 1) / count
    return share * (1 - share) * (1 - kept**2) / (1 - 2 * kept * np.cos(angle) + kept**2)


def test_spectrum_of_a_trap_is_lorentzian():
    one = SLOW.model_copy(update={"share": 1.0, "traps": 1})
    # 2000 pixels: a bin scatters by 2.2 %, a mean over 16 by 0.6 %; the mean that is subtracted
    # takes about a part in 1024/20 of the lowest frequencies
    found = periodogram(states(one, 1024, 0.05))[:512].reshape(-1, 16).mean(1)
    expected = sampled_lorentzian(1024, 0.05, 1.0, 0.3).reshape(-1, 16).mean(1)
    np.testing.assert_allclose(found, expected, rtol=0.05)


def test_many_traps_have_a_spectrum_of_one_over_f():
    many = Telegraph(share=1.0, traps=8, fastest_s=0.1, slowest_s=1000.0)
    found = periodogram(states(many, 2048, 0.5, (20, 25)))
    times_s = np.geomspace(0.1, 1000.0, 4001)
    expected = 8 * np.mean([sampled_lorentzian(2048, 0.5, each, 0.5) for each in times_s], 0)
    middle = slice(20, 500)
    # 500 pixels and 480 bins: 0.2 %; which times the 4000 traps have scatters by a few percent
    assert found[middle].mean() == pytest.approx(expected[middle].mean(), rel=0.1)
    frequency = np.arange(1, 1025)
    slope = np.polyfit(np.log(frequency[middle]), np.log(found[middle]), 1)[0]
    assert slope == pytest.approx(-1, abs=0.1)


def test_traps_are_active_for_their_share_of_the_time_in_their_share_of_pixels():
    active = states(SLOW, 400, 20.0)
    switching = active.any(0)
    # 2000 pixels, 800 000 independent states; 5 standard errors: false alarm 6e-7 each
    assert abs(switching.mean() - 0.5) < 5 * np.sqrt(0.25 / 2000)
    assert abs(active[:, switching].mean() - 0.6) < 5 * np.sqrt(2 * 0.21 / 400 / switching.sum())


@pytest.mark.parametrize("draw", [expose_rate, expose_binary, expose_events])
def test_frames_are_the_same_drawn_alone_or_among_others(draw):
    sensor = changed(DARK, telegraph=SLOW.model_dump(), exposure_s=1e-3)
    rate = np.full((9, 12, 15), 50.0)
    named = {"seed": 3, "stream": "s", "frame_period_s": 0.5}
    whole = draw(rate, sensor, **named)
    alone = draw(rate[5:6], sensor, first_frame=5, **named)
    if draw is expose_rate:
        whole, alone = whole.counts, alone.counts
    elif draw is expose_events:
        whole, alone = whole.time_s[whole.frame == 5][None], alone.time_s[None]
        assert whole.size
        np.testing.assert_array_equal(whole, alone)
        return
    np.testing.assert_array_equal(whole[5], alone[0])


@pytest.mark.parametrize("capacity", [2**32 - 1, 400])
def test_counts_have_the_mean_and_variance_that_are_stated(capacity):
    sensor = changed(
        DARK, telegraph=SLOW.model_dump(), counter={"kind": "digital", "capacity": capacity}
    )
    rate = np.full((2000, 6, 6), 10.0)
    counts = expose_rate(rate, sensor, seed=1, stream="s", frame_period_s=50.0).counts
    mean, variance = (each[0] for each in reading_moments(rate[:1], sensor))
    error = np.sqrt(variance / len(counts))
    assert (np.abs(counts.mean(0) - mean) < 6 * error).all()  # 36 pixels: false alarm 7e-8
    # three or fewer levels of Poisson counts have a kurtosis below 5
    np.testing.assert_allclose(counts.var(0).mean(), variance.mean(), rtol=5 * 2 / np.sqrt(72_000))
    assert event_moments(rate[:1], sensor)[1].max() > 2 * event_moments(rate[:1], DARK)[1].max()


@pytest.mark.parametrize(
    ("sensor", "fields", "said"),
    [
        (DARK, {"fastest_s": 2.0, "slowest_s": 1.0}, "slowest_s: 1 is less than fastest_s 2"),
        (DARK, {"traps": 17}, "traps"),
        (preset("ideal"), {}, r"telegraph\.share: 0\.5.*give dark_counts"),
    ],
)
def test_impossible_traps_are_refused(sensor, fields, said):
    with pytest.raises(ValueError, match=said):
        changed(sensor, telegraph={"share": 0.5, **fields})
