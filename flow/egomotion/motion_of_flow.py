"""The camera's rotation and its direction of translation, from the flow of a whole frame.

A point seen in direction d (unit vector) is seen in direction e by a camera that translated by t
and rotated by R. At any distance,

    (R e) · (t × d) / |t × d| = 0

which is the motion across the plane of d and t, in radians, so noise of the flow has equal weight
everywhere. Headings all over the sphere are tried in a linearization in the rotation (Bruss and
Horn 1983); the best are refined without it and with Cauchy's loss. The sign of t is the one that
puts more points in front. Without translation the heading is meaningless.
"""

from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from megalopta.core.arrays import Floats, robust_sigma
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

    rotation_deg: Floats
    """Rotation vector (3,), degrees per frame"""
    heading: Floats
    """Direction of translation, unit vector (3,)"""


def motion_of_flow(camera: Camera, points: Floats, flow: Floats) -> CameraMotion:
    """Return the rotation and heading of the camera that fit a flow best.

    `points`, `flow` (..., 2): image coordinates, and their displacement (px); NaN is skipped.

    Raises ValueError if fewer than 8 velocities are defined, which cannot determine five parameters
    in noise.
    """
    # unit vectors from the first and the second camera, each in its own axes
    d, e = (camera.toward(places).reshape(-1, 3) for places in (points, points + flow))
    known = np.isfinite(d + e).all(axis=1)
    if known.sum() < _FEWEST:
        raise ValueError(
            f"{known.sum()} velocities are defined; the camera's motion needs {_FEWEST}"
        )
    d, e = d[known], e[known]
    found = min((_refined(t, d, e) for t in _promising(d, e)), key=lambda each: each[2])
    heading, rotation, _ = found
    return CameraMotion(np.degrees(rotation), heading * _sign(heading, rotation, d, e))


def _promising(d: Floats, e: Floats) -> Floats:
    """Headings to refine, (n, 3)."""
    some = slice(None, None, max(1, len(d) // _TRIED_ON))
    d, e = d[some], e[some]
    # evenly spread over half of the sphere: the other half are their opposites
    z = (np.arange(_TRIED) + 0.5) / _TRIED
    turn, radius = np.pi * (1 + 5**0.5) * np.arange(_TRIED), np.sqrt(1 - z**2)
    tried = np.column_stack((radius * np.cos(turn), radius * np.sin(turn), z))
    normals = _normals(tried[:, np.newaxis], d)
    # least squares of (e + ω × e) · n = 0, for every heading at once
    rows, left = np.cross(e, normals), np.sum(e * normals, axis=-1)
    powers = np.swapaxes(rows, 1, 2) @ rows + _STABLE * np.eye(3)
    turns = -np.linalg.solve(powers, np.swapaxes(rows, 1, 2) @ left[..., np.newaxis])
    costs = np.median(np.abs(left + (rows @ turns)[..., 0]), axis=1)
    return tried[np.argsort(costs)[:_REFINED]]


def _normals(t: Floats, d: Floats) -> Floats:
    """Unit normals of the planes of t and the points, (n, 3)."""
    normals = np.cross(t, d)
    return np.asarray(normals / np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-6))


def _across(t: Floats, turn: Floats, d: Floats, e: Floats) -> Floats:
    """Motion across the planes that a translation along t allows, (n,) in radians."""
    return np.asarray(np.sum(Rotation.from_rotvec(turn).apply(e) * _normals(t, d), axis=1))


def _refined(t: Floats, d: Floats, e: Floats) -> tuple[Floats, Floats, float]:
    """Return the heading and rotation near t with the least residual, and their median distance."""
    normals = _normals(t, d)
    # least squares of (e + ω × e) · n = 0
    turn = np.linalg.lstsq(np.cross(e, normals), -np.sum(e * normals, axis=1), rcond=None)[0]
    for _ in range(_ROUNDS):  # each with the noise that the previous one left
        noise = robust_sigma(_across(t, turn, d, e)) or _NOISELESS
        # two directions across t, along which it may move
        sideways = np.linalg.svd(t[np.newaxis])[2][1:]
        start = np.concatenate(([0.0, 0.0], turn))
        residuals = partial(_scaled_residuals, t, sideways, d, e, noise)
        found = least_squares(residuals, start, loss="cauchy", f_scale=_CAUCHY)
        t, turn = _near(t, sideways, found.x)
    return t, turn, float(np.median(np.abs(_across(t, turn, d, e))))


def _near(t: Floats, sideways: Floats, parameters: Floats) -> tuple[Floats, Floats]:
    """Heading displaced sideways from t, and rotation vector."""
    moved = t + parameters[:2] @ sideways
    return moved / np.linalg.norm(moved), parameters[2:]


def _scaled_residuals(
    t: Floats, sideways: Floats, d: Floats, e: Floats, noise: float, parameters: Floats
) -> Floats:
    return _across(*_near(t, sideways, parameters), d, e) / noise


def _sign(t: Floats, turn: Floats, d: Floats, e: Floats) -> int:
    """Sign of t that puts more points in front, where they move away from it."""
    left = Rotation.from_rotvec(turn).apply(e) - d
    away = (d @ t)[:, np.newaxis] * d - t
    return 1 if np.sum(np.sign(np.sum(left * away, axis=1))) >= 0 else -1
