"""Four forest panoramas, the natural stimuli of Chapter 4, and panoramas from files.

They replace the photographs of Fig. 4.3, which came from the web: forests of four densities in four
lights, with the same fields of view. `benchmarks/ship_panoramas.py` rendered them.
"""

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np

from megalopta.core.arrays import Floats
from megalopta.core.errors import UserError, refused_as
from megalopta.flow.stimuli.photons import resize
from megalopta.render import read_radiance
from megalopta.scenes.spectra.color import LUMINANCE_SHARES

ROWS = 251
"""Rows of every template, and columns of a frame before resizing (dissertation, §4.2); a prime."""
NATURAL_PANORAMAS: Mapping[str, float] = MappingProxyType(
    {"open": 100.4, "dense": 120.5, "understorey": 160.6, "clearing": 120.5}
)
"""Field of view of a frame of 251 columns (degrees) by name, in the order of Fig. 4.3 a to d."""
SHIPPED = Path(__file__).with_name("data") / "panoramas"


def natural_template(name: str) -> Floats:
    """Return the template (251, m) of a natural stimulus. Raises UserError if it is damaged."""
    path = SHIPPED / f"{name}.exr"
    try:
        radiance, _ = read_radiance(path)
    except ValueError:
        raise UserError(f"{path} is a damaged panorama; install megalopta again") from None
    light = radiance[..., 0].astype(np.float64)
    return np.asarray(light / light.mean())


def template_from_file(path: Path) -> Floats:
    """Template (251, m) of a panorama of the full circle: HDR or EXR, or PNG, read as sRGB.

    Rows may be equidistant in elevation (equirectangular) or in its tangent (cylindrical). Raises
    UserError if the file cannot be read, is not 2:1 to 4:1, is too small, or black.
    """
    from megalopta.render import activate, choose_variant, read_picture  # Mitsuba reads it

    activate(choose_variant("auto"))
    with refused_as():
        rgb = read_picture(str(path))
    light = rgb.astype(np.float64) @ np.array(LUMINANCE_SHARES)
    rows, columns = light.shape
    if not 2 * rows <= columns <= 4 * rows:
        raise UserError(
            f"{path} has {columns} × {rows} pixels; a panorama around the full circle is "
            "2 to 4 times as wide as it is high: crop or stitch it"
        )
    if rows < ROWS:
        raise UserError(f"{path} has {rows} rows; give a panorama of {ROWS} rows or more")
    if not light.any():
        raise UserError(f"{path} is black; give a brighter picture")
    resized = resize(light, (ROWS, round(columns * ROWS / rows)), "area")
    return np.asarray(resized / resized.mean())
