"""What a camera sees of the floor and the walls of a room, at any pose: exact, without a renderer."""

import numpy as np
from scipy.spatial.transform import Rotation

WAVES = 60
CORNER = (((0.0, 1.0, 0.0), 1.2), ((0.4, 0.0, 1.0), 4.0))
"""Normals and distances along them (m): a floor, and a wall ahead that is askew"""


def texture(u, v, seed, size):
    """A sum of waves of 0.2 to 2 sizes, contrast 0.3."""
    rng = np.random.default_rng(seed)
    angles, lengths = rng.uniform(0, 2 * np.pi, (2, WAVES)), size * rng.uniform(0.2, 2.0, WAVES)
    k = 2 * np.pi / lengths
    waves = [
        np.cos(k[i] * (np.cos(angles[0, i]) * u + np.sin(angles[0, i]) * v) + angles[1, i])
        for i in range(WAVES)
    ]
    return 0.3 * np.sum(waves, axis=0) / np.sqrt(WAVES / 2)


def view(camera, position, rotation, planes=CORNER):
    """Light (H, W) of mean about 1."""
    rays = rotation.apply(camera.directions().reshape(-1, 3))
    nearest, light = np.full(len(rays), np.inf), np.ones(len(rays))
    for seed, (normal, away_m) in enumerate(planes):
        toward = rays @ np.array(normal)
        reach = np.full(len(rays), np.inf)
        np.divide(away_m - np.dot(normal, position), toward, out=reach, where=toward > 1e-6)
        is_nearer = reach < nearest
        points = position + reach[is_nearer, np.newaxis] * rays[is_nearer]
        across = points[:, 0] if normal[2] else points[:, 2]
        along = points[:, 0] if normal[1] else points[:, 1]
        # waves wider than two pixels
        light[is_nearer] = 1 + texture(across, along, seed, away_m / 4)
        nearest[is_nearer] = reach[is_nearer]
    return light.clip(0.05).reshape(camera.height, camera.width)


def flight(camera, turn_deg, step_m, frames=8, change_deg=(0, 0, 0), planes=CORNER):
    """Frames (T, H, W) of a way straight ahead, the one before the middle at the origin.

    The turn from frame s to the next is `turn_deg` + s·`change_deg`.
    """
    step, turn, change = np.asarray(step_m), np.radians(turn_deg), np.radians(change_deg)
    return np.stack(
        [
            view(
                camera, t * step, Rotation.from_rotvec(t * turn + t * (t - 1) / 2 * change), planes
            )
            for t in np.arange(frames) - (frames // 2 - 1)
        ]
    )


def beside_a_trunk(camera, light, turn_deg, step_m, sideways_m):
    """The frames of a flight with a trunk 1.5 m ahead, 27 % as wide as the view, that may move."""
    rays, times = camera.directions().reshape(-1, 3), np.arange(len(light)) - (len(light) // 2 - 1)
    frames = light.reshape(len(light), -1).copy()
    for frame, time in zip(frames, times, strict=True):
        ahead = Rotation.from_rotvec(time * np.radians(turn_deg)).apply(rays)
        position = time * np.asarray(step_m)
        points = position + ((1.5 - position[2]) / ahead[:, 2])[:, np.newaxis] * ahead
        x = points[:, 0] - 0.2 - time * sideways_m
        on = np.abs(x) < 0.27 * 1.5 * np.tan(np.radians(30))
        frame[on] = (1 + texture(x[on], points[on, 1], 9, 0.3)).clip(0.05)
    return frames.reshape(light.shape)
