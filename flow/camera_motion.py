"""The camera's rotation and its direction of translation, of maximum likelihood, from counts.

The likelihood of the counts of several frames (`flow.likelihood`), in terms of the rotation ω, its
change α, the heading, and the inverse depth ρ|t| at nodes 4 px apart. Neighbors pay for flow that
differs through ρ as in Poisson flow, though less, so that a place without texture takes its
distance from its neighbors. There are several maxima: translation to the left resembles rotation to
the left. So the search starts from the heading that fits Poisson flow best (`motion_of_flow`), from
its opposite, and from both directions along each axis of the camera, each with the rotation and
distances that fit Poisson flow; the two most likely after three steps continue.

The scene is assumed static. Frames of a full panorama are not continued across its seam. Without
translation the rotation is found, and the heading is meaningless. Equations, errors and limits:
`docs/theory/camera-motion.md`.

**From the flow of a whole frame**: a point seen in direction d (unit vector) is seen in direction e
by a camera that translated by t and rotated by R. At any distance,

    (R e) · (t × d) / |t × d| = 0

which is the motion across the plane of d and t, in radians, so noise of the flow has equal weight
everywhere. Headings all over the sphere are tried in a linearization in the rotation (Bruss and
Horn 1983); the best are refined without it and with Cauchy's loss. The sign of t is the one that
puts more points in front.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from operator import itemgetter
from typing import NamedTuple

import numpy as np
from scipy.ndimage import map_coordinates
from scipy.optimize import least_squares
from scipy.sparse import coo_array
from scipy.sparse.linalg import splu
from scipy.spatial.transform import Rotation
from skimage.filters import threshold_otsu

from megalopta.core.arrays import Floats, Mask, robust_sigma
from megalopta.flow import likelihood, likely_flow
from megalopta.flow.detectors.base import Frames
from megalopta.flow.metrics.endpoint_error import angles_deg
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
    fits = (_refined(t, d, e) for t in _promising(d, e))
    heading, rotation, _ = min(fits, key=itemgetter(2))
    # points in front, which are most, move away from the heading
    moved = Rotation.from_rotvec(rotation).apply(e) - d
    away = (d @ heading)[:, np.newaxis] * d - heading
    is_ahead = np.sum(np.sign(np.sum(moved * away, axis=1))) >= 0
    return CameraMotion(np.degrees(rotation), heading if is_ahead else -heading)


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


def _scaled_residuals(
    t: Floats, sideways: Floats, d: Floats, e: Floats, noise: float, parameters: Floats
) -> Floats:
    return _across(*_near(t, sideways, parameters), d, e) / noise


def _near(t: Floats, sideways: Floats, parameters: Floats) -> tuple[Floats, Floats]:
    """Heading displaced sideways from t, and rotation vector."""
    moved = t + parameters[:2] @ sideways
    return moved / np.linalg.norm(moved), parameters[2:]


_SMOOTHNESS, _NEARNESS_SMOOTHNESS = 0.2, 0.02
"""Smoothness of Poisson flow, and that of the inverse depth instead. Set on other forests: parallax
that a smooth inverse depth cannot show passes for rotation, by a tenth of it in low light."""
_FIRST_STEPS, _STEPS = 3, 6
_GOING_ON = 2
_FITS, _LEAST_LEFT_PX = 8, 0.05
_LONGEST_STEP_PX = 1.0
_PART, _ACROSS, _DOWN = 0.4, (0.0, 0.15, 0.3, 0.45, 0.6), (0.0, 0.3, 0.6)
"""Share of the view in an omitted part, and where strips begin, in widths and heights of it"""
_RIDGE = 1e-2
_DAMPING = 1e-6
_SMALL = 1e-5
_PATTERN = np.array([0, 0, 0, 0, 0, 1, 1, 1])
"""Time dependence of ω, the direction of t, and α"""
_SMALLEST_PX = 12
_NOWHERE = -1e6
"""Place (px) of points that a camera does not see"""


class _Motion(NamedTuple):
    turn: Floats
    """ω (3,), radians per frame, in the axes of the camera"""
    change: Floats
    """α (3,), radians per frame and frame"""
    heading: Floats
    """t/|t| (3,)"""
    nearness: Floats
    """ρ|t| at nodes, (n, m)"""


@dataclass(frozen=True)
class CameraMotionError:
    """Standard errors of a camera's motion."""

    rotation_deg: Floats
    """Standard error of the rotation vector (3,), degrees per frame, about each axis"""
    heading_deg: float
    """Standard error of the heading, degrees"""


