"""Readings of an IMU: true motion against twice-differentiated poses, noise against its model."""

import numpy as np
import pytest
from scipy.integrate import cumulative_simpson
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from megalopta.scenes import Hover, Imu, Mount, Orbit, Recorded
from megalopta.scenes.imu import GRAVITY_M_S2, WanderingNoise, inertia

RATE_HZ = 400.0
HOVER = Hover(frames=21, frame_rate_hz=10, jitter_m=0.1, jitter_deg=20, bandwidth_hz=3, seed=4)


def times_of(path, rate_hz=RATE_HZ):
    return np.arange(Imu(rate_hz=rate_hz).samples(path)) / rate_hz


def test_an_orbit_has_centripetal_acceleration():
    path = Orbit(radius_m=5, height_m=0, rate_deg_s=40, frames=11)
    found, rate = inertia(path, times_of(path)), np.radians(40)
    # It looks at the center, and turns about the vertical, which is down in its axes; the rest is
    # rounding, 1e-15 m over the square of a millisecond.
    expected = [0, -GRAVITY_M_S2, 5 * rate**2]
    np.testing.assert_allclose(found.specific_forces - expected, 0, atol=1e-7)
    np.testing.assert_allclose(np.abs(found.angular_velocities) - [0, rate, 0], 0, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(found.velocities, axis=1), 5 * rate, rtol=1e-8)


def test_specific_force_is_the_second_derivative_of_a_spline():
    knots, points = [0, 1.1, 2.3, 4], [(0, 0, 1), (1, 2, 2), (3, 0, 1), (4, 1, 2)]
    lines = (f"{t},{x},{y},{z},0,0,0,1\n" for t, (x, y, z) in zip(knots, points, strict=True))
    path = Recorded(csv="".join(lines), frames=31)
    times = times_of(path)[::7]
    curve = CubicSpline(knots, points)
    found = inertia(path, times)
    world = np.einsum("nij,nj->ni", found.rotations, found.specific_forces)
    # The third derivative jumps at the two inner points: there the difference is over 2 ms.
    error = np.abs(world - curve(times, 2) - [0, 0, GRAVITY_M_S2]).max(axis=1)
    assert np.quantile(error, 0.98) < 1e-7
    assert error.max() < 5e-3 * np.abs(curve(times, 3)).max()


def test_integrated_readings_lead_along_the_path():
    # Strapdown integration of noise-free readings, by the midpoint rule and Simpson's.
    found = inertia(HOVER.mounted(Mount(position_m=(0.3, 0, 0.1))), times_of(HOVER, 4000.0))
    step = found.times_s[1]
    middle = (found.angular_velocities[1:] + found.angular_velocities[:-1]) / 2
    turn = Rotation.from_matrix(found.rotations[0])
    for rate in middle:
        turn = turn * Rotation.from_rotvec(rate * step)
    last = Rotation.from_matrix(found.rotations[-1])
    assert (turn.inv() * last).magnitude() < 1e-5
    force = np.einsum("nij,nj->ni", found.rotations, found.specific_forces)
    force -= [0, 0, GRAVITY_M_S2]
    speed = cumulative_simpson(force, dx=step, axis=0, initial=0) + found.velocities[0]
    place = cumulative_simpson(speed, dx=step, axis=0, initial=0) + found.positions[0]
    assert np.abs(speed - found.velocities).max() < 1e-5
    assert np.abs(place - found.positions).max() < 1e-5


def test_a_lever_arm_adds_what_rigid_bodies_add():
    # a' = a + α × r + ω × (ω × r), with α from differences of ω.
    arm, times = np.array([0.2, -0.1, 0.4]), times_of(HOVER)
    center, off = inertia(HOVER, times), inertia(HOVER.mounted(Mount(position_m=arm)), times)
    rate = center.angular_velocities
    later, earlier = (inertia(HOVER, times + dt).angular_velocities for dt in (1e-4, -1e-4))
    spin = (later - earlier) / 2e-4
    expected = np.cross(spin, arm) + np.cross(rate, np.cross(rate, arm))
    assert np.abs(expected).max() > 1
    # Differences of order 4 over 1 ms, and of order 2 over 0.1 ms.
    error = off.specific_forces - center.specific_forces - expected
    np.testing.assert_allclose(error, 0, atol=1e-5 * np.abs(expected).max())


@pytest.mark.parametrize("seconds", [0.05, 1.0, 40.0])
def test_the_allan_variance_is_that_of_the_model(seconds):
    rate = 100.0
    noise = WanderingNoise(density=2e-3, walk=1.5e-3)  # they are equal at 2.3 s
    error, _ = noise.draw(np.random.default_rng(3), 2**20, rate)
    size = round(seconds * rate)
    means = error[: len(error) // size * size].reshape(-1, size, 3).mean(axis=1)
    steps = np.diff(means, axis=0)
    found = (steps**2).mean() / 2
    # Neighboring differences are correlated, by up to 2/3: the mean of m squares has a variance of
    # at most (2/m)(1 + 4/9·2). Five such deviations have a false-alarm rate below 1e-6.
    tolerance = 5 * np.sqrt(2 / steps.size * (1 + 8 / 9))
    # A sampled walk has another 1/(2·size²) of its own.
    tolerance += 1 / size**2
    assert abs(found / noise.allan_variance(seconds) - 1) < tolerance
