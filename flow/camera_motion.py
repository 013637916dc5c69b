"""The camera's rotation and its direction of translation, of maximum likelihood, from counts.

The likelihood of the counts of several frames (`flow.likelihood`), in terms of the rotation ω, its
change α, the heading, and the inverse depth ρ|t| at nodes 4 px apart. There are several maxima:
translation to the left resembles rotation to the left. So the search starts from the heading that
fits Poisson flow best (`motion_of_flow`), from its opposite, and from both directions along each
axis of the camera; the two most likely after three steps continue.

**From the flow of a whole frame**: a point seen in direction d (unit vector) is seen in direction e
by a camera that translated by t and rotated by R. At any distance,

    (R e) · (t × d) / |t × d| = 0

which is the motion across the plane of d and t, in radians, so noise of the flow has equal weight
everywhere. Headings all over the sphere are tried in a linearization in the rotation (Bruss and
Horn 1983); the best are refined without it and with Cauchy's loss.

Equations, errors and limits: `docs/theory/camera-motion.md`.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from operator import itemgetter
from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.optimize import least_squares
from scipy.sparse import coo_array
from scipy.sparse.linalg import splu
from scipy.spatial.transform import Rotation
from skimage.filters import threshold_otsu

from megalopta.core.arrays import Floats, Mask, robust_sigma
from megalopta.flow.detectors.base import Frames
from megalopta.flow.likelihood import alignment, dense_flow, roots
from megalopta.flow.metrics.endpoint_error import angles_deg
from megalopta.scenes.cameras.base import Camera

_TRIED = 400
"""Headings of the half sphere, and most velocities on which each is tried"""
_FEWEST = 8
_NOISELESS = _STABLE = 1e-9
_CAUCHY = 2.385
"""Scale of the loss in standard deviations: 95 % efficient on normal noise"""

_SMOOTHNESS, _DEPTH_SMOOTHNESS = 0.2, 0.02
"""Smoothness of Poisson flow, and that of the inverse depth instead. Set on other forests: parallax
that a smooth inverse depth cannot show passes for rotation, by a tenth of it in low light."""
_FIRST_STEPS, _STEPS = 3, 6
_FITS, _LEAST_RESIDUAL_PX = 8, 0.05
_MODEL = 4.0
"""Variance of an estimate at rest over the inverse of its information, which takes the prior of the
inverse depth for knowledge"""
_EXCLUDED, _ALIKE = 20.0, (-20.0, 4.0)
"""Differences of log-likelihood, over the dispersion: above the first a motion is excluded, within
the second two motions are alike; with `_MODEL` set on other windows than the documentation's"""
_DEPTH_STEPS, _AROUND_PX = 4, 2.0
_PART, _ACROSS, _DOWN = 0.4, (0.0, 0.15, 0.3, 0.45, 0.6), (0.0, 0.3, 0.6)
"""Share of the view in an omitted part, and where strips begin, in widths and heights of it"""
_DAMPING = 1e-6
_SMALL = 1e-5
_PATTERN = np.array([0, 0, 0, 0, 0, 1, 1, 1])
"""Time dependence of ω, the direction of t, and α"""
_SMALLEST_PX = 12


@dataclass(frozen=True)
class CameraMotion:
    """Motion between two frames, in the axes of the first camera."""

    rotation_deg: Floats
    """Rotation vector (3,), degrees per frame"""
    heading: Floats
    """Direction of translation, unit vector (3,)"""


@dataclass(frozen=True)
class CameraMotionError:
    """Standard errors of a camera's motion."""

    rotation_deg: Floats
    """Standard error of the rotation vector (3,), degrees per frame, about each axis"""
    heading_deg: float
    """Standard error of the heading, degrees"""


