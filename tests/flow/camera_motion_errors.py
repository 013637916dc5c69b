"""Print true and stated errors of the camera's motion: the table of docs/results/camera-motion.md.

python tests/flow/camera_motion_errors.py FIRST COUNT PHOTONS...
"""

import sys

import numpy as np
from corner import CORNER, beside_a_trunk, flight

from megalopta.flow import camera_motion_with_error
from megalopta.flow.metrics.endpoint_error import angles_deg
from megalopta.scenes import PerspectiveCamera

CAMERA = PerspectiveCamera(width=48, height=40, fov_deg=60)


def window(seed, trunk):
    """Light (8, H, W), turn (deg) and step (m) between a floor and a wall; trunk: speed or None."""
    rng = np.random.default_rng([seed, 4711])
    turn_deg, way, step_m = rng.normal(0, 0.5, 3), rng.normal(size=3), rng.uniform(0.03, 0.08)
    step = step_m * way / np.linalg.norm(way)
    wall = (rng.uniform(-0.5, 0.5), 0.0, 1.0), rng.uniform(3, 8)
    light = flight(CAMERA, turn_deg, step, planes=(CORNER[0], wall))
    if trunk != "none":
        sideways_m = rng.choice([-1, 1]) * rng.uniform(0.02, 0.1)
        light = beside_a_trunk(
            CAMERA, light, turn_deg, step, sideways_m if trunk == "moves" else 0.0
        )
    return light, turn_deg, step


first, count, *photons = map(int, sys.argv[1:])
for trunk in ("moves", "rests", "none"):
    for level in photons:
        errors = []
        for seed in range(first, first + count):
            light, turn_deg, step = window(seed, trunk)
            counts = np.random.default_rng([seed, level, 3]).poisson(level * light)
            motion, error = camera_motion_with_error(counts.astype(np.uint16), CAMERA)
            true = (*(motion.rotation_deg - turn_deg), angles_deg(motion.heading, step))
            errors.append((true, (*error.rotation_deg, error.heading_deg)))
        squares = np.swapaxes(errors, 0, 1) ** 2
        both = np.stack((squares[..., :3].sum(axis=-1), squares[..., 3]))  # of rotation, heading
        rms, median = np.sqrt(both.mean(axis=-1)), np.sqrt(np.median(both, axis=-1))
        largest = np.sqrt((squares[0] / squares[1]).max(axis=-1))
        within = [100 * (largest < limit).mean() for limit in (1, 2, 3)]
        form, rows = "{:.3g}°, {:.3g}° ({:.3g}°, {:.3g}°)", np.hstack((rms, median))
        print("|", trunk, "|", level, *(f"| {form.format(*row)}" for row in rows), "|", *within)
