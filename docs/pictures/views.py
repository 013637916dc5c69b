"""Draw views.jpg: forests under natural skies, denoised for display, and counts by starlight.

Every view is exposed for its own light, unlike any eye or camera at night. Counts are drawn from
the light as rendered.
"""

from pathlib import Path

import yaml
from denoised import gray_counts, seen

from megalopta.config.model import Configuration
from megalopta.report.images import sheet

HERE = Path(__file__).parent
pictures = []
for title, parts in yaml.safe_load((HERE / "views.yaml").read_text("utf-8"))["views"].items():
    view, counts, exposure_s = seen(Configuration.model_validate(parts))
    pictures.append((title, view))
    if "sensors" in parts:
        mean = f"{counts.mean():.2g} photons per pixel in {exposure_s:g} s"
        pictures.append((f"{title}: {mean}", gray_counts(counts)))
rows = [pictures[at : at + 2] for at in range(0, len(pictures), 2)]
sheet(rows).save(HERE.parent / "views.jpg", "JPEG", quality=88)
