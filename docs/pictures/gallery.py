"""Draw gallery.jpg: the twelve pictures of the gallery on one sheet; run `make docs` before."""

from pathlib import Path

from PIL import Image

from megalopta.report.images import sheet

DOCS = Path(__file__).parent.parent
pictures = []
for path in sorted(DOCS.glob("generated/gallery/images/sphx_glr_plot_*_001.png")):
    picture = Image.open(path).convert("RGB").resize((480, 270), Image.Resampling.LANCZOS)
    pictures.append(("", picture))
rows = [pictures[first : first + 3] for first in range(0, 12, 3)]
sheet(rows).save(DOCS / "gallery.jpg", quality=88)
