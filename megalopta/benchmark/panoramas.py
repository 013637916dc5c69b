"""Four forest panoramas, the natural stimuli of Chapter 4.

They replace the photographs of Fig. 4.3, which came from the web: forests of four densities in four
lights, with the same fields of view.

The cylindrical camera turns about its axis, so that a turn is a shift of columns at every height.
The height of its film makes pixels square at the horizon.
"""

import hashlib
import math
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from megalopta.core.errors import UserError, refused_as
from megalopta.core.freshness import RENDER_MODEL
from megalopta.core.record import Record
from megalopta.flow.stimuli.photons import resize
from megalopta.render import read_radiance, write_radiance
from megalopta.scenes.cameras.panoramic import CylindricalCamera
from megalopta.scenes.cloudy_sky import under_clouds
from megalopta.scenes.forest.description import Forest
from megalopta.scenes.light import Light
from megalopta.scenes.spectra.color import LUMINANCE_SHARES
from megalopta.scenes.trajectories.steady import Trajectory

if TYPE_CHECKING:
    from megalopta.render import RenderNoise


ROWS = 251
"""Rows of every template, and columns of a frame before resizing (dissertation, §4.2); a prime."""

LUMINANCE_BAND_NM = (507.0, 614.0)
"""Box with the area of the photopic V(λ) (107 nm), around its centroid of 560 nm."""


class NaturalPanorama(Record, frozen=True):
    """A forest, its light, and the rendering of its panorama."""

    forest: Forest
    """Plants and ground."""
    light: Light
    """Light; only its directions matter, since templates have mean 1."""
    frame_fov_deg: Annotated[float, Field(ge=90, le=180)]
    """Field of view of a frame of 251 columns (degrees); the panorama is 2:1 to 4:1."""
    eye_m: Annotated[float, Field(gt=0)] = 1.6
    """Height of the camera (m)."""
    samples_per_pass: Annotated[int, Field(ge=1)] = 36
    """Light paths per pixel and pass."""
    passes: Annotated[int, Field(ge=2)] = 4
    """Passes that are averaged; their scatter gives the noise."""
    max_depth: Annotated[int, Field(ge=2)] = 3
    """As in `RenderSettings`; 3 misses 0.2 % of the light of a typical pixel."""
    seed: Annotated[int, Field(ge=0)] = 0
    """Seed of the rendering noise."""

    @property
    def camera(self) -> CylindricalCamera:
        """Camera of 251 rows."""
        columns = round(ROWS * 360 / self.frame_fov_deg)
        edge_deg = math.degrees(math.atan(math.pi * ROWS / columns))
        return CylindricalCamera(
            width=columns, height=ROWS, lower_deg=-edge_deg, upper_deg=edge_deg
        )

    @property
    def sha256(self) -> str:
        """Hash of this configuration and of its model version."""
        text = f"{RENDER_MODEL} {self.model_dump_json()}"
        return hashlib.sha256(text.encode()).hexdigest()


NATURAL_PANORAMAS: Mapping[str, NaturalPanorama] = MappingProxyType(
    {
        "open": NaturalPanorama(
            forest=Forest(preset="open", seed=1),
            light=Light(level="daylight", disc_elevation_deg=46, disc_azimuth_deg=140),
            frame_fov_deg=100.4,
        ),
        "dense": NaturalPanorama(
            forest=Forest(preset="dense", seed=2, density_per_ha=800),
            light=Light(level="daylight", disc_elevation_deg=60, disc_azimuth_deg=250),
            frame_fov_deg=120.5,
            passes=8,
        ),
        "understorey": NaturalPanorama(
            forest=Forest(preset="understorey", seed=3),
            light=Light(level="full_moon", disc_elevation_deg=62, disc_azimuth_deg=60),
            frame_fov_deg=160.6,
            passes=6,
        ),
        "clearing": NaturalPanorama(
            forest=Forest(preset="clearing", seed=4, clearance_m=4.5),
            light=Light(
                level="daylight", disc_fraction=0.5, disc_elevation_deg=52, disc_azimuth_deg=300
            ),
            frame_fov_deg=120.5,
        ),
    }
)
"""Panoramas by name, in the order of Fig. 4.3 a to d."""


