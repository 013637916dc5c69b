"""Closed forms of the simulation; `test_physics.py` holds it against the plainest one."""

import numpy as np
import pytest

from megalopta.sensor.effects.dead_time import DeadTime
from megalopta.sensor.sampling.streams import generator
from megalopta.sensor.spad.model import AvalancheEffects
from megalopta.sensor.spad.simulation import simulate_frame


@pytest.mark.slow
def test_twilight_pulses_raise_the_rate_as_straka_found():
    # 7 % more counts at 50 per µs: 22 ns of dead time with twilight in its last 3.9 ns
    dead = DeadTime(kind="nonparalyzable", dead_time_s=22e-9, twilight_s=3.9e-9, start="stationary")
    rate, exposure = 50e6, 20e-6
    counts = simulate_frame(
        generator(0), np.full((5000, 1), rate), exposure, AvalancheEffects(dead_time=dead)
    ).counts
    expected = rate * exposure / (rate * 22e-9 + np.exp(-rate * 3.9e-9))
    assert abs(counts.mean() - expected) < 5 * counts.std() / counts.size**0.5  # 6e-7
    assert counts.mean() / (rate * exposure / (rate * 22e-9 + 1)) > 1.07


def test_frames_that_follow_are_one_long_exposure_to_the_dead_time():
    # dead for two frames after each count: never counts in two neighboring frames
    dead = DeadTime(kind="nonparalyzable", dead_time_s=2e-6)
    rng, state, frames = generator(1), None, []
    for _ in range(40):
        frame = simulate_frame(
            rng, np.full((20, 20), 5e6), 1e-6, AvalancheEffects(dead_time=dead), state=state
        )
        state = frame.state
        frames.append(frame.counts)
    counts = np.array(frames)
    assert counts.max() == 1
    assert (counts[1:] + counts[:-1]).max() == 1
    # one count each dead time and wait, 2.2 µs
    assert counts.mean() == pytest.approx(1 / 2.2, rel=0.03)


def test_light_of_a_part_of_the_exposure_gives_events_there_only():
    light = np.zeros((4, 3, 3))
    light[2] = 1e8
    frame = simulate_frame(generator(2), light, 1e-6, AvalancheEffects())
    assert frame.counts.sum() == frame.times_s.size > 100
    assert frame.times_s.min() >= 0.5e-6 and frame.times_s.max() < 0.75e-6
