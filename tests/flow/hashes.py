"""Print a SHA-256 of what every method makes of small fixed counts, to run before a change and after.

python tests/flow/hashes.py > before.txt
"""

import hashlib

import numpy as np
from scipy.ndimage import gaussian_filter

from megalopta.flow import METHODS, camera_motion_with_error, likely_camera_motion, optical_flow
from megalopta.flow.detectors.poisson_flow import PoissonFlow
from megalopta.scenes import PerspectiveCamera

SHAPE = (64, 90)


def counts(photons: float, moved: int, frames: int = 9) -> np.ndarray:
    """Counts (T, H, W) of a texture that moves to the right, before a strip at rest."""
    rng = np.random.default_rng(7)
    texture = gaussian_filter(rng.normal(size=(SHAPE[0], SHAPE[1] + moved * frames)), 1.5)
    light = np.clip(1 + 4 * texture, 0.05, None)
    clips = [light[:, moved * (frames - t) :][:, : SHAPE[1]].copy() for t in range(frames)]
    for clip in clips:
        clip[:, 30:50] = 2 * light[:, :20]
    return rng.poisson(photons * np.stack(clips)).astype(np.uint16)


def say(name: str, *arrays: object) -> None:
    parts = [np.ascontiguousarray(array, np.float64) for array in arrays]
    print(name, hashlib.sha256(b"".join(part.tobytes() for part in parts)).hexdigest())


for photons, moved in ((1.5, 1), (40, 2), (3000, 5)):
    drawn = counts(photons, moved)
    for name, method in METHODS.items():
        say(f"{name} {photons:g} responses", method.respond(drawn))
        if method.gives == "velocity":
            say(f"{name} {photons:g} flow", optical_flow(*drawn[:2], name))
        if isinstance(method, PoissonFlow):
            say(f"{name} {photons:g} covariance", *method.dense_with_covariance(*drawn))
    camera = PerspectiveCamera(width=SHAPE[1], height=SHAPE[0], fov_deg=60)
    seen = likely_camera_motion(drawn, camera)
    say(f"camera {photons:g}", seen.rotation_deg, seen.heading)
motion, error = camera_motion_with_error(
    drawn[:2, :24, :32], PerspectiveCamera(width=32, height=24, fov_deg=60)
)
say("camera error", motion.rotation_deg, motion.heading, error.rotation_deg, error.heading_deg)