def render_panorama(
    recipe: NaturalPanorama, after_pass: Callable[[], object]
) -> "tuple[NDArray[np.float32], RenderNoise]":
    """Radiance (251, m, 1) in the luminance band, W·m⁻²·sr⁻¹·nm⁻¹, and its noise."""
    # Mitsuba is slow to import, and not needed for shipped panoramas
    from megalopta.render import RenderSettings, RunningMean, SceneRenderer, frame_seed
    from megalopta.scenes import build_scene

    height = recipe.eye_m
    stand = Trajectory(frames=1, position_m=(0, 0, height), look_at_m=(10, 0, height))
    forest = build_scene(recipe.forest, recipe.light, recipe.camera, stand)
    wavelength_nm = sum(LUMINANCE_BAND_NM) / 2
    scene = under_clouds(forest, recipe.light.lighting(), wavelength_nm, recipe.forest.seed)
    # Baked light would be used only once: it costs more than the paths that it replaces.
    settings = RenderSettings(
        samples_per_pixel=recipe.samples_per_pass,
        max_depth=recipe.max_depth,
        bands_nm=(LUMINANCE_BAND_NM,),
        integrator="path",
    )
    renderer = SceneRenderer(scene, recipe.camera, settings)
    passes = RunningMean()
    for number in range(recipe.passes):
        passes.add(renderer.radiance(stand.poses()[0], frame_seed(recipe.seed, 0, number)))
        after_pass()
    return passes.mean, passes.noise(averaged=recipe.passes)


SHIPPED = Path(__file__).with_name("data") / "panoramas"
RECIPE = "configurationSha256"
"""Name of the header attribute with the recipe's hash."""
WIDEST, NARROWEST = 4.0, 2.0
"""Most and fewest columns per row of a panorama."""


def natural_templates(
    names: Iterable[str] = tuple(NATURAL_PANORAMAS),
) -> dict[str, NDArray[np.float64]]:
    """Return templates (251, m) of the natural stimuli by name. Raises UserError if damaged."""
    return {name: read_template(SHIPPED / f"{name}.exr") for name in names}


def read_template(path: Path) -> NDArray[np.float64]:
    """Template (251, m) in a file of a panorama. Raises UserError if it cannot be read."""
    try:
        radiance, _ = read_radiance(path)
    except ValueError:
        raise UserError(f"{path} is a damaged panorama; install megalopta again") from None
    light = radiance[..., 0].astype(np.float64)
    return np.asarray(light / light.mean())


def write_template(
    path: Path, recipe: NaturalPanorama, radiance: NDArray[np.float32], noise: "RenderNoise"
) -> None:
    """Write a shipped file: (H, W, B) over its mean, in half floats, rounded by 0.05 % at most.

    The mean is in the header, in the record of the noise.
    """
    from megalopta.dataset.rendering_noise import ATTRIBUTE

    attributes = {
        "configuration": recipe.model_dump_json(),
        RECIPE: recipe.sha256,
        ATTRIBUTE: noise.to_json(),
        "emissiveUnits": "mean of the panorama",
    }
    light = radiance / radiance.mean(dtype=np.float64)
    write_radiance(path, light, (LUMINANCE_BAND_NM,), attributes, np.float16)


def template_from_file(path: Path) -> NDArray[np.float64]:
    """Template (251, m) of a panorama of the full circle: HDR or EXR, or PNG, read as sRGB.

    Rows may be equidistant in elevation (equirectangular) or in its tangent (cylindrical): in
    either a turn about the vertical is a shift of columns. Light is binned by area, colors are
    converted to luminance. Raises UserError if the file cannot be read, is not 2:1 to 4:1, is too
    small, or holds invalid values.
    """
    from megalopta.render import activate, choose_variant, read_picture  # Mitsuba reads it

    activate(choose_variant("auto"))
    with refused_as():
        rgb = read_picture(str(path))
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
        raise UserError(f"{path} is black; give a brighter picture")
    resized = resize(light, (ROWS, round(columns * ROWS / rows)), "area")
    return np.asarray(resized / resized.mean())