def likely_camera_motion(counts: Frames, camera: Camera) -> CameraMotion:
    """Return the camera's rotation and heading of maximum likelihood, given counts.

    Per frame, in the axes of the camera at the frame before the middle. `counts` (T, H, W): two or
    more frames of one steady motion; `camera`: that saw them.

    Raises ValueError if frames have another size than the camera, or fewer than 12 pixels along a
    side, there is only one, or they hold no counts, or all the same.
    """
    _check(counts, camera)
    return _Search.of(counts, camera).best().seen


def camera_motion_with_error(
    counts: Frames, camera: Camera
) -> tuple[CameraMotion, CameraMotionError]:
    """Return the motion as `likely_camera_motion`, and its standard errors, from counts (T, H, W).

    What moves by itself may look like a near part of a scene at rest, which no misfit tells. So the
    motion is also found without each of eleven parts of the view: eight strips of 40 % of its width
    or height, the nearest and the farthest 40 % of its pixels, and the nearer of two groups of
    distances. The largest change is part of the error, with the inverse of the information. Takes
    some eleven times as long. Raises as `likely_camera_motion`.
    """
    _check(counts, camera)
    search = _Search.of(counts, camera)
    best = search.best()
    motion, shape = best.seen, counts.shape[1:]
    # variances of the parameters; of those without information, that of a half turn
    values, vectors = np.linalg.eigh(best.information)
    variance = (vectors**2 / np.maximum(values, 1 / np.pi**2)).sum(axis=1)
    near = _dense(best.motion.nearness, shape)
    layers = (
        near > np.quantile(near, 1 - _PART),
        near > threshold_otsu(near),
        near < np.quantile(near, _PART),
    )
    partial_motions = [
        replace(search, used=~part).best().seen for part in (*_strips(shape), *layers)
    ]
    turns = [(each.rotation_deg - motion.rotation_deg) ** 2 for each in partial_motions]
    angles = angles_deg(np.array([each.heading for each in partial_motions]), motion.heading)
    error = CameraMotionError(
        np.sqrt(np.degrees(1) ** 2 * variance[:3] + np.max(turns, axis=0)),
        float(np.sqrt(np.degrees(1) ** 2 * variance[3:5].sum() + (angles**2).max())),
    )
    return motion, error


def tell_motion(counts: Frames) -> bool:
    """Return whether frames (T, H, W) have contrast, and each of them counts."""
    return bool(np.ptp(counts)) and not likelihood.has_dark_frame(counts)


def _check(counts: Frames, camera: Camera) -> None:
    if counts.shape[1:] != (camera.height, camera.width) or len(counts) < 2:
        raise ValueError(
            f"counts of shape {counts.shape}: give two or more frames of the camera's"
            f" {camera.height} × {camera.width} px"
        )
    if min(counts.shape[1:]) < _SMALLEST_PX:
        raise ValueError(
            f"frames of {camera.height} × {camera.width} px: give {_SMALLEST_PX} px along each side"
        )
    if not (np.isfinite(counts).all() and counts.min() >= 0):
        raise ValueError("frames hold negative or non-finite values: give counts, 0 or more")
    if not tell_motion(counts):
        raise ValueError("frames, or one of them, have no contrast; give textured frames")


def _strips(shape: tuple[int, ...]) -> Iterator[Mask]:
    """Yield the pixels (H, W) of each of some strips, which overlap."""
    height, width = shape
    for starts, side, axis in ((_ACROSS, width, 1), (_DOWN, height, 0)):
        for start in starts:
            strip = [slice(None), slice(None)]
            strip[axis] = slice(round(start * side), round((start + _PART) * side))
            part = np.zeros(shape, np.bool_)
            part[tuple(strip)] = True
            yield part


def _dense(nearness: Floats, shape: tuple[int, ...]) -> Floats:
    """Return the inverse depth at pixels (H, W), given that at nodes."""
    return np.asarray(likelihood.finer(nearness[np.newaxis], shape, likelihood.NODE_PX)[0])


class _Found(NamedTuple):
    cost: float
    """Negative log-likelihood, before the last step"""
    motion: _Motion
    information: Floats
    """(8, 8), of ω, the direction of t, and α, whatever the inverse depth"""

    @property
    def seen(self) -> CameraMotion:
        return CameraMotion(np.degrees(self.motion.turn), self.motion.heading)


