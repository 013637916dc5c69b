"""Print statistics of log radiance in views of the forests, and of photographed panoramas.

    python docs/pictures/image_statistics.py [forest.hdr …]

Four views of 75° from 1.6 m, in daylight: mean and standard error. A pixel sees 0.3°, or two pixels
of the coarsest photograph. It takes an hour on two cores.
"""

import math
import sys
from dataclasses import fields
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter

from megalopta.config.model import Configuration
from megalopta.flow.stimuli.statistics import PASSES, LogStatistics, log_statistics, unlit_share
from megalopta.render import SceneRenderer, frame_seed, read_picture
from megalopta.stages.render import build

FOV_DEG, DIRECTIONS, BLUR_PX, SAMPLES = 75.0, 4, 0.7, 64
coarsest = max((360 / read_picture(name).shape[1] for name in sys.argv[1:]), default=0.0)
side_px = round(FOV_DEG / max(0.3, 0.05 * math.ceil(2 * coarsest / 0.05)))
photographs = {Path(name).stem: {"kind": "panorama", "file": name} for name in sys.argv[1:]}
presets = "open", "clearing", "dense", "understorey", "rainforest", "trail"
forests = {name: {"kind": "forest", "preset": name} for name in presets}
for name, scene in {**photographs, **forests}.items():
    sky = {"sky": "natural", "disc_azimuth_deg": 150} if name in forests else {}
    parts = {
        "scene": scene,
        "light": {"level": "daylight", **sky},
        "camera": {"width": side_px, "height": side_px, "fov_deg": FOV_DEG},
        "trajectory": {"frames": DIRECTIONS, "frame_rate_hz": 1, "rotation_deg_s": 360 / DIRECTIONS,
                       "position_m": [0, 0, 1.6], "look_at_m": [10, 0, 1.6]},
        "render": {"samples_per_pixel": SAMPLES, "integrator": "path", "bands_nm": [[507, 614]]},
    }  # fmt: skip
    settings = Configuration.model_validate(parts)
    renderer = SceneRenderer(build(settings), settings.camera, settings.render)
    found: dict[str, list[LogStatistics]] = {"as rendered": [], "blurred": []}
    for frame, pose in enumerate(settings.trajectory.poses()):
        seeds = [frame_seed(0, frame, repeat) for repeat in range(PASSES)]
        light = [renderer.radiance(pose, seed)[..., 0].astype(float) for seed in seeds]
        found["as rendered"].append(log_statistics(light))
        found["blurred"].append(log_statistics([gaussian_filter(one, BLUR_PX) for one in light]))
        print(f"{name}, view {frame}: {unlit_share(light):.2%} of the pixels met no light")
    for how, views in found.items():
        for field in fields(LogStatistics):
            values = np.array([getattr(each, field.name) for each in views])
            error = values.std(ddof=1) / DIRECTIONS**0.5
            print(f"{name}, {how}: {field.name} {values.mean():.3g} ± {error:.1g}")
