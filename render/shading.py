"""Light of the surfaces that rays see, in bands: textures, the sun's disc, and the sky.

A diffuse surface with reflectance ρ under irradiance E emits L = ρE/π in all directions, and E/π is
the mean radiance from cosine-distributed directions. A side of a translucent surface emits
(ρ·E + τ·E′)/π, with the irradiance E′ of the other side: rays are split between the sides roughly
as ρ to τ. Band means are of ρE/π, not of ρ and E: within a band, the correlation of green leaves
and green light amounts to several percent.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats
from megalopta.render import Bands, dr, mi
from megalopta.render.loading.materials import bitmap, interface
from megalopta.render.loading.meshes import MergedMesh
from megalopta.render.loading.scene import DISC_POINTS
from megalopta.render.loading.sky import EvenDirections, SkyPatterns
from megalopta.scenes.material import Material
from megalopta.scenes.scene import Lighting, Scene, Sun
from megalopta.scenes.spectra.color import band_means
from megalopta.scenes.spectra.spectrum import Spectrum, flat

WAVELENGTHS = 2**8
"""Wavelengths in a band, of which each path takes one."""
_LEAST_SHARE = 0.25
"""Smallest share of rays for either side of a translucent surface: bands differ."""


def spectra_of(materials: Iterable[Material]) -> int:
    """Number of spectra that the textures of some materials mix, 2 at least."""
    return 1 + max((len(look.texture.spectra) for look in materials if look.texture), default=1)


def scattered(material: Material, spectra: int) -> list[Spectrum]:
    """Reflectance where the texture's weights are 0, where each is 1, and transmittance alike."""
    if material.emission:
        return [flat(0.0)] * (2 * spectra)
    first = material.reflectance, material.transmittance
    ends = [first, *(material.texture.spectra if material.texture else ())]
    ends += [first] * (spectra - len(ends))
    return [*(back for back, _ in ends), *(through or flat(0.0) for _, through in ends)]


def mixed(ends: Sequence[Any], weights: Sequence[Any]) -> Any:
    """Mean of the first value and others, each with its weight; the first has the rest."""
    first, *further = ends
    value = first
    for end, weight in zip(further, weights, strict=True):
        value = dr.fma(end, weight, dr.fma(first, -weight, value))  # of one, `dr.lerp`
    return value


class Scattering:
    """Response of M materials in B bands to light on this side (0) and on the other (1)."""

    def __init__(self, materials: Sequence[Material], bands_nm: Bands) -> None:
        self.spectra = spectra_of(materials)
        """Number of spectra that textures mix."""
        places = (np.arange(WAVELENGTHS) + 0.5) / WAVELENGTHS
        self._grids = [lower + (upper - lower) * places for lower, upper in bands_nm]
        table = [
            [[curve(grid) for grid in self._grids] for curve in scattered(material, self.spectra)]
            for material in materials
        ]
        shape = len(materials), 2, self.spectra, len(bands_nm), WAVELENGTHS
        self._table = np.reshape(table, shape)
        means = self._table.mean(axis=(2, 3, 4))
        total = means.sum(axis=1)
        through = np.divide(means[:, 1], total, out=np.zeros(len(total)), where=total > 0)
        through = np.where(through > 0, through.clip(_LEAST_SHARE, 1 - _LEAST_SHARE), 0)
        self.through: Floats = through
        """(M,): share of rays that leave from the other side."""
        shares = np.stack([1 - through, through], axis=1)
        self._weight = np.divide(1, shares, out=np.zeros_like(shares), where=shares > 0)

    def of_rays(self) -> Floats:
        """Weight (M, 2 sides, spectra, B, WAVELENGTHS) of the light that a ray brings."""
        return np.asarray(self._table * self._weight[:, :, None, None, None])

    def under(self, skies: Sequence[Spectrum]) -> Floats:
        """Radiance (M, 2 sides, S, spectra · B) due to each side's share of S skies.

        It is divided by the side's share of rays.
        """
        radiances = [self._under(sky) * self._weight[:, :, None] for sky in skies]
        return np.stack(radiances, axis=2)

    def brightness(self, sky: Spectrum) -> Floats:
        """Brightness (M,) of materials under the sky, relative to the brightest; 1 in the dark."""
        total = self._under(sky).sum(axis=(1, 2))
        return np.asarray(total / total.max() if total.any() else np.ones(len(total)))

    def _under(self, sky: Spectrum) -> Floats:
        light = np.array([sky(grid) for grid in self._grids])
        return np.asarray(np.mean(self._table * light, axis=-1)).reshape(len(self._table), 2, -1)


