"""Render the panoramas that the program ships again, all or some by name.

A few minutes each. Stimuli of a benchmark stay: those shipped are of `RENDER_MODEL` 3, and what is
rendered anew changes every result on them. The cylindrical camera turns about its axis, so that a
turn is a shift of columns at every height. The height of its film makes pixels square at the
horizon.
"""

import hashlib
import math
import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from megalopta.assets_gen import generator
from megalopta.assets_gen.tileable_noise import plane_waves
from megalopta.benchmark.panoramas import ROWS, SHIPPED
from megalopta.core.freshness import RENDER_MODEL
from megalopta.core.record import Record
from megalopta.dataset.rendering_noise import ATTRIBUTE
from megalopta.render import (
    RenderNoise,
    RenderSettings,
    RunningMean,
    SceneRenderer,
    frame_seed,
    write_radiance,
)
from megalopta.scenes import build_scene
from megalopta.scenes.cameras.panoramic import CylindricalCamera
from megalopta.scenes.forest.description import Forest
from megalopta.scenes.light import Light
from megalopta.scenes.scene import Lighting, SkyPattern, pattern_directions
from megalopta.scenes.spectra.spectrum import flat
from megalopta.scenes.trajectories.steady import Trajectory

LUMINANCE_BAND_NM = (507.0, 614.0)
"""Box with the area of the photopic V(λ) (107 nm), around its centroid of 560 nm."""
RECIPE = "configurationSha256"
"""Name of the header attribute with the recipe's hash."""


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


RECIPES: Mapping[str, NaturalPanorama] = MappingProxyType(
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


def clouds(seed: int) -> NDArray[np.float32]:
    """Pattern (270, 540) of broken clouds, which light a horizontal plane like an even sky.

    An even sky has no texture, so that detectors do not respond to it. The clouds are a random
    field on a plane at height 1, with wavelengths of 0.25 to 4. Haze halves their contrast where
    the sine of the elevation is 0.12.
    """
    directions = pattern_directions(270)
    up = directions[..., 2]
    height = np.maximum(up, 1e-2)
    field = plane_waves((0.25, 4.0), 1.0, 64, generator(seed, "clouds"))(
        directions[..., :2] / height[..., np.newaxis]
    )
    pattern = 1 + 0.6 * np.tanh(field) * np.where(up > 0, height / (height + 0.12), 0)
    mean = np.average(pattern, weights=np.maximum(up, 0) * np.sqrt(1 - up**2))
    return np.asarray(pattern / mean, np.float32)


def render_panorama(
    recipe: NaturalPanorama, after_pass: Callable[[], object]
) -> tuple[NDArray[np.float32], RenderNoise]:
    """Radiance (251, m, 1) in the luminance band, W·m⁻²·sr⁻¹·nm⁻¹, and its noise."""
    height = recipe.eye_m
    stand = Trajectory(frames=1, position_m=(0, 0, height), look_at_m=(10, 0, height))
    forest = build_scene(recipe.forest, recipe.light, recipe.camera, stand)
    even = recipe.light.lighting()
    sky = SkyPattern(even.sky, clouds(recipe.forest.seed))
    scene = replace(forest, lighting=Lighting(flat(0.0), even.sun, (sky,)))
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


def write_template(
    path: Path, recipe: NaturalPanorama, radiance: NDArray[np.float32], noise: RenderNoise
) -> None:
    """Write a shipped file: (H, W, B) over its mean, in half floats, rounded by 0.05 % at most.

    The mean is in the header, in the record of the noise.
    """
    attributes = {
        "configuration": recipe.model_dump_json(),
        RECIPE: recipe.sha256,
        ATTRIBUTE: noise.to_json(),
        "emissiveUnits": "mean of the panorama",
    }
    light = radiance / radiance.mean(dtype=np.float64)
    write_radiance(path, light, (LUMINANCE_BAND_NM,), attributes, np.float16)


if __name__ == "__main__":
    for name in sys.argv[1:] or RECIPES:
        recipe = RECIPES[name]
        radiance, noise = render_panorama(recipe, lambda: print(".", end="", flush=True))
        write_template(SHIPPED / f"{name}.exr", recipe, radiance, noise)
        print(f" {name}: noise of a pixel {noise.rms_over_mean:.2%} of the mean radiance")
