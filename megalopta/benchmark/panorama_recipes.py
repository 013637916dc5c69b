"""Four forests seen all around: what the natural stimuli of Chapter 4 are made from.

They stand in for the photographs of Fig. 4.3, which came from the web: forests of four densities in
four lights, with the same fields of view.

The cylindrical camera turns about its axis, so that a turn is a shift of columns at every height.
Its film is as high as makes pixels square at the horizon.
"""

import hashlib
import math
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from megalopta.core.freshness import RENDER_MODEL
from megalopta.core.record import Record
from megalopta.scenes.cameras.panoramic import CylindricalCamera
from megalopta.scenes.forest.description import Forest
from megalopta.scenes.lighting.cloudy_sky import under_clouds
from megalopta.scenes.lighting.light import Light
from megalopta.scenes.trajectories.steady import Trajectory

if TYPE_CHECKING:
    from megalopta.render import RenderNoise

ROWS = 251
"""Rows of every template, and columns of a frame before resizing (thesis, §4.2); a prime."""

LUMINANCE_BAND_NM = (507.0, 614.0)
"""As wide as the photopic V(λ) is when squared off (107 nm), about its centroid of 560 nm."""


class NaturalPanorama(Record, frozen=True):
    """A forest, its light, and how it is rendered all around."""

    forest: Forest
    """What grows."""

    light: Light
    """What lights it; only the directions of light matter, since templates have mean 1."""

    frame_fov_deg: Annotated[float, Field(ge=90, le=180)]
    """Field of view of a frame of 251 columns (degrees); the panorama is 2:1 to 4:1."""

    eye_m: Annotated[float, Field(gt=0)] = 1.6
    """Height of the camera (m)."""

    samples_per_pass: Annotated[int, Field(ge=1)] = 36
    """Light paths per pixel and pass."""

    passes: Annotated[int, Field(ge=2)] = 4
    """Passes that are averaged; from their scatter the noise is known."""

    max_depth: Annotated[int, Field(ge=2)] = 3
    """As of `RenderSettings`; 3 misses 0.2 % of the light of a typical pixel."""

    seed: Annotated[int, Field(ge=0)] = 0
    """Of the rendering noise."""

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
        """Hash of this configuration and of the version of what it describes."""
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
"""By name, in the order of Fig. 4.3 a to d."""


def render_panorama(
    recipe: NaturalPanorama, after_pass: Callable[[], object]
) -> "tuple[NDArray[np.float32], RenderNoise]":
    """Radiance (251, m, 1) in the luminance band, W·m⁻²·sr⁻¹·nm⁻¹, and its noise."""
    # Mitsuba, for which who takes what is shipped does not wait
    from megalopta.render import RenderSettings, RunningMean, SceneRenderer, frame_seed
    from megalopta.scenes import build_scene

    height = recipe.eye_m
    stand = Trajectory(frames=1, position_m=(0, 0, height), look_at_m=(10, 0, height))
    forest = build_scene(recipe.forest, recipe.light, recipe.camera, stand)
    wavelength_nm = sum(LUMINANCE_BAND_NM) / 2
    scene = under_clouds(forest, recipe.light.lighting(), wavelength_nm, recipe.forest.seed)
    # Baked light would be looked up once only: it costs more than the paths it replaces.
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