# Wavelengths per band mean.
_GRID = 2**10
_BELOW_ONE = 1 - 2**-24

Weights = Sequence[Any]
"""Weights (N,) of spectra after the first, in Mitsuba's types."""


@dataclass(frozen=True)
class Sight:
    """Surfaces seen by N rays, in Mitsuba's types."""

    point: Any
    front: Any
    """True where the ray meets the front side."""
    shaded: Any
    """True where a surface was hit that does not emit: where `mesh` is valid."""
    mesh: Any
    """Index of the mesh, as loaded."""

    @property
    def sky(self) -> Any:
        """1 where a ray hits nothing."""
        return dr.select(self.point.is_valid(), 0.0, 1.0)


def side_of(sight: Sight, through: Any) -> Any:
    """Row of meshes and their two sides: the first for reflected light."""
    return 2 * sight.mesh + dr.select(through, mi.UInt(1), mi.UInt(0))


class Table:
    """Values (rows, spectra, B bands, places in a band or 1) on Mitsuba's device."""

    def __init__(self, values: Floats, bands: int, spectra: int) -> None:
        self._values, self._bands = mi.Float(values.astype(np.float32).ravel()), bands
        self._places = values.shape[-1] if values.ndim > 4 else 1
        self._spectra = spectra

    def read(self, row: Any, weights: Weights, active: Any, place: Any = 0) -> list[Any]:
        """Value of each band in rows, mixed of all spectra by the weights of a texture."""

        def of_spectrum(number: int, band: int) -> Any:
            column = (self._spectra * row + number) * self._bands + band
            return dr.gather(mi.Float, self._values, column * self._places + place, active)

        numbers = range(self._spectra)
        return [
            mixed([of_spectrum(number, band) for number in numbers], weights)
            for band in range(self._bands)
        ]


class Textures:
    """Weights of the spectra after the first on all meshes."""

    def __init__(self, scene: Scene, meshes: Sequence[MergedMesh]) -> None:
        materials = [scene.materials[mesh.material] for mesh in meshes]
        textures = [material.texture for material in materials]
        self._colors = spectra_of(materials) > 2
        weights = {id(look.weight): look.weight for look in textures if look}
        place = {key: index for index, key in enumerate(weights)}
        plain = len(weights)
        self._texture = mi.UInt([place[id(look.weight)] if look else plain for look in textures])
        self._weights = [self._reader(weight) for weight in weights.values()]
        self._weights.append(lambda _point, _active: self._weight(0.0))

    def _reader(self, weight: NDArray[np.float32]) -> Callable[[Any, Any], Any]:
        loaded = mi.load_dict(bitmap(weight))
        if weight.ndim > 2:
            return lambda point, active: loaded.eval_3(point, active)
        return lambda point, active: self._weight(loaded.eval_1(point, active))

    def _weight(self, first: Any) -> Any:
        return mi.Color3f(first, 0.0, 0.0) if self._colors else mi.Float(first)

    def weights(self, sight: Sight) -> Weights:
        """Weights (N,) at the points seen by rays: of one spectrum, or of three."""
        texture = dr.gather(mi.UInt, self._texture, sight.mesh, sight.shaded)
        values = dr.switch(texture, self._weights, sight.point, sight.shaded)
        return list(values) if self._colors else [values]


