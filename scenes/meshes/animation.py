"""Animation of a glTF file's nodes as motion of its objects, interpolated as glTF 2.0 specifies."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal, get_args

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation, Slerp

from megalopta.assets_gen import unit
from megalopta.core.arrays import Floats, Ints
from megalopta.core.bounded import quoted
from megalopta.scenes.motion import Times

Mode = Literal["STEP", "LINEAR", "CUBICSPLINE"]
AT_REST = {"translation": (0.0, 0.0, 0.0), "rotation": (0.0, 0.0, 0.0, 1.0), "scale": (1.0,) * 3}
"""Parts of a node's pose, and their values if the file states none."""


@dataclass(frozen=True)
class Track:
    """Values of a part of a node's pose over time."""

    times_s: Floats
    """(k,): increasing times of the keys."""
    values: Floats
    """(k, d): values; of splines (k, 3, d), between the slopes before and after."""
    mode: Mode = "LINEAR"

    def __post_init__(self) -> None:
        """Reject tracks that are no functions of time."""
        if self.mode not in get_args(Mode):
            raise ValueError(f"an animation is interpolated by {quoted(self.mode)}, which is none")
        if len(self.times_s) != len(self.values) or not len(self.times_s):
            raise ValueError("an animation has not one value for each of its times")
        if not (np.diff(self.times_s) > 0).all() or not np.isfinite(self.values).all():
            raise ValueError("an animation's times do not increase, or its values are not finite")

    def at(self, times_s: Floats, is_rotation: bool) -> Floats:
        """Values (n, d) at times (n,)."""
        times = np.clip(times_s, self.times_s[0], self.times_s[-1])
        if self.mode == "STEP" or len(self.times_s) == 1:
            of_key = self.values if self.mode != "CUBICSPLINE" else self.values[:, 1]
            return of_key[np.searchsorted(self.times_s, times, side="right") - 1]
        if self.mode == "CUBICSPLINE":
            key = np.searchsorted(self.times_s, times, side="right").clip(1, len(self.times_s) - 1)
            span = (self.times_s[key] - self.times_s[key - 1])[:, np.newaxis]
            x = (times - self.times_s[key - 1])[:, np.newaxis] / span
            _, first, leaving = self.values[key - 1].swapaxes(0, 1)
            arriving, second, _ = self.values[key].swapaxes(0, 1)
            rise = x**2 * (3 - 2 * x)
            slopes = (1 - x) ** 2 * x * leaving - (1 - x) * x**2 * arriving
            return np.asarray((1 - rise) * first + rise * second + span * slopes)
        if is_rotation:
            return np.asarray(Slerp(self.times_s, Rotation.from_quat(self.values))(times).as_quat())
        columns = [np.interp(times, self.times_s, column) for column in self.values.T]
        return np.stack(columns, axis=1)


def fixed(value: Any) -> Track:
    """Return a value (d,) as the same at all times."""
    return Track(np.zeros(1), np.array([value], np.float64))


Joint = Mapping[str, Track]
"""A node's pose relative to the one above it: its parts, or its matrix, by columns."""


def poses_of(joint: Joint, times_s: Floats) -> Floats:
    """Poses (n, 4, 4) at times (n,)."""
    if "matrix" in joint:
        matrix = joint["matrix"].at(times_s, False)
        return matrix.reshape(-1, 4, 4).swapaxes(1, 2)
    shift, turn, scale = (joint[part].at(times_s, part == "rotation") for part in AT_REST)
    poses = np.tile(np.eye(4), (len(times_s), 1, 1))
    poses[:, :3, :3] = Rotation.from_quat(turn).as_matrix() * scale[:, None]
    poses[:, :3, 3] = shift
    return poses


