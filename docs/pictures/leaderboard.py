"""Draw leaderboard.png: photons that each method needs for the velocity of an isolated block.

Dead leaves of 251 rows drift by 3 columns per frame and are resized to 240 × 240 px. Every method
sees each block of 24 × 24 px alone with a margin of 7 px. The number of textures is an argument.
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray

from megalopta.assets_gen import generator
from megalopta.assets_gen.surface_textures import dead_leaves
from megalopta.flow import METHODS, fisher_information
from megalopta.flow.detectors.blocks import BlockDetector, block_grid
from megalopta.flow.metrics import translation_bound as bound
from megalopta.flow.stimuli.moving_template import MovingTemplate
from megalopta.flow.stimuli.photons import draw_counts

SPEED_PX, LEVEL, GRID = 3 * 240 / 251, 0.25, block_grid((240, 240))
FLUXES = np.logspace(3, 7, 13).tolist()
clean = []
for seed in range(int(sys.argv[1]) if len(sys.argv) > 1 else 8):
    texture = dead_leaves((251, 275), generator(seed, "leaderboard"), (3.0, 80.0))
    clean.append(MovingTemplate(texture, 3, 240, "area").light(0, 8))
detectors = [each for each in METHODS.values() if isinstance(each, BlockDetector)]
needed = {}
for detector in detectors:

    def is_good(flux: float, detector: BlockDetector = detector) -> NDArray[np.bool_]:
        counts = (draw_counts(light * flux, 0, "leaderboard", at) for at, light in enumerate(clean))
        found = [bound.confined_velocities(detector, each, GRID, 7) for each in counts]
        return bound.is_within(np.stack(found), (SPEED_PX, 0.0), LEVEL)

    needed[detector] = bound.photons_for_half(is_good, FLUXES)
order = sorted(detectors, key=lambda each: needed[each].photons)
figure, axes = plt.subplots(figsize=(9, 1.5 + 0.3 * len(order)), layout="constrained")
for place, detector in enumerate(order):
    photons, low, high = (min(value, FLUXES[-1]) for value in needed[detector])
    axes.barh(place, photons, color="C0" if detector.name.startswith("P") else "gray")
    axes.plot([low, high], [place, place], "k|-")
information = np.stack([fisher_information(each[-1], GRID)[1:-1, 1:-1] for each in clean])
for frames, dash in ((2, "--"), (8, ":")):
    photons = bound.bound_photons(bound.cramer_rao_covariance(information, frames), SPEED_PX, LEVEL)
    axes.axvline(photons, color="C1", linestyle=dash, label=f"Poisson bound, {frames} frames")
axes.set(xscale="log", xlabel="photons per frame for a median error of 25 %", xlim=(300, 2e7))
axes.set_yticks(range(len(order)), [f"{e.label}, {e.memory_frames + 1} frames" for e in order])
axes.invert_yaxis()
axes.legend()
figure.savefig(Path(__file__).parent.parent / "leaderboard.png", dpi=150)