class Shine:
    """Response of glossy leaves' interface, in addition to what is diffuse."""

    def __init__(self, materials: Sequence[Material]) -> None:
        slopes = [material.gloss or 0.0 for material in materials]
        self._slopes = mi.Float(slopes) if any(slopes) else None

    def toward(self, sight: Sight, directions: Any) -> Any:
        """Response (1/sr) of the surfaces seen to light from directions."""
        if self._slopes is None:
            return mi.Float(0.0)
        slope = dr.gather(mi.Float, self._slopes, sight.mesh, sight.shaded)
        return interface(sight.point, sight.point.to_local(directions), slope)


class SunLight:
    """Direct light from the disc of sun or moon, also through a surface."""

    def __init__(
        self, scene: Scene, meshes: Sequence[MergedMesh], sun: Sun, bands_nm: Bands
    ) -> None:
        self._bands = len(bands_nm)
        self._center = mi.Vector3f(*sun.direction)
        dr.make_opaque(self._center)
        self._points = mi.Float(sun.points(DISC_POINTS).astype(np.float32).ravel())
        grids = [np.linspace(*band, _GRID) for band in bands_nm]
        materials = [scene.materials[mesh.material] for mesh in meshes]
        spectra = spectra_of(materials)
        table = [
            [np.mean(spectrum(grid) * sun.irradiance(grid)) / np.pi for grid in grids]
            for material in materials
            for spectrum in scattered(material.body, spectra)
        ]
        self._shine = Shine(materials)
        means = [float(np.mean(sun.irradiance(grid))) for grid in grids]
        self._irradiance = [dr.opaque(mi.Float, mean) for mean in means]
        self._transmits = mi.Bool([material.transmits for material in materials])
        self._facing = Table(np.array(table), self._bands, spectra)

    def radiance(self, loaded: Any, sight: Sight, weights: Weights, disc: Any) -> list[Any]:
        """Radiance of each band from the points seen by rays toward the rays' origins.

        `disc` (N,), 0 to 1, selects the point of the disc for the visibility test. The disc is so
        small that its center gives the angle for all of it.
        """
        cosine = dr.dot(sight.point.sh_frame.n, self._center)
        through = (cosine > 0) != sight.front
        place = dr.minimum(mi.UInt(disc * DISC_POINTS), DISC_POINTS - 1)
        toward = dr.gather(mi.Vector3f, self._points, place)
        lit = sight.shaded & (cosine != 0)
        lit &= ~through | dr.gather(mi.Bool, self._transmits, sight.mesh, lit)
        lit &= ~loaded.ray_test(sight.point.spawn_ray(toward), lit)
        cosine = dr.select(lit, dr.abs(cosine), 0.0)
        facing = self._facing.read(side_of(sight, through), weights, lit)
        shine = self._shine.toward(sight, self._center)
        parts = zip(facing, self._irradiance, strict=True)
        return [cosine * dr.fma(shine, light, diffuse) for diffuse, light in parts]


def leaving(point: Any, front: Any, share: Any, sample: Any) -> tuple[Any, Any]:
    """Cosine-distributed rays from points on the front or back of surfaces.

    A share of them leaves from the other side; returns also True for these.
    """
    x, y = sample
    through = x < share
    x = dr.minimum(dr.select(through, x / share, (x - share) / (1 - share)), _BELOW_ONE)
    upward = point.sh_frame.to_world(mi.warp.square_to_cosine_hemisphere(mi.Point2f(x, y)))
    side = dr.select(front != through, 1.0, -1.0)
    return point.spawn_ray(side * upward), through