def motion_of_flow(camera: Camera, points: Floats, flow: Floats) -> CameraMotion:
    """Return the rotation and heading of the camera that fit a flow best.

    `points`, `flow` (..., 2): image coordinates, and their displacement (px); NaN is skipped.

    Raises ValueError if fewer than 8 velocities are defined, which cannot determine five parameters
    in noise.
    """
    d, e = _seen(camera, points, flow)
    if len(d) < _FEWEST:
        raise ValueError(f"{len(d)} velocities are defined; the camera's motion needs {_FEWEST}")
    fits = (_fitted(t, d, e) for t in _promising_headings(d, e))
    heading, rotation, _ = min(fits, key=itemgetter(2))
    # points in front, which are most, move away from the heading
    moved = Rotation.from_rotvec(rotation).apply(e) - d
    away = (d @ heading)[:, np.newaxis] * d - heading
    is_ahead = np.sum(np.sign(np.sum(moved * away, axis=1))) >= 0
    return CameraMotion(np.degrees(rotation), heading if is_ahead else -heading)


def _seen(camera: Camera, points: Floats, flow: Floats) -> tuple[Floats, Floats]:
    """Return unit vectors to points from the first and the second camera, each in its own axes."""
    d, e = (camera.toward(places).reshape(-1, 3) for places in (points, points + flow))
    known = np.isfinite(d + e).all(axis=1)
    return d[known], e[known]


