"""Animation of a glTF file's nodes as motion of its objects, interpolated as glTF 2.0 specifies."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal, get_args

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation, Slerp

from megalopta.assets_gen import unit
from megalopta.core.arrays import Floats, Ints
from megalopta.core.bounded import quoted
from megalopta.scenes.motion import Times

Mode = Literal["STEP", "LINEAR", "CUBICSPLINE"]
_AT_REST: Mapping[str, Sequence[float]] = {
    "translation": (0, 0, 0),
    "rotation": (0, 0, 0, 1),
    "scale": (1, 1, 1),
}
PARTS = tuple(_AT_REST)
"""Parts of a node's pose."""


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
            return self._on_splines(times)
        if is_rotation:
            return np.asarray(Slerp(self.times_s, Rotation.from_quat(self.values))(times).as_quat())
        columns = [np.interp(times, self.times_s, column) for column in self.values.T]
        return np.stack(columns, axis=1)

    def _on_splines(self, times: Floats) -> Floats:
        """Cubic between keys, whose slope may differ on both sides."""
        key = np.searchsorted(self.times_s, times, side="right").clip(1, len(self.times_s) - 1) - 1
        values = np.empty((len(times), self.values.shape[-1]))
        for first in np.unique(key):
            between, ends = key == first, slice(first, first + 2)
            (_, a, leaving), (arriving, b, _) = self.values[ends]
            curve = CubicHermiteSpline(self.times_s[ends], [a, b], [leaving, arriving])
            values[between] = curve(times[between])
        return values


@dataclass(frozen=True)
class Joint:
    """A node's pose relative to the one above it: at rest, or over time."""

    rest: Floats
    """(4, 4)."""
    parts: Mapping[str, Sequence[float]] = field(default_factory=dict)
    """Parts of the pose at rest, by name."""
    tracks: Mapping[str, Track] = field(default_factory=dict)
    """Parts of it over time, by name."""

    def poses(self, times_s: Floats) -> Floats:
        """Poses (n, 4, 4) at times (n,)."""
        if not self.tracks:
            return np.broadcast_to(self.rest, (len(times_s), 4, 4))
        shift, turn, scale = (self._part(name, usual, times_s) for name, usual in _AT_REST.items())
        poses = np.tile(np.eye(4), (len(times_s), 1, 1))
        poses[:, :3, :3] = Rotation.from_quat(turn).as_matrix() * scale[:, None]
        poses[:, :3, 3] = shift
        return poses

    def _part(self, name: str, usual: Sequence[float], times_s: Floats) -> Floats:
        if name in self.tracks:
            return self.tracks[name].at(times_s, name == "rotation")
        return np.tile(np.asarray(self.parts.get(name, usual), np.float64), (len(times_s), 1))

    def record(self) -> dict[str, Any]:
        """Return the joint as numbers, for a file."""
        parts = {name: list(values) for name, values in self.parts.items()}
        tracks = {
            name: [track.times_s.tolist(), track.values.tolist(), track.mode]
            for name, track in self.tracks.items()
        }
        return {"rest": self.rest.tolist(), "parts": parts, "tracks": tracks}


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
            poses = poses @ joint.poses(times_s)
        return np.asarray(self.to_world @ poses @ np.linalg.inv(self.to_world @ self.rest))

    def carry(self, points: Floats, time_s: Times) -> Floats:
        """Return points (n, 3) of the object as placed at one time, or each at its own (n,)."""
        maps = self.maps(np.atleast_1d(np.asarray(time_s, np.float64)))
        return _mapped(maps, points)

    def undo(self, points: Floats, time_s: float) -> Floats:
        """Return points (n, 3) of a time, moved back to the object as placed."""
        return _mapped(inverse(self.maps(np.array([time_s]))), points)

    def turn(self, normals: Floats, points: Floats, time_s: float) -> Floats:
        """Return unit normals (n, 3) at a time."""
        turned = normals @ inverse(self.maps(np.array([time_s]))[:, :3, :3])[0]
        return unit(turned)

    def record(self) -> dict[str, Any]:
        """Return the motion as numbers, for a file."""
        places = {"rest": self.rest.tolist(), "to_world": self.to_world.tolist()}
        return {"kind": "nodes", "joints": [joint.record() for joint in self.joints], **places}

    @classmethod
    def of_record(cls, record: Mapping[str, Any]) -> "NodeMotion":
        """Return the motion of a record. Raises any exception if it is damaged."""
        joints = []
        for joint in record["joints"]:
            tracks = {
                name: Track(np.array(times), np.array(values), mode)
                for name, (times, values, mode) in joint["tracks"].items()
            }
            joints.append(Joint(np.array(joint["rest"]), joint["parts"], tracks))
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
            pose = joint.poses(times_s)
            poses.append(poses[above] @ pose if above >= 0 else pose)
        return np.stack([poses[bone] for bone in self.bones], axis=1) @ self.to_bone

    @property
    def is_moving(self) -> bool:
        """True if any of its joints moves."""
        return any(joint.tracks for joint in self.joints)


