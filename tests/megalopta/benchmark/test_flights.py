"""The flight on which the camera's motion is estimated, and the errors of the ways to do it."""

from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from megalopta.benchmark.clips import FlowClip
from megalopta.benchmark.flights import HEADING, YAW, FlightErrors, flight_errors, together
from megalopta.benchmark.moving_forests import forest_flight
from megalopta.benchmark.table import Case
from megalopta.flow.egomotion.wide_field import yaw_rates_deg_s
from megalopta.scenes import PerspectiveCamera

from ...flow.egomotion.corner import ROOM, view as room


def test_flight_turns_both_ways_and_goes_where_it_does_not_look():
    path = forest_flight().trajectory
    rates = yaw_rates_deg_s(path) / path.frame_rate_hz
    # 0.7° is the derivative at the turning point; nods and rolls by 3° and .5° a frame take or add
    # their product, .03°
    assert rates.max() == pytest.approx(0.7, abs=0.04)
    assert rates.min() == pytest.approx(-0.7, abs=0.04)
    turns = Rotation.from_matrix(
        np.swapaxes(path.poses()[:-1, :3, :3], 1, 2) @ path.poses()[1:, :3, :3]
    )
    largest = np.abs(turns.as_rotvec(degrees=True)).max(axis=0)
    assert (largest > 0.4).all() and (largest < 0.75).all()
    poses = path.poses()
    steps = np.diff(poses[:, :3, 3], axis=0)
    # a spline through 10 cm steps
    np.testing.assert_allclose(np.linalg.norm(steps, axis=1), 0.1, rtol=0.02)
    aside = np.degrees(np.arccos((steps[:, np.newaxis] @ poses[:-1, :3, 2:3])[:, 0, 0] / 0.1))
    assert aside.max() == pytest.approx(31, abs=3)  # 30° aside and 8° upward, nodding by 3°
    assert aside.min() == pytest.approx(8, abs=3.1)


def test_errors_are_root_mean_squares_and_medians_over_all_flights():
    rng = np.random.default_rng(0)
    yaw, heading = rng.normal(0, 0.1, (2, 200, 1)), np.abs(rng.normal(0, 5, (2, 200, 1)))
    cases = Case(YAW, "x", 1.0), Case(HEADING, "x", 1.0)
    halves = [
        FlightErrors(dict(zip(cases, each, strict=True)), np.full(200, 0.5))
        for each in zip(yaw, heading, strict=True)
    ]
    errors = together(halves)
    found = errors.yaw("x", 1.0)
    assert found.value == pytest.approx(np.sqrt((yaw**2).mean()) / 0.5)
    # a root mean square of 400 normal numbers has a standard error of 3.5 %: four of those
    assert found.high - found.low == pytest.approx(4 * found.value * 0.035, rel=0.3)
    middle, nearest, farthest = errors.heading("x", 1.0)
    assert middle == pytest.approx(np.median(heading))
    assert nearest < middle < farthest


@cache
def clip():
    """A room through which the flight goes; a pixel is the mean of 2 × 2 rays."""
    view = forest_flight()
    finer = PerspectiveCamera(width=240, height=240, fov_deg=60)
    poses = np.linalg.inv(view.trajectory.poses()[0]) @ view.trajectory.poses()
    rays = [room(finer, pose[:3, 3], Rotation.from_matrix(pose[:3, :3]), ROOM) for pose in poses]
    light = np.reshape(rays, (-1, 120, 2, 120, 2)).mean(axis=(2, 4))
    return FlowClip("room", light / light.mean(), np.zeros((120, 120, 2)))


@pytest.mark.slow
def test_every_way_is_measured_and_the_likelihood_finds_the_motion():
    found = flight_errors(forest_flight(), clip(), (300.0,), 1)
    likely = "likelihood of 8 frames"
    assert len(found.ways) == 8
    assert found.samples[Case(YAW, likely, 300.0)].shape == (4, 1)
    # in three of the windows within .01°, in the last, a wall's end in view, within .1 of .7°
    assert found.yaw(likely, 300.0).value < 0.2 < found.yaw("BM, summed", 300.0).value
    assert found.heading(likely, 300.0).value < 2
    assert found.heading("BM, summed", 300.0) is None
