"""Inertial measurement unit on the rig of a camera: gyroscope and accelerometer.

A reading along each axis is the true value, plus white noise, plus a bias that wanders:

    reading = true + density · √rate · n₁ + bias,    bias grows by walk / √rate · n₂ per sample

with independent standard normal n₁ and n₂, as in Kalibr's and EuRoC's `sensor.yaml`. The bias is 0
at time 0. The Allan variance of the error over τ is density²/τ + walk²·τ/3 (IEEE Std 952-1997,
annex C). Saturation, scale errors, misalignment and steps of the converter are not modeled. Default
values are those of the ADIS16448 of EuRoC (Burri et al., IJRR 35, 2016).

True angular velocity and specific force follow from the exact course of a path. An accelerometer
measures a − g, along its own axes: at rest, 9.80665 m/s² upward. Derivatives are central
differences over 1 ms, extrapolated to fourth order (Richardson). They have an error below 1e-6 of
the largest value for motion up to 5 Hz. Where a course has a corner, as recorded orientations at
each line of the file, it is rounded over 2 ms.
"""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import Field
from scipy.spatial.transform import Rotation

from megalopta.core.arrays import Floats
from megalopta.core.record import Record
from megalopta.scenes.trajectories.base import Mount, Path

GRAVITY_M_S2 = 9.80665
_STEP_S = 1e-3


@dataclass(frozen=True)
class Inertia:
    """Motion of a body at n times."""

    times_s: Floats
    """(n,)"""
    positions: Floats
    """(n, 3), m."""
    rotations: Floats
    """(n, 3, 3), body axes to world."""
    velocities: Floats
    """(n, 3), m/s, world axes."""
    angular_velocities: Floats
    """(n, 3), rad/s, body axes."""
    specific_forces: Floats
    """(n, 3), m/s², body axes."""


def inertia(path: Path, times_s: Floats) -> Inertia:
    """Return the motion of the camera on a path, whose axes are the body's, at times (n,), s."""
    positions, rotations = path.placed(times_s)
    (speed, turn, push), (speed_2, turn_2, push_2) = (
        _differences(path, times_s, positions, step) for step in (_STEP_S, 2 * _STEP_S)
    )
    acceleration = (4 * push - push_2) / 3 + [0, 0, GRAVITY_M_S2]
    return Inertia(
        times_s=times_s,
        positions=positions,
        rotations=rotations,
        velocities=(4 * speed - speed_2) / 3,
        angular_velocities=(4 * turn - turn_2) / 3,
        specific_forces=np.einsum("nij,ni->nj", rotations, acceleration),
    )


def _differences(
    path: Path, times_s: Floats, positions: Floats, step_s: float
) -> tuple[Floats, Floats, Floats]:
    """Velocity, angular velocity in body axes, and acceleration, each (n, 3), to second order."""
    (before, start), (after, end) = (path.placed(times_s + step) for step in (-step_s, step_s))
    turn = Rotation.from_matrix(start.swapaxes(1, 2) @ end).as_rotvec()
    speed = (after - before) / (2 * step_s)
    return speed, turn / (2 * step_s), (after - 2 * positions + before) / step_s**2


_Density = Annotated[float, Field(ge=0, le=1e6)]


@dataclass(frozen=True)
class WanderingNoise:
    """Error of one axis: white noise and a bias that wanders."""

    density: float
    """White noise, unit/√Hz."""
    walk: float
    """Random walk of the bias, unit/s/√Hz."""

    def draw(self, rng: np.random.Generator, samples: int, rate_hz: float) -> tuple[Floats, Floats]:
        """Return the errors (samples, 3) of three axes, and the biases (samples, 3) in them."""
        steps = rng.normal(scale=self.walk / np.sqrt(rate_hz), size=(samples, 3))
        bias = np.cumsum(steps, axis=0) - steps[:1]
        return bias + rng.normal(scale=self.density * np.sqrt(rate_hz), size=(samples, 3)), bias

    def allan_variance(self, tau_s: Floats) -> Floats:
        """Allan variance (…) of the error, unit², over averages of τ (…), s."""
        return np.asarray(self.density**2 / tau_s + self.walk**2 * tau_s / 3)


@dataclass(frozen=True)
class Readings:
    """Readings of an IMU at n times."""

    truth: Inertia
    angular_velocities: Floats
    """(n, 3), rad/s, body axes."""
    specific_forces: Floats
    """(n, 3), m/s², body axes."""
    gyroscope_biases: Floats
    """(n, 3), rad/s."""
    accelerometer_biases: Floats
    """(n, 3), m/s²."""


class Imu(Record, frozen=True):
    """Gyroscope and accelerometer that follow the path on the camera's rig."""

    rate_hz: Annotated[float, Field(gt=0, le=1e6)] = 200.0
    """Readings per second (Hz)."""

    mount: Mount = Mount()
    """Place relative to the path's camera; by default at the camera, with its axes."""

    gyroscope_noise_density: _Density = 1.6968e-4
    """White noise of the gyroscope (rad/s/√Hz)."""

    gyroscope_random_walk: _Density = 1.9393e-5
    """Random walk of its bias (rad/s²/√Hz)."""

    accelerometer_noise_density: _Density = 2.0e-3
    """White noise of the accelerometer (m/s²/√Hz)."""

    accelerometer_random_walk: _Density = 3.0e-3
    """Random walk of its bias (m/s³/√Hz)."""

    @property
    def gyroscope(self) -> WanderingNoise:
        """Error of the gyroscope, rad/s."""
        return WanderingNoise(self.gyroscope_noise_density, self.gyroscope_random_walk)

    @property
    def accelerometer(self) -> WanderingNoise:
        """Error of the accelerometer, m/s²."""
        return WanderingNoise(self.accelerometer_noise_density, self.accelerometer_random_walk)

    def samples(self, path: Path) -> int:
        """Number of readings from the first frame of a path to the last."""
        return int((path.frames - 1) / path.frame_rate_hz * self.rate_hz * (1 + 1e-12)) + 1

    def read(self, path: Path, rng: np.random.Generator) -> Readings:
        """Return the readings from the first frame of a path to the last, with noise from `rng`."""
        times = np.arange(self.samples(path)) / self.rate_hz
        truth = inertia(path.mounted(self.mount), times)
        turn, turn_bias = self.gyroscope.draw(rng, len(times), self.rate_hz)
        push, push_bias = self.accelerometer.draw(rng, len(times), self.rate_hz)
        return Readings(
            truth,
            truth.angular_velocities + turn,
            truth.specific_forces + push,
            turn_bias,
            push_bias,
        )