_AT_ONCE = 5000
"""Vertices that are moved at once, which bounds the memory."""


@dataclass(frozen=True, eq=False)
class FigureMotion:
    """Motion of a skinned or morphed object: every vertex goes its own way.

    v(t) = Σ_b w_b · M_b(t) · (v + Σ_k s_k(t) · d_k) with weights w of its bones, their maps M, and
    shares s of displacements d (glTF 2.0, 3.7). Only vertices can be carried. They are known by
    their places in the object as placed, no two of which are the same.
    """

    skeleton: Skeleton
    placed: Floats
    """(V, 3): vertices as placed."""
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
    rest_shares: Floats
    """(K,): shares of the shapes at rest."""
    shares: Track | None
    """Shares over time; None: at rest."""
    to_world: Floats
    """(4, 4): map from the file to the world."""

    @property
    def is_moving(self) -> bool:
        """True if it moves at all."""
        return self.skeleton.is_moving or self.shares is not None

    def moved(self, matrix: Floats) -> "FigureMotion":
        """Return the motion of an object that is placed elsewhere by a map (4, 4)."""
        placed = _mapped(matrix[np.newaxis], self.placed)
        return replace(self, to_world=matrix @ self.to_world, placed=placed)

    def carry(self, points: Floats, time_s: Times) -> Floats:
        """Return vertices (n, 3) of the object as placed at one time, or each at its own (n,)."""
        vertex, times = self._vertex(points), np.atleast_1d(np.asarray(time_s, np.float64))
        places = np.empty((len(points), 3))
        for some in range(0, len(points), _AT_ONCE):
            part = slice(some, some + _AT_ONCE)
            when = times if len(times) == 1 else times[part]
            shapes = self._shaped(self.vertices, self.targets, vertex[part], when)
            places[part] = _mapped(self._maps(vertex[part], when), shapes)
        return places

    def undo(self, points: Floats, time_s: float) -> Floats:
        """Return NaN (n, 3): where a point between vertices was is not known."""
        return np.full_like(points, np.nan)

    def turn(self, normals: Floats, points: Floats, time_s: float) -> Floats:
        """Return unit normals (n, 3) at a time, from those at vertices (n, 3) as placed."""
        vertex, now = self._vertex(points), np.array([time_s])
        # Back to the mesh, where shapes change them, and out again.
        own = unit(np.einsum("nij,ni->nj", self.rest_maps()[vertex, :3, :3], normals))
        change = self._shaped(np.zeros_like(self.vertices), self.turns, vertex, now)
        change -= np.einsum("k,knj->nj", self.rest_shares, self.turns[:, vertex])
        maps = inverse(self._maps(vertex, now)[:, :3, :3])
        return unit(np.einsum("nji,nj->ni", maps, unit(own + change)))

    def record(self) -> dict[str, Any]:
        """Return its kind: the file has the numbers."""
        return {"kind": "figure"}

    def at_rest(self) -> Floats:
        """Vertices (V, 3) of the object as its file poses it without animation."""
        shapes = self.vertices + np.einsum("k,knj->nj", self.rest_shares, self.targets)
        return _mapped(self.rest_maps(), shapes)

    def rest_maps(self) -> Floats:
        """Maps (V, 4, 4) from the mesh to the world, of the pose without animation."""
        joints = tuple(replace(joint, tracks={}) for joint in self.skeleton.joints)
        still = replace(self, skeleton=replace(self.skeleton, joints=joints))
        return still._maps(np.arange(len(self.vertices)), np.zeros(1))

    @cached_property
    def _places(self) -> cKDTree:
        return cKDTree(self.placed)

    def _vertex(self, points: Floats) -> Ints:
        return np.asarray(self._places.query(points)[1])

    def _shaped(self, first: Floats, changes: Floats, vertex: Ints, times_s: Floats) -> Floats:
        shares = np.broadcast_to(self.rest_shares, (len(times_s), len(changes)))
        if self.shares is not None:
            shares = self.shares.at(times_s, False)
        if len(times_s) == 1:
            shares = np.broadcast_to(shares, (len(vertex), len(changes)))
        return np.asarray(first[vertex] + np.einsum("nk,knj->nj", shares, changes[:, vertex]))

    def _maps(self, vertex: Ints, times_s: Floats) -> Floats:
        """Maps (n, 4, 4) from the mesh to the world."""
        moments, moment = np.unique(times_s, return_inverse=True)
        bones = self.to_world @ self.skeleton.maps(moments)
        chosen = bones[moment.reshape(-1, 1), self.joints[vertex]]
        return np.asarray(np.einsum("nk,nkij->nij", self.weights[vertex], chosen))


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
