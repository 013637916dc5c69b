"""Is the camera's motion right within its stated error, with a mover over 27 % of the view?

Windows of eight frames, 48 × 40 px, of a floor and one or three walls at random distances. The
camera turns by up to 0.6° about each axis and moves by 6 cm per frame in a random direction near
the horizontal. A trunk 1.5 m ahead, 27 % as wide as the view, moves sideways by 3 to 10 cm per
frame; with `--trunk rest` it stands still, with `none` there is none. Each window has 3, 10, 30 or
100 photons per pixel. For each window the errors of rotation (largest of three axes) and heading
are printed, in degrees and over the stated ones; at the end their medians, and the shares of
windows within one, two and three stated errors.

    python -m benchmarks.bench_mover

Takes 2 to 3 CPU-s a window.
"""

import argparse

import numpy as np

from megalopta.core.arrays import Floats
from megalopta.flow.egomotion.camera_motion import camera_motion_with_error
from megalopta.flow.metrics.endpoint_error import angles_deg
from megalopta.scenes import PerspectiveCamera
from tests.flow.egomotion.corner import beside_a_trunk, flight

CAMERA = PerspectiveCamera(width=48, height=40, fov_deg=60)
FLUXES = 3.0, 10.0, 30.0, 100.0
STEP_M = 0.06


def planes(rng: np.random.Generator) -> list:
    """Normals and distances of a floor, a wall ahead and, in half of the cases, two at the sides"""
    ahead = [((0.0, 1.0, 0.0), rng.uniform(1, 1.6)), ((0.4, 0.0, 1.0), rng.uniform(3, 9))]
    sides = [((x, 0.0, 0.0), rng.uniform(2, 3)) for x in (1.0, -1.0)]
    return ahead + sides * int(rng.integers(2))


def window(number: int, trunk: str) -> Floats:
    """True and stated errors of rotation (largest of its axes) and heading; their ratios."""
    rng = np.random.default_rng(number)
    turn_deg = rng.uniform(-0.6, 0.6, 3)
    angle, up = rng.uniform(0, 2 * np.pi), rng.uniform(-0.3, 0.3)
    step_m = STEP_M * np.array([np.cos(angle), up, np.sin(angle)]) / np.hypot(1, up)
    walls, sideways_m = planes(rng), rng.choice((-1, 1)) * rng.uniform(0.03, 0.1)
    light = flight(CAMERA, turn_deg, step_m, planes=walls)
    if trunk != "none":
        is_moving = trunk == "moving"
        light = beside_a_trunk(CAMERA, light, turn_deg, step_m, sideways_m * is_moving)
    counts = rng.poisson(FLUXES[number % len(FLUXES)] * light)
    motion, stated = camera_motion_with_error(counts, CAMERA)
    turns = np.abs(motion.rotation_deg - turn_deg)
    heading = float(angles_deg(motion.heading[np.newaxis], step_m / STEP_M)[0])
    relative = max(turns / stated.rotation_deg), heading / stated.heading_deg
    stated_deg = max(stated.rotation_deg), min(stated.heading_deg, 180.0)
    return np.array([turns.max(), heading, *stated_deg, *relative])


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--windows", type=int, default=500)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--trunk", choices=("moving", "rest", "none"), default="moving")
    asked = parser.parse_args()
    found = np.empty((asked.windows, 6))
    for place in range(asked.windows):
        number = asked.first + place
        found[place] = errors = window(number, asked.trunk)
        figures = "  ".join(f"{each:8.3f}" for each in errors)
        print(f"{number:4}  {FLUXES[number % len(FLUXES)]:4g}  {figures}", flush=True)
    print("photons, windows: true and stated errors in degrees (medians of rotation and heading)")
    print("% of windows within one, two, three stated errors")
    for flux in range(len(FLUXES)):
        some = found[(np.arange(asked.first, asked.first + asked.windows) % len(FLUXES)) == flux]
        if not len(some):
            continue
        within = [100 * (some[:, 4:].max(axis=1) < limit).mean() for limit in (1, 2, 3)]
        middle = np.median(some[:, :4], axis=0)
        print(f"{FLUXES[flux]:4g}  {len(some)}: {middle.round(2)}  {np.round(within, 1)}")
