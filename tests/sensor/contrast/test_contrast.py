"""Contrast events against closed forms, and their files."""

from itertools import pairwise

import h5py
import numpy as np
import pytest
from scipy.linalg import expm
from scipy.ndimage import gaussian_filter, shift

from megalopta.core.errors import DamagedFileError
from megalopta.flow import event_flow
from megalopta.sensor import IMAGE_SENSORS, EventOrigin, changed, expose, expose_events
from megalopta.sensor.contrast.model import expose_frames, moments
from megalopta.sensor.formats.events import events_hdf5_writer, read_events
from megalopta.sensor.sampling import streams

NOISELESS = changed(
    IMAGE_SENSORS["davis346"], noise_factor=0, threshold_sigma=0, leak_hz=0, refractory_s=0,
    dark_e_s=1e-3, fastest_s=1e-5, charge_e=10,
)  # fmt: skip
TAU_S, LIGHT_HZ = 1e-3, 1e6
NOISY = changed(NOISELESS, noise_factor=1, fastest_s=TAU_S)
SIGMA = (2 * LIGHT_HZ * TAU_S) ** -0.5


def events(sensor, rates_hz, **draw):
    return expose_events(rates_hz, sensor, **{"seed": 0, "stream": "test", **draw})


def noisy(sigmas, **changes):
    return changed(NOISY, threshold_on=sigmas * SIGMA, threshold_off=sigmas * SIGMA, **changes)


def static(sensor, frames=1, parts=1, side=16, **draw):
    return events(sensor, np.full((frames, parts + 1, side, side), LIGHT_HZ), **draw)


@pytest.mark.parametrize("change", [2.5, -2.5, 0.1999, 0.2001])
def test_a_noiseless_ramp_gives_one_event_for_every_whole_threshold(change):
    rates = 1e8 * np.exp(change * np.array([0.0, 0.5, 1.0, 1.0]))  # time to settle
    shown = events(NOISELESS, np.broadcast_to(rates[:, None, None], (1, 4, 4, 4)))
    whole = int(abs(change) / 0.2)
    assert (np.bincount(shown.pixel, minlength=16) == whole).all()
    assert (shown.polarity == (change > 0)).all()
    if whole > 1:  # rate = |d ln λ/dt| / θ
        apart_s = np.diff(shown.time_s[shown.pixel == 3])
        assert apart_s == pytest.approx(0.2 / abs(change) * 0.01 * 2 / 3, rel=1e-3)


def exact_on_rate(sigmas):
    """ON events per τ: hitting chances and mean exit times between barriers a threshold apart."""
    fine = np.linspace(0, 14, 14001)
    scale = np.append(0, np.cumsum(np.exp(((fine[1:] + fine[:-1]) / 2) ** 2 / 2) * 1e-3))
    places = sigmas * np.arange(-int(7 / sigmas), int(7 / sigmas) + 1)
    up, time = [], []
    for low, start, high in zip(places - sigmas, places, places + sigmas, strict=True):
        inside = np.linspace(low, high, 4001)
        at = [np.sign(x) * np.interp(np.abs(x), fine, scale) for x in (low, start, high, inside)]
        up.append((at[1] - at[0]) / (at[2] - at[0]))
        green = (np.minimum(at[1], at[3]) - at[0]) * (at[2] - np.maximum(at[1], at[3]))
        time.append(np.trapezoid(green / (at[2] - at[0]) * np.exp(-(inside**2) / 2), inside))
    shares = np.cumprod([1.0, *(rise / (1 - fall) for rise, fall in pairwise(up))])
    return shares @ up / (shares @ time)


@pytest.mark.parametrize(
    ("sigmas", "part", "taus", "frames"),
    [(2, 0.1, 20, 5), (2, 5, 100, 5), (3, 0.5, 100, 5), (4, 50, 2000, 6)]
    + [
        pytest.param(*case, marks=pytest.mark.slow)
        for case in ((2, 0.5, 200, 40), (3, 0.1, 50, 100), (3, 50, 1000, 10), (4, 2.5, 1000, 60))
    ],
)
def test_static_rate_is_that_of_first_passage_at_any_step(sigmas, part, taus, frames):
    # references on a lattice from the mean; after a frame, as events come in clusters
    sensor, side, count = noisy(sigmas, exposure_s=taus * TAU_S), 16, 0
    state = np.full((4, side, side), np.log(LIGHT_HZ))
    state[3] = 0
    rates = np.full((1, round(taus / part) + 1, side, side), LIGHT_HZ)
    for number in range(frames):
        draw = streams.Draw(0, f"{sigmas} {part}", number)
        drawn, state = expose_frames(rates, sensor, draw, "events", state)
        count += drawn.polarity.sum() * (number > 0)
    expected = (frames - 1) * taus * side**2 * exact_on_rate(sigmas)
    assert count == pytest.approx(expected, abs=4 * (2 * expected) ** 0.5 + 0.005 * expected)
    published = {2: 1.07, 3: 0.142, 4: 6.2e-3}  # over f_3dB; Euler steps of τ/10 lose 28 to 66 %
    assert 2 * np.pi * exact_on_rate(sigmas) == pytest.approx(published[sigmas], rel=0.01)