def _promising_headings(d: Floats, e: Floats) -> Floats:
    """Return the headings (n, 3) of least median residual, with a rotation linear in ω."""
    few = slice(None, None, max(1, len(d) // _TRIED))
    d, e = d[few], e[few]
    # evenly spread over half of the sphere: the other half are their opposites
    z = (np.arange(_TRIED) + 0.5) / _TRIED
    azimuth, radius = np.pi * (1 + 5**0.5) * np.arange(_TRIED), np.sqrt(1 - z**2)
    headings = np.column_stack((radius * np.cos(azimuth), radius * np.sin(azimuth), z))
    normals = _normals(headings[:, np.newaxis], d)
    # least squares of (e + ω × e) · n = 0, for every heading at once
    rows, residuals = np.cross(e, normals), np.sum(e * normals, axis=-1)
    powers = np.swapaxes(rows, 1, 2) @ rows + _STABLE * np.eye(3)
    rotations = -np.linalg.solve(powers, np.swapaxes(rows, 1, 2) @ residuals[..., np.newaxis])
    costs = np.median(np.abs(residuals + (rows @ rotations)[..., 0]), axis=1)
    return headings[np.argsort(costs)[:3]]  # these are refined


def _normals(t: Floats, d: Floats) -> Floats:
    """Unit normals of the planes of t and the points, (n, 3)."""
    normals = np.cross(t, d)
    return np.asarray(normals / np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-6))


def _fitted(t: Floats, d: Floats, e: Floats) -> tuple[Floats, Floats, float]:
    """Return the heading and rotation near t with the least residual, and their median distance."""

    def across(t: Floats, rotation: Floats) -> Floats:
        """Motion across the planes that a translation along t allows, (n,) in radians."""
        return np.asarray(np.sum(Rotation.from_rotvec(rotation).apply(e) * _normals(t, d), axis=1))

    def near(parameters: Floats, t: Floats, sideways: Floats) -> tuple[Floats, Floats]:
        """Heading displaced sideways from t, and rotation vector."""
        moved = t + parameters[:2] @ sideways
        return moved / np.linalg.norm(moved), parameters[2:]

    def residuals(parameters: Floats, t: Floats, sideways: Floats, noise: float) -> Floats:
        return across(*near(parameters, t, sideways)) / noise

    normals = _normals(t, d)
    # least squares of (e + ω × e) · n = 0
    rotation = np.linalg.lstsq(np.cross(e, normals), -np.sum(e * normals, axis=1), rcond=None)[0]
    for _ in range(2):  # each with the noise that the previous one left
        noise = robust_sigma(across(t, rotation)) or _NOISELESS
        # two directions across t, along which it may move
        sideways = np.linalg.svd(t[np.newaxis])[2][1:]
        start, args = np.concatenate(([0.0, 0.0], rotation)), (t, sideways, noise)
        fit = least_squares(residuals, start, loss="cauchy", f_scale=_CAUCHY, args=args)
        t, rotation = near(fit.x, t, sideways)
    return t, rotation, float(np.median(np.abs(across(t, rotation))))


def likely_camera_motion(counts: Frames, camera: Camera) -> CameraMotion:
    """Return the camera's rotation and heading of maximum likelihood, given counts.

    Per frame, in the axes of the camera at the frame before the middle. `counts` (T, H, W): two or
    more frames of one steady motion. Raises ValueError if they have another size than the camera,
    fewer than 12 pixels along a side, or no contrast.
    """
    return _Search.of(counts, camera).best().camera_motion


def camera_motion_with_error(
    counts: Frames, camera: Camera
) -> tuple[CameraMotion, CameraMotionError]:
    """Return the motion as `likely_camera_motion`, and its standard errors, from counts (T, H, W).

    What moves by itself may look like a near part of a scene at rest. So the motion is also found
    without each of eleven parts of the view: eight strips of 40 % of its width or height, the
    nearest and the farthest 40 % of its pixels, and the nearer of two groups of distances. The
    largest change is part of the error, with the inverse of the information. In enough light, a
    change is omitted if the whole view excludes the other motion and the rest of the view hardly
    tells both apart: then it is what less evidence costs where nothing moves.
    """
    search = _Search.of(counts, camera)
    best = search.best()
    motion, shape = best.camera_motion, counts.shape[1:]
    dispersion = max(1.0, search.evidence(best.motion).misfit)
    # variances of the parameters; of those without information, that of a half turn
    values, vectors = np.linalg.eigh(best.information)
    variance_deg2 = _MODEL * dispersion * np.degrees(1) ** 2 * vectors**2
    variance_deg2 = (variance_deg2 / np.maximum(values, 1 / np.pi**2)).sum(axis=1)
    near = _at_pixels(best.motion.inverse_depth, shape)
    low, high = np.quantile(near, (_PART, 1 - _PART))
    layers = near > high, near > threshold_otsu(near), near < low
    is_dim = counts.sum(axis=0).mean() < 200.0  # photons per pixel: what moves does not show
    changes = [np.zeros(4)]  # of the rotation about each axis, and of the heading
    for part in (*_strips(shape), *layers):
        apart = replace(search, used=~part)
        second = apart.best(refined=False)
        if (
            is_dim
            or search.excess(second.motion, best.motion) < _EXCLUDED * dispersion
            or not _ALIKE[0] < apart.excess(best.motion, second.motion) / dispersion < _ALIKE[1]
        ):
            turned = second.camera_motion.rotation_deg - motion.rotation_deg
            swung = angles_deg(second.motion.heading, motion.heading)
            changes.append(np.append(turned, swung))
    noise = np.append(variance_deg2[:3], variance_deg2[3:5].sum())
    square = np.square(changes).max(axis=0) + noise
    return motion, CameraMotionError(np.sqrt(square[:3]), float(np.sqrt(square[3])))


def _strips(shape: tuple[int, ...]) -> Iterator[Mask]:
    """Yield the pixels (H, W) of each of the strips, which overlap."""
    y, x = np.indices(shape)
    for starts, side, place in ((_ACROSS, shape[1], x), (_DOWN, shape[0], y)):
        for start in starts:
            yield (place >= round(start * side)) & (place < round((start + _PART) * side))


def _at_pixels(inverse_depth: Floats, shape: tuple[int, ...]) -> Floats:
    """Return the inverse depth at pixels (H, W), given that at nodes."""
    return np.asarray(alignment.finer(inverse_depth[np.newaxis], shape, roots.NODE_PX)[0])


class _Motion(NamedTuple):
    rotation: Floats
    """ω (3,), radians per frame, in the axes of the camera"""
    change: Floats
    """α (3,), radians per frame and frame"""
    heading: Floats
    """t/|t| (3,)"""
    inverse_depth: Floats
    """ρ|t| at nodes, (n, m)"""


class _Estimate(NamedTuple):
    cost: float
    """Negative log-likelihood, before the last step"""
    motion: _Motion
    information: Floats
    """(8, 8), of ω, the direction of t, and α, whatever the inverse depth"""

    @property
    def camera_motion(self) -> CameraMotion:
        return CameraMotion(np.degrees(self.motion.rotation), self.motion.heading)


@dataclass(frozen=True)
class _Search:
    """Constants of the search for the motion."""

    camera: Camera
    level: roots.Level
    times: Floats
    smoothness: float
    flow: Floats
    """Poisson flow at nodes, (n, m, 2)"""
    nodes: Floats
    """Image coordinates of the nodes, (n, m, 2)"""
    directions: Floats
    """Directions of the pixels, (H, W, 3)"""
    rotation_flow: Floats
    """Flow of a rotation about each axis, (n, m, 2, 3), px"""
    translation_flow: Floats
    """Flow of translation along each axis past points at distance 1, (n, m, 2, 3), px"""
    used: Mask
    """Pixels that count, (H, W)"""

    @classmethod
    def of(cls, counts: Frames, camera: Camera) -> "_Search":
        height, width = camera.height, camera.width
        if counts.shape[1:] != (height, width) or len(counts) < 2:
            raise ValueError(
                f"counts of shape {counts.shape}: give two or more frames of the camera's"
                f" {height} × {width} px"
            )
        if min(height, width) < _SMALLEST_PX:
            raise ValueError(
                f"frames of {height} × {width} px: give {_SMALLEST_PX} px along each side"
            )
        if not (np.isfinite(counts).all() and counts.min() >= 0):
            raise ValueError("frames hold negative or non-finite values: give counts, 0 or more")
        if not np.ptp(counts) or roots.has_dark_frame(counts):
            raise ValueError("frames, or one of them, have no contrast; give textured frames")
        columns, rows = (
            np.minimum(roots.NODE_PX * (np.arange(-(-side // roots.NODE_PX)) + 0.5), side - 0.5)
            for side in (width, height)
        )
        x, y = np.meshgrid(columns, rows)
        nodes = np.stack((x, y), axis=-1)
        toward = camera.toward(nodes)

        def flow_of(changes: list[Floats]) -> Floats:
            """Flow of each change of the directions of nodes, (n, m, 2, changes), px."""
            moved = [camera.displacement(toward + _SMALL * change, nodes) for change in changes]
            return np.nan_to_num(np.stack(moved, axis=-1) / _SMALL)

        dense = dense_flow.likelihood_flow(counts, _SMOOTHNESS)
        flow = [
            map_coordinates(component, (y - 0.5, x - 0.5), order=1, mode="nearest")
            for component in np.moveaxis(dense, -1, 0)
        ]
        return cls(
            camera=camera,
            level=roots.level_of(roots.without_defects(counts)),
            times=alignment.times_from_reference(len(counts)),
            smoothness=dense_flow.smoothness_of(counts.sum(axis=0).mean(), _DEPTH_SMOOTHNESS),
            flow=np.stack(flow, axis=-1),
            nodes=nodes,
            directions=camera.directions(),
            rotation_flow=flow_of([np.cross(toward, axis) for axis in np.eye(3)]),
            translation_flow=flow_of([-axis for axis in np.eye(3)]),
            used=np.ones((height, width), np.bool_),
        )

    def best(self, *, refined: bool = True) -> _Estimate:
        """Return the most likely motion; unrefined, from the fitted heading as it was tried."""
        x, y = (self.nodes[..., axis].astype(np.intp) for axis in range(2))
        used = self.used[y, x]
        headings = [sign * axis for axis in np.eye(3) for sign in (1, -1)]
        known = np.where(used[..., np.newaxis], self.flow, np.nan)
        d, e = _seen(self.camera, self.nodes, known)
        if len(d) >= _FEWEST:  # with too few nodes only the axes
            tried = _promising_headings(d, e)
            fits = (_fitted(t, d, e) for t in tried)
            heading = min(fits, key=itemgetter(2))[0] if refined else tried[0]
            headings = [heading, -heading, *headings]
        cost = itemgetter(0)
        starts = (self._start(heading, used) for heading in headings)
        begun = sorted((self._stepped(start, _FIRST_STEPS) for start in starts), key=cost)
        # the two best starts continue
        return min((self._stepped(estimate.motion, _STEPS) for estimate in begun[:2]), key=cost)

    def excess(self, motion: _Motion, best: _Motion) -> float:
        """Return −log-likelihood of a motion, at any depth, less the best's, where both see."""
        misfits, noise = [], 2 * (len(self.times) - 1) * self.level.noise
        at_its_depth = self._stepped(motion, _DEPTH_STEPS, held=True).motion
        for compared in (at_its_depth, best):
            aligned, inside, _ = alignment.aligned_frames(self.level, self._places(compared))
            squares = 2 * len(aligned) * gaussian_filter(aligned.var(axis=0), _AROUND_PX)
            misfits.append(np.where(inside, noise * roots.misfit(squares / noise), np.nan))
        return float(np.nansum(misfits[0] - misfits[1]))

    def _start(self, heading: Floats, used: Mask) -> _Motion:
        """Return the rotation and inverse depth with the least L1 residual of Poisson flow."""
        depth_flow = self.translation_flow @ heading
        power = (depth_flow**2).sum(axis=-1)
        power += 1e-2 * power.mean()  # a ridge of 1 %
        inverse_depth, weight = np.zeros(power.shape), used.astype(np.float64)
        for _ in range(_FITS):
            root = np.sqrt(weight)[..., np.newaxis]
            residual = root * (self.flow - inverse_depth[..., np.newaxis] * depth_flow)
            rows = (root[..., np.newaxis] * self.rotation_flow).reshape(-1, 3)
            rotation = np.linalg.lstsq(rows, residual.ravel(), rcond=None)[0]
            residual = self.flow - self.rotation_flow @ rotation
            inverse_depth = np.maximum((residual * depth_flow).sum(axis=-1) / power, 0)
            residual = residual - inverse_depth[..., np.newaxis] * depth_flow
            weight = used / np.maximum(np.linalg.norm(residual, axis=-1), _LEAST_RESIDUAL_PX)
        return _Motion(np.asarray(rotation, np.float64), np.zeros(3), heading, inverse_depth)

    def _stepped(self, motion: _Motion, count: int, *, held: bool = False) -> _Estimate:
        for _ in range(count):
            estimate = self._newton_step(motion, held=held)
            motion = estimate.motion
        return estimate

    def _newton_step(self, motion: _Motion, *, held: bool = False) -> _Estimate:
        """Return the cost of a motion, and a better motion; held, with better depths alone.

        Newton's system of the eight parameters m and the inverse depth ρ of all nodes,

            [ M  Cᵀ ] [ δm ]   [ slope of m ]
            [ C  D  ] [ δρ ] = [ slope of ρ ],

        is solved for δm by the Schur complement M − Cᵀ·D⁻¹·C, the information on m.
        """
        heading, inverse_depth = motion.heading, motion.inverse_depth
        evidence = self.evidence(motion)
        information = np.moveaxis(alignment.to_nodes(evidence.information), 0, -1)
        information = information[..., [[0, 1], [1, 2]]]
        at_nodes = np.stack([alignment.to_nodes(slope) for slope in evidence.slope])
        slopes = np.moveaxis(at_nodes, 1, -1)
        # derivatives of the flow by the eight parameters, and by the inverse depth
        sideways = np.linalg.svd(heading[np.newaxis])[2][1:].T
        turn, near = self.rotation_flow, inverse_depth[..., np.newaxis, np.newaxis]
        motion_flow = np.concatenate((turn, near * (self.translation_flow @ sideways), turn), -1)
        depth_flow = self.translation_flow @ heading
        scale_px = float(np.sqrt((depth_flow**2).sum(axis=-1).mean()))  # of flow per inverse depth
        prior_cost, prior = self._depth_prior(inverse_depth, scale_px)
        weighed = information @ motion_flow
        products = evidence.products[np.ix_(_PATTERN, _PATTERN)]
        M = products * np.einsum("nmki,nmkj->ij", motion_flow, weighed)
        C = products[0] * np.einsum("nmki,nmk->nmi", weighed, depth_flow).reshape(-1, 8)
        of_depth = np.einsum("nmk,nmkl,nml->nm", depth_flow, information, depth_flow)
        diagonal = (products[0, 0] * of_depth).ravel() + _DAMPING * scale_px**2
        nodes = np.arange(inverse_depth.size)
        D = prior + coo_array((diagonal, (nodes, nodes)))
        motion_slope = np.einsum("nmki,inmk->i", motion_flow, slopes[_PATTERN])
        depth_slope = (depth_flow * slopes[0]).sum(axis=-1).ravel() - prior @ inverse_depth.ravel()
        factors = splu(D.tocsc(), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
        solved = factors.solve(np.column_stack((depth_slope, C)))
        schur = M - C.T @ solved[:, 1:]
        schur += np.diag(_DAMPING * np.diag(M) + np.finfo(float).tiny)
        motion_step = np.linalg.solve(schur, motion_slope - C.T @ solved[:, 0]) * (not held)
        depth_step = solved[:, 0] - solved[:, 1:] @ motion_step
        longest = 1.0 / scale_px  # px: longest step
        nearer = inverse_depth + np.clip(depth_step.reshape(inverse_depth.shape), -longest, longest)
        translation = heading + sideways @ motion_step[3:5]
        length = np.linalg.norm(translation)
        misfit = 2 * self.level.noise * (len(self.times) - 1) * evidence.misfit * self.used.size
        better = _Motion(
            motion.rotation + motion_step[:3],
            motion.change + motion_step[5:],
            translation / length,
            np.maximum(nearer, 0) * length,
        )
        return _Estimate(misfit + prior_cost, better, schur)

    def evidence(self, motion: _Motion) -> dense_flow.Evidence:
        """Return the evidence of the frames, aligned by a motion."""
        return dense_flow.evidence(self.level, self._patterns, self._places(motion))

    @property
    def _patterns(self) -> Floats:
        return np.stack((self.times, self.times * (self.times - 1) / 2))

    def _places(self, motion: _Motion) -> Iterator[Floats]:
        """Yield the places (2, H, W) at each time of the content of the reference's pixels."""
        near = _at_pixels(motion.inverse_depth, self.level.roots.shape[1:])
        # rotation of the camera by ω and α
        rotations = self._patterns.T @ np.stack((motion.rotation, motion.change))
        for time, rotation in zip(self.times, rotations, strict=True):
            points = self.directions - time * near[..., np.newaxis] * motion.heading
            turned = Rotation.from_rotvec(-rotation).apply(points.reshape(-1, 3))
            image = self.camera.project(turned.reshape(points.shape)) - 0.5
            image[~self.used] = np.nan
            yield np.nan_to_num(np.moveaxis(image[..., ::-1], -1, 0), nan=-1e6)  # px, out of view

    def _depth_prior(self, inverse_depth: Floats, scale_px: float) -> tuple[float, coo_array]:
        """Return the penalty on the gradient of the inverse depth, and its form (nodes, nodes)."""
        node = np.arange(inverse_depth.size).reshape(inverse_depth.shape)
        first = np.concatenate((node[:, :-1].ravel(), node[:-1].ravel()))
        second = np.concatenate((node[:, 1:].ravel(), node[1:].ravel()))
        change = scale_px * (inverse_depth.ravel()[second] - inverse_depth.ravel()[first])
        weights = dense_flow.link_weights(self.smoothness, change**2)
        places = np.hstack(((first, first), (second, second), (first, second), (second, first)))
        values = np.outer((1, 1, -1, -1), scale_px**2 * weights).ravel()
        form = coo_array((values, tuple(places)), shape=(node.size,) * 2)
        return float((weights * change**2).sum()), form
