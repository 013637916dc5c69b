"""Colors of the gallery's pictures: those of all figures, for color-blind readers."""

from typing import Any

import matplotlib
from cycler import cycler

from megalopta.report.style import PALETTE


def use_palette(gallery_conf: dict[str, Any], name: str) -> None:
    """Set the colors of curves before a script runs; sphinx-gallery calls this."""
    matplotlib.rcParams["axes.prop_cycle"] = cycler(color=PALETTE)