@pytest.mark.parametrize("contrast", [2.0, 3.0, 4.0])
def test_share_of_pixels_that_see_a_step_is_that_of_a_killed_process(contrast):
    # within 2 τ, at a threshold of 3 σ; the generator between barriers, on a grid
    sensor, side, inner = noisy(3, exposure_s=2 * TAU_S), 64, 199
    rates = np.full((1, 401, side, side), LIGHT_HZ * np.exp(contrast * SIGMA))
    rates[:, 0] = LIGHT_HZ
    seen = np.unique(events(sensor, rates).pixel).size / side**2
    nodes, weights = np.polynomial.hermite_e.hermegauss(15)
    missed = 0.0
    for first, weight in zip(nodes - contrast, weights / weights.sum(), strict=True):
        place, step = np.linspace(first - 3, first + 3, inner + 2, retstep=True)
        side_ways = 1 / step**2 - place[1:-1] / (2 * step), 1 / step**2 + place[1:-1] / (2 * step)
        rate = np.diag(side_ways[0][:-1], 1) + np.diag(side_ways[1][1:], -1)
        missed += weight * expm(2 * (rate - 2 / step**2 * np.eye(inner)))[inner // 2].sum()
    assert seen == pytest.approx(1 - missed, abs=4 * (missed * (1 - missed)) ** 0.5 / side)


def test_leak_makes_on_events_at_its_rate_and_a_held_pixel_makes_none():
    leaking = static(changed(NOISELESS, leak_hz=50), frames=40)
    assert leaking.polarity.all()
    assert leaking.time_s.size / (256 * 0.4) == pytest.approx(50, rel=0.01)
    held = static(noisy(2, refractory_s=4e-3, exposure_s=0.1), frames=2)
    times = held.time_s + 0.1 * held.frame
    assert min(np.diff(times[held.pixel == pixel]).min() for pixel in range(256)) >= 4e-3


def test_thresholds_are_normal_over_pixels_and_fixed_by_the_device():
    on, off = (sensor := IMAGE_SENSORS["davis346"]).thresholds((128, 128))
    assert on.mean() == pytest.approx(0.2, abs=4 * 0.03 / 128)
    assert off.std() == pytest.approx(0.03, rel=4 / (128 * 2**0.5))
    assert (on[:20, :30] == sensor.thresholds((20, 30))[0]).all()


def test_frames_are_the_same_split_or_whole_and_at_any_number_of_threads(monkeypatch):
    sensor, rng = IMAGE_SENSORS["davis346"], np.random.default_rng(1)
    rates = 1e5 * np.exp(np.cumsum(rng.normal(0, 0.3, (6, 3, 80, 60)), axis=1))

    whole, _ = expose_frames(rates, sensor, streams.Draw(0, "split"), "events")
    assert whole.time_s.size > 10_000
    for number in (1, 2):
        monkeypatch.setattr(streams.os, "cpu_count", lambda number=number: number)
        first, state = expose_frames(rates[:2], sensor, streams.Draw(0, "split"), "events")
        last, _ = expose_frames(rates[2:], sensor, streams.Draw(0, "split", 2), "events", state)
        for name in ("time_s", "pixel", "polarity"):
            parts = np.append(getattr(first, name), getattr(last, name))
            np.testing.assert_array_equal(parts, getattr(whole, name))


def test_mean_reading_is_that_of_frames():
    rates = 1e5 * np.exp(np.linspace(0, 3, 22))[:, None, None] * np.ones((60, 60))
    sensor = changed(IMAGE_SENSORS["davis346"], refractory_s=0)
    rates = rates.reshape(2, 11, 60, 60)  # a first frame spreads references
    drawn, _ = expose_frames(rates, sensor, streams.Draw(0, "mean"))
    _, _, mean, variance = moments(rates, sensor, None)
    apart = ((drawn.counts - mean) / np.sqrt(variance))[1]
    assert apart.mean() == pytest.approx(0, abs=0.07)
    assert apart.std() == pytest.approx(1, abs=0.2)
    light = np.full((1, 4, 4, 1), 1e-3), [(500, 510)]
    stated = expose(*light, sensor, seed=0, stream="s", expectation=True).expectation
    assert stated.mean_reading == pytest.approx(sensor.leak_hz * sensor.exposure_s)


def test_flow_from_events_is_that_of_their_pictures():
    texture = gaussian_filter(np.random.default_rng(0).normal(size=(64, 120)), 2)
    places = 1.5 * np.arange(4 * 9) / 9
    moved = [shift(texture, (0, place), order=3, mode="nearest")[:, 40:104] for place in places]
    rates = 1e6 * np.exp(5 * np.array(moved).reshape(4, 9, 64, 64))
    flow = event_flow(events(IMAGE_SENSORS["davis346"], rates))
    assert flow.shape == (3, 64, 64, 2)
    assert np.median(flow[2, 8:-8, 8:-8], axis=(0, 1)) == pytest.approx([1.5, 0], abs=0.2)


def test_dsec_files_are_as_its_readers_need_them(tmp_path):
    shown = static(noisy(2), frames=3, first_frame=2)
    origin = EventOrigin(shape=shown.shape, frame_period_s=0.01, exposure_s=0.01, first_frame=2)
    for is_dsec, tolerance_s in ((False, 1e-12), (True, 0.51e-6)):
        with events_hdf5_writer(tmp_path / "a.h5", origin, is_dsec=is_dsec) as write:
            write(shown)
        back = read_events(tmp_path / "a.h5").events
        assert (back.polarity == shown.polarity).all() and (back.pixel == shown.pixel).all()
        assert back.time_s == pytest.approx(shown.time_s, abs=tolerance_s)
    with h5py.File(tmp_path / "a.h5", "r+") as file:
        t, first = file["events/t"][()], file["ms_to_idx"][()]
        assert (t.dtype, len(first), first[0]) == (np.uint32, 31, 0)  # its slicer rounds up to ms
        for ms, index in enumerate(first):  # as stated in DSEC's code
            assert (t[:index] < 1000 * ms).all() and (t[index:] >= 1000 * ms).all()
        assert (file["events/p"][()] == shown.polarity).all()
        assert file["t_offset"][()] == 20_000
        file["t_offset"][()] = 2**60
    with pytest.raises(DamagedFileError, match="t_offset"):
        read_events(tmp_path / "a.h5")
