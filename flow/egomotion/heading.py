"""The camera's rotation and its direction of translation, from the flow of a whole frame.

A point seen in direction d (unit vector) is seen in direction e by a camera that went by t and
turned by R. Whatever its distance, R e lies in the plane of d and t:

    (R e) · (t × d) / |t × d| = 0

which is the motion across the plane, in radians, so noise of the flow weighs alike everywhere. To
first order in a rotation by ω it is linear in ω (Bruss and Horn 1983, on the sphere). Headings all
over the sphere are tried so; the best are refined without that approximation and with Cauchy's
loss, which wrong velocities hardly move. The sign of t is the one that puts more points in front.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from megalopta.flow.detectors.base import FloatArray
from megalopta.scenes.cameras.base import Camera

_TRIED = 400
_TRIED_ON = 400
_REFINED = 3
_FEWEST = 8
_ROUNDS = 2
_NOISELESS = _STABLE = 1e-9
_CAUCHY = 2.385
"""Scale of the loss in standard deviations: 95 % efficient on normal noise"""


@dataclass(frozen=True)
class CameraMotion:
    """Motion between two frames, in the axes of the first camera."""

    rotation_deg: FloatArray
    """Rotation vector (3,), degrees per frame"""
    heading: FloatArray
    """Direction of translation, unit vector (3,)"""


def camera_motion(directions: FloatArray, moved: FloatArray) -> CameraMotion:
    """Return the rotation and heading that explain where points were seen, and are seen next.

    `directions`, `moved` (n, 3): unit vectors to the points from the first camera and from the
    second, each in that camera's own axes; rows with NaN are left out.

    Raises ValueError when fewer than 8 points are known, which cannot tell five parameters from
    noise.
    """
    known = np.isfinite(directions + moved).all(axis=1)
    if known.sum() < _FEWEST:
        raise ValueError(
            f"{known.sum()} velocities are defined: the camera's motion takes {_FEWEST}"
        )
    d, e = directions[known], moved[known]
    found = min((_refined(t, d, e) for t in _promising(d, e)), key=lambda each: each[2])
    heading, rotation, _ = found
    return CameraMotion(np.degrees(rotation), heading * _sign(heading, rotation, d, e))


def motion_of_flow(camera: Camera, points: FloatArray, flow: FloatArray) -> CameraMotion:
    """Return the rotation and heading of the camera that fit a flow best.

    `points`, `flow` (..., 2): image coordinates, and how far what is seen there moves (px); NaN is
    left out.

    Raises ValueError as by `camera_motion`.
    """
    first, second = camera.toward(points), camera.toward(points + flow)
    return camera_motion(first.reshape(-1, 3), second.reshape(-1, 3))


def _promising(d: FloatArray, e: FloatArray) -> FloatArray:
    """Headings from which to refine, (n, 3)."""
    some = slice(None, None, max(1, len(d) // _TRIED_ON))
    d, e, tried = d[some], e[some], _half_sphere(_TRIED)
    normals = _normals(tried[:, np.newaxis], d)
    # least squares of (e + ω × e) · n = 0, for every heading at once
    rows, left = np.cross(e, normals), np.sum(e * normals, axis=-1)
    powers = np.swapaxes(rows, 1, 2) @ rows + _STABLE * np.eye(3)
    turns = -np.linalg.solve(powers, np.swapaxes(rows, 1, 2) @ left[..., np.newaxis])
    costs = np.median(np.abs(left + (rows @ turns)[..., 0]), axis=1)
    return tried[np.argsort(costs)[:_REFINED]]


def _half_sphere(count: int) -> FloatArray:
    """Directions spread evenly over half of the sphere: the other half are their opposites."""
    z = (np.arange(count) + 0.5) / count
    turn = np.pi * (1 + 5**0.5) * np.arange(count)
    radius = np.sqrt(1 - z**2)
    return np.column_stack((radius * np.cos(turn), radius * np.sin(turn), z))


def _normals(t: FloatArray, d: FloatArray) -> FloatArray:
    """Unit normals of the planes of t and the points, (n, 3)."""
    normals = np.cross(t, d)
    return np.asarray(normals / np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-6))


def _across(t: FloatArray, turn: FloatArray, d: FloatArray, e: FloatArray) -> FloatArray:
    """Motion across the planes that a translation along t allows, (n,) in radians."""
    return np.asarray(np.sum(Rotation.from_rotvec(turn).apply(e) * _normals(t, d), axis=1))


def _turn(t: FloatArray, d: FloatArray, e: FloatArray) -> FloatArray:
    """Rotation vector that leaves least across, by least squares: (e + ω × e) · n = 0."""
    normals = _normals(t, d)
    return np.asarray(
        np.linalg.lstsq(np.cross(e, normals), -np.sum(e * normals, axis=1), rcond=None)[0]
    )


def _refined(t: FloatArray, d: FloatArray, e: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Return the heading and turn near t that leave least across, and their median distance."""
    turn = _turn(t, d, e)
    for _ in range(_ROUNDS):  # each with the noise that the last has left
        noise = 1.4826 * np.median(np.abs(_across(t, turn, d, e))) or _NOISELESS
        # two directions across t, in which it may move
        sideways = np.linalg.svd(t[np.newaxis])[2][1:]

        found = least_squares(
            _scaled_residuals,
            np.concatenate(([0.0, 0.0], turn)),
            loss="cauchy",
            f_scale=_CAUCHY,
            args=(t, sideways, d, e, noise),
        )
        t, turn = _near(t, sideways, found.x)
    return t, turn, float(np.median(np.abs(_across(t, turn, d, e))))


def _near(
    t: FloatArray, sideways: FloatArray, parameters: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Heading moved sideways from t, and rotation vector."""
    moved = t + parameters[:2] @ sideways
    return moved / np.linalg.norm(moved), parameters[2:]


def _scaled_residuals(
    parameters: FloatArray,
    t: FloatArray,
    sideways: FloatArray,
    d: FloatArray,
    e: FloatArray,
    noise: float,
) -> FloatArray:
    return _across(*_near(t, sideways, parameters), d, e) / noise


def _sign(t: FloatArray, turn: FloatArray, d: FloatArray, e: FloatArray) -> int:
    """Which of t and −t puts more points in front: from there they move away from it."""
    left = Rotation.from_rotvec(turn).apply(e) - d
    away = (d @ t)[:, np.newaxis] * d - t
    return 1 if np.sum(np.sign(np.sum(left * away, axis=1))) >= 0 else -1
