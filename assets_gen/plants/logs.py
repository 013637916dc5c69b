"""Fallen trunks: a tapering, slightly bent tube of bark with two sawn-off ends and some stubs."""

import numpy as np

from megalopta.assets_gen import FloatArray, Surface, cross, join, unit
from megalopta.assets_gen.plants.bark import TILE_M
from megalopta.assets_gen.plants.tube import rotation_minimizing_frames, sweep

SUNK = 0.25
"""How deep a log lies in the litter, in units of its radius."""
STUBS = 5
"""Broken branches of a log."""


def grow_log(rng: np.random.Generator, sides: int = 14) -> tuple[Surface, Surface]:
    """Return bark and end faces of a log along x, 3 to 7 m long, lying on level ground."""
    length, radius = rng.uniform(3, 7), rng.uniform(0.1, 0.2)
    rings = 2 * (sides // 2)
    share = np.linspace(0, 1, rings)
    bend = rng.normal(0, 0.05, 2)
    axis = np.stack(
        [
            length * (share - 0.5),
            length * (bend[0] * np.sin(np.pi * share) + bend[1] * np.sin(2 * np.pi * share)) / 2,
            radius * (1 - SUNK) - 0.25 * radius * share,
        ],
        axis=-1,
    )
    thick = radius * (1 - 0.45 * share)
    lumps = 1 + 0.05 * rng.standard_normal((rings, 1)) + 0.03 * rng.standard_normal((rings, sides))
    profile = thick[:, None] * lumps
    tip = axis[-1:] + np.array([[0.01, 0.0, 0.0]])
    trunk = sweep(np.concatenate([axis, tip]), profile, TILE_M, rng.random(2), whole_tiles=True)
    stubs = [_stub(axis, thick, rng) for _ in range(STUBS)]
    return join([trunk, *stubs]), join([_end(axis, profile, at) for at in (0, rings - 1)])


def _stub(axis: FloatArray, thick: FloatArray, rng: np.random.Generator) -> Surface:
    at = rng.integers(2, len(axis) - 1)
    turn = rng.uniform(-0.3, np.pi + 0.3)
    toward = unit(np.array([rng.uniform(0.2, 0.9), np.cos(turn), np.sin(turn)]))
    length = rng.uniform(0.08, 0.5)
    steps = np.array([0.0, 0.7, 0.95, 1.0])[:, None]
    radius = thick[at] * rng.uniform(0.12, 0.3)
    profile = np.repeat(radius * np.array([[1.2], [0.8], [0.7]]), 5, axis=1)
    line = axis[at] + steps * (thick[at] + length) * toward
    return sweep(line, profile, TILE_M, rng.random(2), whole_tiles=False)


def _end(axis: FloatArray, profile: FloatArray, at: int) -> Surface:
    """Return the flat face at an end of the log, two centimeters outside the bark's own cap."""
    tangents, normals, _ = rotation_minimizing_frames(axis)
    outward = tangents[at] * (1 if at else -1)
    angle = 2 * np.pi * np.arange(profile.shape[1]) / profile.shape[1]
    binormal = cross(outward, normals[at])
    circle = np.cos(angle)[:, None] * normals[at] + np.sin(angle)[:, None] * binormal
    center = axis[at] + 0.02 * outward
    rim = center + 0.97 * profile[at].mean() * circle
    uv = 0.5 + 0.5 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    index = np.arange(len(angle))
    faces = np.stack([np.full_like(index, len(index)), index, np.roll(index, -1)], axis=-1)
    return Surface(np.vstack([rim, center]), faces, np.vstack([uv, [0.5, 0.5]]))
