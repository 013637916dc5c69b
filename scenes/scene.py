"""Scene as plain frozen data: materials, shapes, their placements, lighting and haze.

Haze is droplets in the air that scatter light. The visibility V is the distance at which a black
object has a contrast of 2 % (Koschmieder 1924, Beiträge zur Physik der freien Atmosphäre 12, 33),
so the extinction is σ = ln 50 / V. Directions follow Henyey and Greenstein (1941, Astrophysical
Journal 93, 70), p = (1 − g²) / (4π·(1 + g² − 2g·cos θ)^(3/2)) with the scattering angle θ. Droplets
of fog and mist are large compared with the wavelength (radii of 1 to 20 µm): extinction is twice
the cross section, and absorption below 1e-5 in the visible, about 2 % at 1.45 µm. Dry, bluish haze
of particles below 0.5 µm is not modeled.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from megalopta.core.arrays import Floats
from megalopta.core.record import Record
from megalopta.scenes.hashed_file import HashedFile
from megalopta.scenes.material import Material
from megalopta.scenes.motion import Motion
from megalopta.scenes.spectra.spectrum import Spectrum, check_known, common_range, total

if TYPE_CHECKING:
    import trimesh

CONTRAST = 0.02
"""Contrast of a black object at the visibility against its background."""


class Haze(Record, frozen=True):
    """Uniform mist or fog, from below the lowest to above the highest object."""

    visibility_m: Annotated[float, Field(ge=1, le=1e6)]
    """Distance at which a black object has a contrast of 2 %; mist has more than 1000, fog less
    (m)."""

    albedo: Annotated[float, Field(ge=0, le=1)] = 1.0
    """Scattered share of the extinction; droplets absorb the rest (1)."""

    asymmetry: Annotated[float, Field(gt=-1, lt=1)] = 0.85
    """Mean cosine of the scattering angle; 0: isotropic; cloud droplets have 0.85 (1)."""

    @property
    def extinction_per_m(self) -> float:
        """Share of a beam's light that is scattered or absorbed, per meter."""
        return math.log(1 / CONTRAST) / self.visibility_m


@dataclass(frozen=True)
class Asset:
    """Shape made of one mesh per material."""

    parts: "Mapping[str, trimesh.Trimesh]"
    """Meshes in meters, with outward normals. Vertex normals in `metadata["smooth"]` are used as
    given; otherwise faces are flat."""


@dataclass(frozen=True)
class Placement:
    """Object: an asset, its species or kind, and its pose."""

    asset: str
    """Key into `Scene.assets`."""
    kind: str
    """Kind of object for readers: "beech", "fern", "ground"."""
    to_world: Floats
    """Rotation, uniform scale and translation (m)."""
    motion: Motion | None = None
    """Motion or bending of the placed object; None: at rest."""
    leaf_shift: float = 0.0
    """Added to the second texture coordinate of translucent parts: a plant's own tone of leaves."""


@dataclass(frozen=True)
class Sun:
    """Distant uniform disc, 0.53° wide: sun or moon. It casts light and is itself invisible."""

    direction: tuple[float, float, float]
    """(x, y, z): unit vector from the scene toward the center of the disc."""
    irradiance: Spectrum
    """Irradiance of a plane facing the disc, W·m⁻²·nm⁻¹."""

    def points(self, count: int) -> Floats:
        """Unit vectors (count, 3) toward points spread evenly over the disc, on a sunflower spiral.

        References
        ----------
        Vogel (1979), Mathematical Biosciences 44:179.
        """
        axis = np.asarray(self.direction)
        across = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
        across /= np.linalg.norm(across)
        index = np.arange(count)
        radius = np.tan(np.radians(0.53) / 2) * np.sqrt((index + 0.5) / count)
        angle = index * np.pi * (3 - np.sqrt(5))
        offset = np.outer(np.cos(angle), across) + np.outer(np.sin(angle), np.cross(axis, across))
        points = axis + radius[:, None] * offset
        return np.asarray(points / np.linalg.norm(points, axis=1, keepdims=True))


@dataclass(frozen=True)
class SkyPattern:
    """Light from all around that depends on direction."""

    radiance: Spectrum
    """Radiance where the pattern is 1, W·m⁻²·sr⁻¹·nm⁻¹."""
    pattern: NDArray[np.float32]
    """(H, 2·H), non-negative equirectangular picture: its center column in direction +x, azimuth
    growing to the left, row 0 at the zenith."""

    def mean(self) -> Spectrum:
        """Mean radiance over all directions, W·m⁻²·sr⁻¹·nm⁻¹."""
        rows = self.pattern.mean(axis=1, dtype=np.float64)
        weight = np.sin(np.pi * (np.arange(len(rows)) + 0.5) / len(rows))
        return self.radiance.scaled(float(np.average(rows, weights=weight)))


def pattern_directions(rows: int) -> Floats:
    """Unit vectors (H, 2·H, 3) toward the centers of a pattern's texels."""
    polar = np.pi * (np.arange(rows) + 0.5) / rows
    azimuth = np.pi - np.pi * (np.arange(2 * rows) + 0.5) / rows
    level = np.sin(polar)
    up = np.repeat(np.cos(polar)[:, None], 2 * rows, axis=1)
    return np.stack(
        [np.outer(level, np.cos(azimuth)), np.outer(level, np.sin(azimuth)), up], axis=-1
    )


