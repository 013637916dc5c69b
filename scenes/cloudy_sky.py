"""Broken clouds over a scene: a glowing dome with a texture, and the sun as a disc on it.

A uniform sky has no texture: motion detectors do not respond to it, and errors relative to their
response are undefined. Real skies are rarely uniform.

The clouds are a thin deck, a random field on a plane at unit height, so they are smaller and denser
toward the horizon, where haze reduces their contrast. The dome gives a horizontal plane the
irradiance of the uniform sky that it replaces.
"""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from megalopta.assets_gen import Surface, generator, grid_faces
from megalopta.assets_gen.tileable_noise import plane_waves
from megalopta.scenes.material import Emission, Material
from megalopta.scenes.scene import Asset, Lighting, Placement, Scene, Sun
from megalopta.scenes.spectra.spectrum import flat

if TYPE_CHECKING:
    import trimesh

DOME_M = 3000.0
"""Radius of the dome; over 100 m of forest the sun's direction changes by 2°."""
LOWEST_DEG = -6.0
"""Lowest elevation of the dome, below the horizon of any forest."""

_CLOUDS = (0.25, 4.0)
"""Wavelengths of the deck, in units of its height; real ones are some hundred meters to several
kilometers at heights of 1 to 2 km."""
_WAVES = 64
_CONTRAST = 0.6
_HAZE = 0.12
"""Sine of the elevation at which haze halves the contrast."""
_TEXELS = (288, 1080)
_FACETS = (48, 180)
_DISC_FACETS = 48


def under_clouds(scene: Scene, lighting: Lighting, wavelength_nm: float, seed: int) -> Scene:
    """Return the scene lit only by clouds and sun, in place of its own lighting.

    Radiance of the sky and irradiance of the sun are taken at one wavelength, for a flat spectrum.
    """
    glowing = {"sky": (_dome(), Emission(float(lighting.sky(wavelength_nm)), clouds(seed)))}
    if lighting.sun:
        glowing["sun"] = _disc(lighting.sun, wavelength_nm)
    return replace(
        scene,
        materials={
            **scene.materials,
            **{name: Material(flat(0.0), None, light) for name, (_, light) in glowing.items()},
        },
        assets={**scene.assets, **{n: Asset({n: mesh}) for n, (mesh, _) in glowing.items()}},
        placements=(*scene.placements, *(Placement(n, n, np.eye(4)) for n in glowing)),
        lighting=None,
    )


def clouds(seed: int) -> NDArray[np.float32]:
    """Factor (H, W) on the sky's radiance, row 0 at the dome's foot, columns around in azimuth.

    Its mean over the upper hemisphere, times the cosine to the zenith, is 1.
    """
    rows, columns = _TEXELS
    elevation = np.radians(LOWEST_DEG + (90 - LOWEST_DEG) * (np.arange(rows) + 0.5) / rows)
    azimuth = 2 * np.pi * (np.arange(columns) + 0.5) / columns
    height = np.maximum(np.sin(elevation), 1e-2)
    reach = np.cos(elevation) / height
    deck = np.stack([np.outer(reach, np.cos(azimuth)), np.outer(reach, np.sin(azimuth))], -1)
    field = plane_waves(_CLOUDS, 1.0, _WAVES, generator(seed, "clouds"))(deck)
    clearness = np.where(elevation > 0, height / (height + _HAZE), 0)
    pattern = 1 + _CONTRAST * np.tanh(field) * clearness[:, np.newaxis]
    weight = np.where(elevation > 0, np.sin(elevation) * np.cos(elevation), 0)
    mean = np.average(pattern.mean(axis=1), weights=weight)
    return np.asarray(pattern / mean, np.float32)


def _dome() -> "trimesh.Trimesh":
    """Inside of a sphere above the lowest elevation, with the uv square of `clouds`."""
    rows, columns = _FACETS
    v, u = np.meshgrid(np.linspace(0, 1, rows + 1), np.linspace(0, 1, columns + 1), indexing="ij")
    elevation = np.radians(LOWEST_DEG + (90 - LOWEST_DEG) * v)
    level, azimuth = np.cos(elevation), 2 * np.pi * u
    vertices = DOME_M * np.stack(
        [level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], axis=-1
    )
    faces = grid_faces(rows + 1, columns + 1, inward=True)
    uv = np.stack([u.ravel(), v.ravel()], axis=-1)
    return Surface(vertices.reshape(-1, 3), faces, uv).to_mesh()


def _disc(sun: Sun, wavelength_nm: float) -> "tuple[trimesh.Trimesh, Emission]":
    """Regular polygon just inside the dome, facing the scene, with its radiance."""
    import trimesh  # slow

    axis = np.asarray(sun.direction)
    across = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    across /= np.linalg.norm(across)
    distance = 0.99 * DOME_M
    radius = distance * np.tan(np.radians(max(sun.angular_diameter_deg, 1e-3)) / 2)
    angle = -2 * np.pi * np.arange(_DISC_FACETS) / _DISC_FACETS
    rim = np.outer(np.cos(angle), across) + np.outer(np.sin(angle), np.cross(axis, across))
    vertices = np.vstack([np.zeros(3), radius * rim]) + distance * axis
    index = np.arange(_DISC_FACETS)
    faces = np.column_stack([np.zeros_like(index), index + 1, (index + 1) % _DISC_FACETS + 1])
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    radiance = float(sun.irradiance(wavelength_nm)) * distance**2 / float(mesh.area)
    return mesh, Emission(radiance)
