"""Templates of the natural stimuli: panoramas rendered by this project, or a file of the user's.

A template is a float64 array (251, m), a full turn, with mean 1: column m follows column 0. Linear
in light, as a photon count is. The four forests come with this package, in half floats, each file
with the hash of its recipe. A recipe that fits no such file is rendered, once, into the user's
cache folder; one that changed makes a new file. `megalopta check panoramas` renders them again.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from megalopta.benchmark.panorama_recipes import (
    LUMINANCE_BAND_NM,
    NATURAL_PANORAMAS,
    ROWS,
    NaturalPanorama,
    render_panorama,
)
from megalopta.core import files
from megalopta.core.errors import UserError
from megalopta.core.folders import cache_folder, locked
from megalopta.core.progress import progress
from megalopta.flow.stimuli.resizing import resize
from megalopta.render import read_attributes, read_radiance, write_radiance
from megalopta.scenes.spectra.color import LUMINANCE_SHARES

if TYPE_CHECKING:
    from megalopta.render import RenderNoise

SHIPPED = Path(__file__).with_name("data") / "panoramas"
RECIPE = "configurationSha256"
"""Name of the header attribute with the hash of the recipe."""
WIDEST, NARROWEST = 4.0, 2.0
"""Columns per row of a panorama, at most and at least."""


def natural_templates(
    cache: Path | None = None, panoramas: Mapping[str, NaturalPanorama] = NATURAL_PANORAMAS
) -> dict[str, NDArray[np.float64]]:
    """Templates (251, m) of the natural stimuli by name; what is not there yet is rendered.

    The cache is by default the user's. Raises UserError when it cannot be a folder, or a file in it
    cannot be read.
    """
    paths = {name: panorama_file(name, recipe, cache) for name, recipe in panoramas.items()}
    absent = [path for path in paths.values() if not path.exists()]
    if absent:
        with locked(absent[0].parent):
            files.sweep(absent[0].parent)
            _render_absent(paths, panoramas)
    return {name: read_template(path) for name, path in paths.items()}


def _render_absent(paths: Mapping[str, Path], panoramas: Mapping[str, NaturalPanorama]) -> None:
    """Render what is not there, which another process may have done meanwhile."""
    absent = [name for name, path in paths.items() if not path.exists()]
    passes = sum(panoramas[name].passes for name in absent)
    with progress("Rendering forest panoramas", passes, "exposure") as advance:
        for name in absent:
            radiance, noise = render_panorama(panoramas[name], advance)
            attributes = _attributes(panoramas[name], noise)
            write_radiance(paths[name], radiance, (LUMINANCE_BAND_NM,), attributes)


def panorama_file(name: str, recipe: NaturalPanorama, cache: Path | None = None) -> Path:
    """File of a panorama: the shipped one if it shows the recipe, else one in the cache.

    The latter may not be there yet.
    """
    shipped = SHIPPED / f"{name}.exr"
    if shipped.exists() and _recipe_of(shipped) == recipe.sha256:
        return shipped
    return cache_folder(cache) / "panoramas" / f"{name}-{recipe.sha256[:12]}.exr"


def read_template(path: Path) -> NDArray[np.float64]:
    """Template (251, m) in a file of a panorama. Raises UserError when it cannot be read."""
    try:
        radiance, _ = read_radiance(path)
    except ValueError:
        raise UserError(
            f"{path} is no panorama as it was written; remove it, and it is rendered again"
        ) from None
    return _with_mean_1(radiance[..., 0].astype(np.float64))


def write_template(
    path: Path, recipe: NaturalPanorama, radiance: NDArray[np.float32], noise: "RenderNoise"
) -> None:
    """Write what is shipped: (H, W, B) over its mean, in half floats, rounded by 0.05 % at most.

    The mean stands in the header, in the record of the noise.
    """
    attributes = {**_attributes(recipe, noise), "emissiveUnits": "mean of the panorama"}
    light = radiance / radiance.mean(dtype=np.float64)
    write_radiance(path, light, (LUMINANCE_BAND_NM,), attributes, np.float16)


def template_from_file(path: Path) -> NDArray[np.float64]:
    """Template (251, m) of a panorama around the full circle: HDR or EXR, or PNG, read as sRGB.

    Rows may be equidistant in elevation (equirectangular) or in its tangent (cylindrical): in
    either a turn about the vertical is a shift of columns. Light is binned by area; of color the
    luminance counts. Raises UserError when the file cannot be read, is not 2:1 to 4:1 or too small,
    or holds values that are no light.
    """
    from megalopta.render import activate, choose_variant, read_picture  # Mitsuba reads it

    activate(choose_variant("auto"))
    try:
        rgb = read_picture(str(path))
    except ValueError as problem:
        raise UserError(str(problem)) from None
    light = rgb.astype(np.float64) @ np.array(LUMINANCE_SHARES)
    rows, columns = light.shape
    if not NARROWEST * rows <= columns <= WIDEST * rows:
        raise UserError(
            f"{path} has {columns} × {rows} pixels; a panorama around the full circle is "
            f"{NARROWEST:g} to {WIDEST:g} times as wide as it is high: crop or stitch it"
        )
    if rows < ROWS:
        raise UserError(f"{path} has {rows} rows; give a panorama of {ROWS} rows or more")
    if not light.any():
        raise UserError(f"{path} is black; give a picture with light in it")
    return _with_mean_1(resize(light, (ROWS, round(columns * ROWS / rows)), "area"))


def _attributes(recipe: NaturalPanorama, noise: "RenderNoise") -> dict[str, str]:
    from megalopta.dataset.rendering_noise import ATTRIBUTE

    return {
        "configuration": recipe.model_dump_json(),
        RECIPE: recipe.sha256,
        ATTRIBUTE: noise.to_json(),
    }


def _recipe_of(path: Path) -> str | None:
    try:
        return read_attributes(path).get(RECIPE)
    except ValueError:
        return None  # what cannot be read is rendered again


def _with_mean_1(light: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(light / light.mean())
