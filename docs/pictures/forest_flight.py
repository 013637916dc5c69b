"""A flight through a forest, for camera_motion.py: light, true yaw rates and steps.

The camera yaws by up to 0.7° per frame, pitches and rolls by up to 0.5°, and flies 10 cm per frame,
up to 30° to the side of its view and 8° upward. Trees 2 m away move by about 2 px per frame. Light
is baked, so its remaining error, 6 %, is fixed to surfaces and moves with them.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from megalopta.core.arrays import Floats
from megalopta.render import RenderSettings, SceneRenderer, frame_seed
from megalopta.scenes import Forest, Light, PerspectiveCamera, Recorded, build_scene

FRAMES, RATE_HZ, STEP_M, CLIMB = 80, 20.0, 0.1, np.radians(8.0)
CAMERA = PerspectiveCamera(width=120, height=120, fov_deg=60)
SETTINGS = RenderSettings(
    samples_per_pixel=128,
    max_depth=4,
    bands_nm=((507.0, 614.0),),
    integrator="baked",
    bake_error=0.06,
)


def flight(seed: int) -> tuple[Floats, Floats, Floats]:
    """Return light (T, H, W) of mean 1, yaw rates (T − 1,), deg/frame, and steps (T − 1, 3)."""
    phase = 2 * np.pi * np.arange(FRAMES) / FRAMES
    look = np.radians(0.7) * FRAMES / (2 * np.pi) * np.sin(phase)
    way = look - np.radians(30.0) * np.sin(phase / 2)
    level = np.cos(CLIMB) * np.column_stack((np.cos(way), np.sin(way)))
    steps = STEP_M * np.column_stack((level, np.full(FRAMES, np.sin(CLIMB))))
    places = np.array([0, 0, 1.6]) + np.cumsum(steps, axis=0) - steps
    nod, roll = 3.0 * np.sin(2 * phase), 3.0 * np.sin(2.5 * phase)
    body = Rotation.from_euler("ZYX", np.column_stack((np.degrees(look), nod, roll)), degrees=True)
    ahead = Rotation.from_matrix([[0, 0, 1], [-1, 0, 0], [0, -1, 0]])  # right, down and forward
    table = np.column_stack((np.arange(FRAMES) / RATE_HZ, places, (body * ahead).as_quat()))
    recording = "\n".join(",".join(f"{value:.9f}" for value in row) for row in table)
    path = Recorded(frames=FRAMES, frame_rate_hz=RATE_HZ, csv=recording)
    forest = Forest.model_validate({"preset": "open", "seed": seed, "trees": 60})
    daylight, poses = Light(level="daylight", disc_fraction=0.3), path.poses()
    scene = build_scene(forest, daylight, CAMERA, path)
    renderer = SceneRenderer(scene, CAMERA, SETTINGS, poses)
    frames = [renderer.radiance(pose, frame_seed(0, at))[..., 0] for at, pose in enumerate(poses)]
    light = np.array(frames, np.float64)
    moved = np.diff(poses[:, :3, 3], axis=0)[:, np.newaxis] @ poses[:-1, :3, :3]
    turns = Rotation.from_matrix(poses[:, :3, :3])
    yaw_deg = (turns[:-1].inv() * turns[1:]).as_rotvec(degrees=True)[:, 1]  # to the right
    return light / light.mean(), yaw_deg, moved[:, 0]