@dataclass(frozen=True)
class NodeMotion:
    """Motion of an object with its node."""

    joints: tuple[Joint, ...]
    """Path from the scene's root to the node."""
    rest: Floats
    """(4, 4): pose of the node at rest in the file, from which the object is placed."""
    to_world: Floats
    """(4, 4): map from the file to the world."""

    def moved(self, matrix: Floats) -> "NodeMotion":
        """Return the motion of an object that is placed elsewhere by a map (4, 4)."""
        return replace(self, to_world=matrix @ self.to_world)

    def maps(self, times_s: Floats) -> Floats:
        """Maps (n, 4, 4) from points as placed to those at times (n,)."""
        poses = np.tile(np.eye(4), (len(times_s), 1, 1))
        for joint in self.joints:
            poses = poses @ poses_of(joint, times_s)
        return np.asarray(self.to_world @ poses @ np.linalg.inv(self.to_world @ self.rest))

    def carry(self, points: Floats, time_s: Times) -> Floats:
        """Return points (n, 3) of the object as placed at one time, or each at its own (n,)."""
        return _mapped(self.maps(np.atleast_1d(np.asarray(time_s, np.float64))), points)

    def undo(self, points: Floats, time_s: float) -> Floats:
        """Return points (n, 3) of a time, moved back to the object as placed."""
        return _mapped(inverse(self.maps(np.array([time_s]))), points)

    def turn(self, normals: Floats, points: Floats, time_s: float) -> Floats:
        """Return unit normals (n, 3) at a time."""
        return unit(normals @ inverse(self.maps(np.array([time_s]))[:, :3, :3])[0])

    def record(self) -> dict[str, Any]:
        """Return the motion as numbers, for a file."""
        joints = [
            {
                part: [track.times_s.tolist(), track.values.tolist(), track.mode]
                for part, track in joint.items()
            }
            for joint in self.joints
        ]
        places = {"rest": self.rest.tolist(), "to_world": self.to_world.tolist()}
        return {"kind": "nodes", "joints": joints, **places}

    @classmethod
    def of_record(cls, record: Mapping[str, Any]) -> "NodeMotion":
        """Return the motion of a record. Raises any exception if it is damaged."""
        joints = (
            {
                part: Track(np.array(times), np.array(values), mode)
                for part, (times, values, mode) in joint.items()
            }
            for joint in record["joints"]
        )
        return cls(tuple(joints), np.array(record["rest"]), np.array(record["to_world"]))


@dataclass(frozen=True)
class Skeleton:
    """Nodes that carry a figure, each after the one above it."""

    joints: tuple[Joint, ...]
    above: tuple[int, ...]
    """Number of the joint above each; -1: none."""
    bones: Ints
    """(B,): joints that carry vertices."""
    to_bone: Floats
    """(B, 4, 4): maps from the mesh to the axes of each bone, where the mesh is bound to it."""

    def maps(self, times_s: Floats) -> Floats:
        """Maps (n, B, 4, 4) from the mesh to the file, of each bone, at times (n,)."""
        poses: list[Floats] = []
        for joint, above in zip(self.joints, self.above, strict=True):
            pose = poses_of(joint, times_s)
            poses.append(poses[above] @ pose if above >= 0 else pose)
        return np.stack([poses[bone] for bone in self.bones], axis=1) @ self.to_bone


@dataclass(frozen=True)
class Figure:
    """Skinned or morphed mesh: v(t) = Σ_b w_b · M_b(t) · (v + Σ_k s_k(t) · d_k).

    Of the bones w are weights and M maps, of the shapes s shares and d displacements (glTF 2.0,
    3.7). Normals are those of the bones' mean map.
    """

    skeleton: Skeleton
    vertices: Floats
    """(V, 3): vertices of the mesh, in its own axes."""
    joints: Ints
    """(V, k): bones of each vertex."""
    weights: Floats
    """(V, k): weights of these, which add up to 1."""
    targets: Floats
    """(K, V, 3): displacements of the vertices in each shape."""
    turns: Floats
    """(K, V, 3): changes of the normals in each shape."""
    shares: Track
    """Shares of the shapes."""

    def change(self, of_shapes: Floats, vertex: Ints, times_s: Floats) -> Floats:
        """Sum (n, 3) over the shapes for vertices (n,), at one time or each at its own."""
        shares = np.broadcast_to(self.shares.at(times_s, False), (len(vertex), len(of_shapes)))
        return np.asarray(np.einsum("nk,knj->nj", shares, of_shapes[:, vertex]))

    def maps(self, vertex: Ints, times_s: Floats) -> Floats:
        """Maps (n, 4, 4) from the mesh to the file."""
        moments, moment = np.unique(times_s, return_inverse=True)
        chosen = self.skeleton.maps(moments)[moment.reshape(-1, 1), self.joints[vertex]]
        return np.asarray(np.einsum("nk,nkij->nij", self.weights[vertex], chosen))

    def places(self, vertex: Ints, times_s: Floats) -> Floats:
        """Places (n, 3) in the file."""
        shapes = self.vertices[vertex] + self.change(self.targets, vertex, times_s)
        return _mapped(self.maps(vertex, times_s), shapes)


