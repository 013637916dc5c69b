"""Draw gallery.png: ten scenes at every light level, above the counts of an ideal sensor in 2 ms.

A scene is rendered at every level, denoised for display and exposed for its own light. Counts are
drawn from the light as rendered. It takes half an hour on two cores.
"""

from pathlib import Path
from typing import Any

from denoised import gray_counts, seen
from PIL import Image

from megalopta.config.model import Configuration
from megalopta.core.quantities import number
from megalopta.report.images import write_sheet
from megalopta.report.text import level_name, lux
from megalopta.scenes.levels import LEVELS

PRESETS = "open", "dense", "understorey", "clearing", "rainforest", "trail"
SIZE_PX, TURN = (196, 131), {"frames": 2, "rotation_deg_s": 15}
SCENES: dict[str, Any] = {
    **{f"{name} forest": ({"kind": "forest", "preset": name}, {}) for name in PRESETS},
    "grating": ({"kind": "grating"}, TURN),
    "random dots": ({"kind": "grating", "pattern": "dots"}, TURN),
    "board": ({"kind": "plane", "pattern": "square"}, {}),
    "motion bench": ({"kind": "motion_bench", "edge_mm": -5}, {"velocity_m_s": [0, -1e-3, 0]}),
}
rows = []
for name, (scene, path) in SCENES.items():
    views, counted = [], []
    for level, light in LEVELS.items():
        parts = {
            "scene": scene,
            "light": {"level": level},
            "camera": {"width": 270, "height": 180, "fov_deg": 75},
            "trajectory": {"frames": 2, "look_at_m": [10, 0, 1.8], **path},
            "render": {"samples_per_pixel": 128, "integrator": "path"},
            "sensors": [{"preset": "ideal", "exposure_s": 2e-3}],
        }
        view, counts, _ = seen(Configuration.model_validate(parts))
        title = f"{level_name(level)}, {lux(light.illuminance_lux)}"
        views.append((title, view.resize(SIZE_PX)))
        shown = gray_counts(counts).resize(SIZE_PX, Image.Resampling.BOX)
        counted.append((f"{name}: {number(float(counts.mean()))} photons", shown))
    rows += [views, counted]
write_sheet(Path(__file__).parent.parent / "gallery.png", rows)
