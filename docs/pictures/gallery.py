"""Draw gallery.png: one forest at five light levels, and what an ideal sensor counts in 2 ms.

Every level is rendered with the same samples, denoised for display and exposed for its own light.
Counts are drawn from the light as rendered.
"""

from pathlib import Path

from denoised import gray_counts, seen

from megalopta.config.model import Configuration
from megalopta.core.quantities import number
from megalopta.report.images import Row, sheet
from megalopta.report.text import level_title
from megalopta.scenes.levels import LevelName

LEVELS: tuple[LevelName, ...] = "daylight", "twilight", "full_moon", "quarter_moon", "starlight"

rows: list[Row] = []
for level in LEVELS:
    parts = {
        "scene": {"kind": "forest", "preset": "open"},
        "light": {"level": level, "sky": "natural", "disc_azimuth_deg": 150},
        "camera": {"width": 408, "height": 272, "fov_deg": 75},
        "trajectory": {"frames": 2, "look_at_m": [10, 0, 1.8]},
        "render": {"samples_per_pixel": 192, "integrator": "path"},
        "sensors": [{"preset": "ideal", "exposure_s": 2e-3}],
    }
    view, counts, _ = seen(Configuration.model_validate(parts))
    counted = f"{number(float(counts.mean()))} photons per pixel"
    rows.append([(level_title(level), view), (counted, gray_counts(counts))])
sheet(rows, 20).quantize(256).save(Path(__file__).parent.parent / "gallery.png", optimize=True)
