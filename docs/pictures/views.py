"""Draw views.jpg: forests under natural skies, denoised for display.

Every view is exposed for its own light, unlike any eye or camera at night. One view has a row of
its own, in which its middle third is shown.
"""

from pathlib import Path

import yaml
from denoised import seen

from megalopta.config.model import Configuration
from megalopta.report.images import Row, sheet

HERE = Path(__file__).parent
rows: list[Row] = []
for row in yaml.safe_load((HERE / "views.yaml").read_text("utf-8"))["rows"]:
    parts = {name: Configuration.model_validate(each) for name, each in row.items()}
    pictures = [(name, seen(settings)[0]) for name, settings in parts.items()]
    if len(pictures) == 1:
        ((name, wide),) = pictures
        pictures = [(name, wide.crop((0, wide.height // 6, wide.width, wide.height * 5 // 6)))]
    rows.append(pictures)
sheet(rows, 20).save(HERE.parent / "views.jpg", "JPEG", quality=88)