class Bounces:
    """Rays along which light arrives at the surfaces seen, on both sides of translucent ones."""

    def __init__(self, scattering: Scattering, bands: int, shine: Shine) -> None:
        self._shine = shine
        self._through = mi.Float(scattering.through.astype(np.float32))
        self._scattered = Table(scattering.of_rays(), bands, scattering.spectra)

    def rays(self, sight: Sight, sample: Any) -> tuple[Any, Any]:
        """Cosine-distributed rays for two random numbers each, and True for transmitted light."""
        return leaving(sight.point, sight.front, self._share(sight), sample)

    def density(self, sight: Sight, directions: Any) -> tuple[Any, Any]:
        """Probability density of directions per solid angle, and True for transmitted light."""
        cosine = dr.dot(sight.point.sh_frame.n, directions)
        through, share = (cosine > 0) != sight.front, self._share(sight)
        return dr.abs(cosine) / dr.pi * dr.select(through, share, 1 - share), through

    def shine(self, sight: Sight, directions: Any) -> Any:
        """Weight of the light that rays bring to the interface, as they are distributed."""
        response = self._shine.toward(sight, directions)
        return dr.pi * response / (1 - self._share(sight))

    def reflected(
        self,
        sight: Sight,
        rays: Any,
        through: Any,
        weights: Weights,
        place: Any,
        arriving: list[Any],
    ) -> list[Any]:
        """Radiance of each band due to light that arrives at a place, 0 to 1, in the band."""
        shine = self.shine(sight, rays.d)
        step = dr.minimum(mi.UInt(place * WAVELENGTHS), WAVELENGTHS - 1)
        shares = self._scattered.read(side_of(sight, through), weights, sight.shaded, step)
        return [light * (share + shine) for light, share in zip(arriving, shares, strict=True)]

    def _share(self, sight: Sight) -> Any:
        return dr.gather(mi.Float, self._through, sight.mesh, sight.shaded)


class SkyLight:
    """Light of the sky, seen directly or from a surface along one ray.

    Unless the loaded sky is searched evenly, half of the rays follow its directions; both kinds
    count by the balance heuristic (Veach, 1997).
    """

    def __init__(
        self,
        lighting: Lighting,
        loaded_sky: Any,
        scattering: Scattering,
        bounces: Bounces,
        bands_nm: Bands,
    ) -> None:
        skies = [lighting.sky, *(pattern.radiance for pattern in lighting.patterns)]
        self._bands, self._skies, self._bounces = len(bands_nm), len(skies), bounces
        self._patterns = SkyPatterns(lighting.patterns)
        self._loaded_sky = loaded_sky
        self._emitted = mi.Float(band_means(skies, bands_nm).astype(np.float32).ravel())
        # (M, 2 sides, S, spectra · B)
        self._under = Table(scattering.under(skies), self._bands, scattering.spectra)

    def emitted(self, directions: Any, active: Any) -> list[Any]:
        """Radiance of each band from directions."""
        values = self._values(directions, active)
        return [
            sum(
                value * dr.gather(mi.Float, self._emitted, sky * self._bands + band, active)
                for sky, value in enumerate(values)
            )
            for band in range(self._bands)
        ]

    def radiance(self, scene: Any, sight: Sight, weights: Weights, sampler: Any) -> list[Any]:
        """Radiance of each band from the points seen, due to light from the sky that meets them."""
        rays, through = self._bounces.rays(sight, sampler.next_2d())
        count = mi.Float(1.0)
        directions = self._loaded_sky.directions if self._loaded_sky else EvenDirections()
        if not isinstance(directions, EvenDirections):
            aimed, _ = directions.sample(sight.point.p, sampler.next_2d(), sight.shaded)
            toward = dr.select(sampler.next_1d() < 0.5, aimed, rays.d)
            density, through = self._bounces.density(sight, toward)
            both = (density + directions.density(sight.point.p, toward, sight.shaded)) / 2
            rays = sight.point.spawn_ray(toward)
            count = dr.select(both > 0, density / both, 0.0)
        free = sight.shaded & ~scene.ray_test(rays, sight.shaded)
        values = self._values(rays.d, free)
        light, shine = [mi.Float(0.0)] * self._bands, self._bounces.shine(sight, rays.d)
        for sky, value in enumerate(values):
            row = side_of(sight, through) * self._skies + sky
            first = sky * self._bands
            shares = [
                dr.fma(shine, dr.gather(mi.Float, self._emitted, first + band, free), share)
                for band, share in enumerate(self._under.read(row, weights, free))
            ]
            light = [a + count * value * b for a, b in zip(light, shares, strict=True)]
        return light

    def _values(self, directions: Any, active: Any) -> list[Any]:
        values = [mi.Float(1.0), *self._patterns.toward(directions, active)]
        return [dr.select(active, value, 0.0) for value in values]