@dataclass(frozen=True)
class Environment:
    """Photographed panorama at infinity, in place of a sky."""

    file: HashedFile
    """Equirectangular picture in linear sRGB (HDR, EXR) or sRGB-coded (PNG): its center column is
    in direction +x, azimuth grows to the left, row 0 is the zenith."""
    turn_deg: float
    """Counterclockwise turn about z."""
    spectra: tuple[Spectrum, Spectrum, Spectrum]
    """(red, green, blue): spectrum of one unit of each primary, in any unit."""
    illuminance_lux: float
    """Illuminance of a horizontal plane from its upper half."""


@dataclass(frozen=True)
class Lighting:
    """Light from outside the scene: a uniform sky, patterns added to it, and a panorama or disc."""

    sky: Spectrum
    """Radiance of the uniform sky, W·m⁻²·sr⁻¹·nm⁻¹."""
    sun: Sun | None = None
    patterns: tuple[SkyPattern, ...] = ()
    """Additional light that depends on direction."""
    panorama: Environment | None = None
    """Picture of additional light, which the renderer turns into patterns and a disc."""

    def mean_sky(self) -> Spectrum:
        """Mean radiance of sky and patterns over all directions, W·m⁻²·sr⁻¹·nm⁻¹."""
        return total([self.sky, *(pattern.mean() for pattern in self.patterns)])


@dataclass(frozen=True)
class Lamp:
    """Lamp without size, itself invisible; it shines along the −z axis of its pose."""

    kind: Literal["point", "spot", "directional"]
    light: Spectrum
    """Intensity on the axis, W·sr⁻¹·nm⁻¹; of a directional lamp the irradiance, W·m⁻²·nm⁻¹."""
    pose: Floats
    """(4, 4): its place and axes in the world."""
    cone_deg: tuple[float, float] = (0.0, 45.0)
    """Angles from the axis of a spot at which its light begins to fall, and ends."""


@dataclass(frozen=True)
class Scene:
    """Everything that is rendered, except the camera."""

    materials: Mapping[str, Material]
    """Materials; their names are the keys of `Asset.parts`."""
    assets: Mapping[str, Asset]
    """Shapes, each once however often it is placed."""
    placements: tuple[Placement, ...]
    """Objects; object id = index + 1."""
    lighting: Lighting | None = None
    """Light from outside; None if only surfaces and lamps emit."""
    origin_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """(x, y, z): point near the camera. The renderer's coordinates are relative to it, so that they
    are precise far from the world's origin, too."""
    environment: Environment | None = None
    """Environment seen alone, without noise; one that lights objects belongs to the lighting."""
    haze: Haze | None = None
    """Haze that fills a box around all objects and the camera; None: clear air."""
    notes: tuple[str, ...] = ()
    """Sentences on what its files hold that has no effect."""
    lamps: tuple[Lamp, ...] = ()
    """Lamps without size."""

    def __post_init__(self) -> None:
        """Reject dangling names, objects before a panorama and haze around nothing."""
        if self.environment and (self.placements or self.lighting):
            raise ValueError(
                "scene: an environment excludes objects; let Lighting.panorama light them"
            )
        if self.haze and not self.placements:
            raise ValueError(
                "scene: haze fills the space around objects, and there are none; omit it"
            )
        for placement in self.placements:
            if placement.asset not in self.assets:
                raise ValueError(f"placement of {placement.asset!r}: no such asset in the scene")
        for name, asset in self.assets.items():
            missing = asset.parts.keys() - self.materials.keys()
            if missing:
                raise ValueError(f"asset {name!r}: no material {sorted(missing)} in the scene")

    def check_bands(self, bands_nm: Sequence[tuple[float, float]]) -> None:
        """Raise ValueError for a band in which the light or a material's spectrum is not known."""
        if self.lighting:
            sun = [self.lighting.sun.irradiance] if self.lighting.sun else []
            check_known("light", common_range([self.lighting.mean_sky(), *sun]), bands_nm, "")
        for lamp in self.lamps:
            check_known("a lamp", lamp.light.range_nm, bands_nm, "")
        remedy = "give its reflectance in `materials`, or "
        for name, material in self.materials.items():
            check_known(f"material {name!r}", material.range_nm, bands_nm, remedy)

    @property
    def kinds(self) -> tuple[str, ...]:
        """Names of all kinds of objects, sorted; kind id = index + 1."""
        return tuple(sorted({placement.kind for placement in self.placements}))

    @property
    def is_moving(self) -> bool:
        """True if any object moves."""
        return any(placement.motion for placement in self.placements)

    @property
    def triangle_count(self) -> int:
        """Number of triangles, as placed."""
        faces = {
            name: sum(len(mesh.faces) for mesh in asset.parts.values())
            for name, asset in self.assets.items()
        }
        return sum(faces[placement.asset] for placement in self.placements)