@dataclass(frozen=True)
class _Search:
    """Constants of the search for the motion."""

    camera: Camera
    level: likelihood.Level
    times: Floats
    charge: float
    flow: Floats
    """Poisson flow at nodes, (n, m, 2)"""
    centers: Floats
    """Image coordinates of the nodes, (n, m, 2)"""
    seen: Floats
    """Directions of the pixels, (H, W, 3)"""
    turning: Floats
    """Flow of a turn about each axis, (n, m, 2, 3), px"""
    going: Floats
    """Flow of translation along each axis past points at distance 1, (n, m, 2, 3), px"""
    used: Mask
    """Pixels that count, (H, W)"""

    @classmethod
    def of(cls, counts: Frames, camera: Camera) -> "_Search":
        sides = [
            np.minimum(
                likelihood.NODE_PX * (np.arange(-(-side // likelihood.NODE_PX)) + 0.5), side - 0.5
            )
            for side in counts.shape[1:]
        ]
        y, x = np.meshgrid(*sides, indexing="ij")
        centers = np.stack((x, y), axis=-1)
        seen = camera.toward(centers)
        dense = likely_flow.likelihood_flow(counts, _SMOOTHNESS)
        flow = [
            map_coordinates(along, (y - 0.5, x - 0.5), order=1, mode="nearest")
            for along in np.moveaxis(dense, -1, 0)
        ]
        return cls(
            camera,
            likelihood.level_of(likelihood.without_defects(counts)),
            likelihood.times_from_reference(len(counts)),
            likely_flow.charge_of(counts, _NEARNESS_SMOOTHNESS),
            np.stack(flow, axis=-1),
            centers,
            camera.directions(),
            _flows(camera, centers, seen, [np.cross(seen, axis) for axis in np.eye(3)]),
            _flows(camera, centers, seen, [-axis for axis in np.eye(3)]),
            np.ones(counts.shape[1:], np.bool_),
        )

    def best(self) -> _Found:
        """Return the most likely motion."""
        cost = itemgetter(0)
        starts = sorted((self.steps(each, _FIRST_STEPS) for each in self.starts()), key=cost)
        return min((self.steps(each.motion, _STEPS) for each in starts[:_GOING_ON]), key=cost)

    @property
    def _used_nodes(self) -> Mask:
        """Nodes whose pixels count, (n, m)."""
        x, y = (self.centers[..., axis].astype(np.intp) for axis in range(2))
        return np.asarray(self.used[y, x])

    def starts(self) -> list[_Motion]:
        """Return initial motions, of which one may be near the most likely."""
        headings = [sign * axis for axis in np.eye(3) for sign in (1, -1)]
        known = np.where(self._used_nodes[..., np.newaxis], self.flow, np.nan)
        try:
            found = motion_of_flow(self.camera, self.centers, known).heading
        except ValueError:  # too few nodes: only the axes
            return [self._fitted(each) for each in headings]
        return [self._fitted(each) for each in (found, -found, *headings)]

    def _fitted(self, heading: Floats) -> _Motion:
        """Return the rotation and inverse depth with the least L1 residual of Poisson flow."""
        along = self.going @ heading
        power = (along**2).sum(axis=-1)
        power = power + _RIDGE * power.mean()
        used = self._used_nodes
        nearness, weight = np.zeros(power.shape), used.astype(np.float64)
        for _ in range(_FITS):
            root = np.sqrt(weight)[..., np.newaxis]
            left = root * (self.flow - nearness[..., np.newaxis] * along)
            rows = (root[..., np.newaxis] * self.turning).reshape(-1, 3)
            turn = np.linalg.lstsq(rows, left.ravel(), rcond=None)[0]
            left = self.flow - self.turning @ turn
            nearness = np.maximum((left * along).sum(axis=-1) / power, 0)
            rest = np.linalg.norm(left - nearness[..., np.newaxis] * along, axis=-1)
            weight = used / np.maximum(rest, _LEAST_LEFT_PX)
        return _Motion(np.asarray(turn, np.float64), np.zeros(3), heading, nearness)

    def steps(self, motion: _Motion, count: int) -> _Found:
        """Return the motion after `count` steps."""
        for _ in range(count):
            found = self._step(motion)
            motion = found.motion
        return found

    def _step(self, motion: _Motion) -> _Found:
        """Return the cost of a motion, and a better motion."""
        heading, nearness = motion.heading, motion.nearness
        near = _dense(nearness, self.level.roots.shape[1:])
        # rotation of the camera by ω and α
        patterns = np.stack((self.times, self.times * (self.times - 1) / 2))
        turns = patterns.T @ np.stack((motion.turn, motion.change))
        at_times = zip(self.times, turns, strict=True)
        places = (self._places(heading, near, time, turn) for time, turn in at_times)
        found = likelihood.evidence(self.level, patterns, places)
        xx, xy, yy = likelihood.to_nodes(found.information)
        information = np.stack((np.stack((xx, xy), -1), np.stack((xy, yy), -1)), -2)
        slopes = np.stack([np.moveaxis(likelihood.to_nodes(each), 0, -1) for each in found.slope])
        # derivatives of the flow by the eight parameters, and by the inverse depth
        sideways = np.linalg.svd(heading[np.newaxis])[2][1:].T
        going = nearness[..., np.newaxis, np.newaxis] * (self.going @ sideways)
        eight = np.concatenate((self.turning, going, self.turning), axis=-1)
        along = self.going @ heading
        scale = float(np.sqrt((along**2).sum(axis=-1).mean()))  # px of flow per inverse depth
        charged, held = self._prior(nearness, scale)
        weighed = information @ eight
        products = found.products[np.ix_(_PATTERN, _PATTERN)]
        eight_eight = products * np.einsum("nmki,nmkj->ij", eight, weighed)
        eight_near = products[0] * np.einsum("nmki,nmk->nmi", weighed, along).reshape(-1, 8)
        near_near = products[0, 0] * np.einsum("nmk,nmkl,nml->nm", along, information, along)
        to_eight = np.einsum("nmki,inmk->i", eight, slopes[_PATTERN])
        to_near = (along * slopes[0]).sum(axis=-1).ravel() - held @ nearness.ravel()
        diagonal, nodes = near_near.ravel() + _DAMPING * scale**2, np.arange(nearness.size)
        matrix = held + coo_array((diagonal, (nodes, nodes)))
        # the steps of the eight parameters and of the inverse depth, which is eliminated
        options = {"SymmetricMode": True}
        factors = splu(matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", options=options)
        solved = factors.solve(np.column_stack((to_near, eight_near)))
        left = eight_eight - eight_near.T @ solved[:, 1:]
        left += np.diag(_DAMPING * np.diag(eight_eight) + np.finfo(float).tiny)
        change = np.linalg.solve(left, to_eight - eight_near.T @ solved[:, 0])
        step = solved[:, 0] - solved[:, 1:] @ change
        longest = _LONGEST_STEP_PX / scale
        nearer = nearness + np.clip(step.reshape(nearness.shape), -longest, longest)
        way = heading + sideways @ change[3:5]
        length = np.linalg.norm(way)
        misfit = 2 * self.level.noise * (len(self.times) - 1) * found.misfit * near.size
        better = _Motion(
            motion.turn + change[:3],
            motion.change + change[5:],
            way / length,
            np.maximum(nearer, 0) * length,
        )
        return _Found(misfit + charged, better, left)

    def _places(self, heading: Floats, near: Floats, time: float, turn: Floats) -> Floats:
        """Places (2, H, W) at a time of the content of the reference frame's pixels."""
        points = self.seen - time * near[..., np.newaxis] * heading
        turned = Rotation.from_rotvec(-turn).apply(points.reshape(-1, 3))
        image = self.camera.project(turned.reshape(points.shape)) - 0.5
        image[~self.used] = np.nan
        return np.nan_to_num(np.moveaxis(image[..., ::-1], -1, 0), nan=_NOWHERE)

    def _prior(self, nearness: Floats, scale: float) -> tuple[float, coo_array]:
        """Return the penalty on the gradient of the inverse depth, and the stiffness of its links.

        The stiffness (nodes, nodes) makes a quadratic form of a penalty on the gradient.
        """
        first, second = likelihood.links(nearness.shape)
        change = scale * (nearness.ravel()[second] - nearness.ravel()[first])
        springs = likely_flow.stiffness(self.charge, change**2)
        rows = np.concatenate((first, second, first, second))
        columns = np.concatenate((first, second, second, first))
        values = scale**2 * np.concatenate((springs, springs, -springs, -springs))
        held = coo_array((values, (rows, columns)), shape=(nearness.size,) * 2)
        return float((springs * change**2).sum()), held


def _flows(camera: Camera, centers: Floats, seen: Floats, changes: list[Floats]) -> Floats:
    """Return the flow of each change of the directions seen, (n, m, 2, changes), px."""
    flows = [camera.displacement(seen + _SMALL * each, centers) / _SMALL for each in changes]
    return np.nan_to_num(np.stack(flows, axis=-1))