_AT_ONCE = 5000
"""Vertices that are moved at once, which bounds the memory."""


@dataclass(frozen=True, eq=False)
class FigureMotion:
    """Motion of a figure: every vertex goes its own way, and only vertices can be carried.

    They are known by their places in the object as placed, no two of which are the same.
    """

    figure: Figure
    at_rest: Figure
    placed: Floats
    """(V, 3): vertices as placed."""
    to_world: Floats
    """(4, 4): map from the file to the world."""

    def moved(self, matrix: Floats) -> "FigureMotion":
        """Return the motion of an object that is placed elsewhere by a map (4, 4)."""
        placed = _mapped(matrix[np.newaxis], self.placed)
        return replace(self, to_world=matrix @ self.to_world, placed=placed)

    def carry(self, points: Floats, time_s: Times) -> Floats:
        """Return vertices (n, 3) of the object as placed at one time, or each at its own (n,)."""
        vertex, times = self._vertex(points), np.atleast_1d(np.asarray(time_s, np.float64))
        places = np.empty((len(points), 3))
        for first in range(0, len(points), _AT_ONCE):
            part = slice(first, first + _AT_ONCE)
            places[part] = self.figure.places(
                vertex[part], times if len(times) == 1 else times[part]
            )
        return _mapped(self.to_world[np.newaxis], places)

    def undo(self, points: Floats, time_s: float) -> Floats:
        """Return NaN (n, 3): where a point between vertices was is not known."""
        return np.full_like(points, np.nan)

    def turn(self, normals: Floats, points: Floats, time_s: float) -> Floats:
        """Return unit normals (n, 3) at a time, from those at vertices (n, 3) as placed."""
        vertex, now = self._vertex(points), np.array([time_s])
        maps_at_rest, maps = (
            (self.to_world @ figure.maps(vertex, now))[:, :3, :3]
            for figure in (self.at_rest, self.figure)
        )
        # Back to the mesh, where shapes change them, and out again.
        in_mesh = unit(np.einsum("nij,ni->nj", maps_at_rest, normals))
        in_mesh += self.figure.change(self.figure.turns, vertex, now)
        in_mesh -= self.at_rest.change(self.at_rest.turns, vertex, now)
        return unit(np.einsum("nji,nj->ni", inverse(maps), unit(in_mesh)))

    def record(self) -> dict[str, Any]:
        """Return its kind: the file has the numbers."""
        return {"kind": "figure"}

    @cached_property
    def _places(self) -> cKDTree:
        return cKDTree(self.placed)

    def _vertex(self, points: Floats) -> Ints:
        return np.asarray(self._places.query(points)[1])


def inverse(maps: Floats) -> Floats:
    """Inverse maps; of a shape without size, which nobody sees, the nearest there is."""
    with np.errstate(invalid="ignore"):  # maps of a figure are unknown
        is_flat = np.linalg.det(maps[:, :3, :3]) == 0
    return np.asarray(np.linalg.pinv(maps) if is_flat.any() else np.linalg.inv(maps))


def _mapped(maps: Floats, points: Floats) -> Floats:
    """Points (n, 3) under one map for all, or one for each, (n, 4, 4)."""
    if len(maps) == 1:
        return np.asarray(points @ maps[0, :3, :3].T + maps[0, :3, 3])
    return np.asarray(np.einsum("nij,nj->ni", maps[:, :3, :3], points) + maps[:, :3, 3])
