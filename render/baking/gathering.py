"""Radiance of clusters of cells, gathered by two independent sets of rays.

Most light comes directly from the sky and needs only visibility rays. Every 16th ray also finds
light of other surfaces: where paths were followed before, it takes the mean light of a voxel about
half as wide as far, of a mesh, a facing, a half of the samples and a part of the band (radiance
caching); elsewhere it is followed as a path. Direct light from the disc of sun or moon is left to
the frame. Cell, position, direction and wavelength follow additive recurrences with a random shift
for each half, drawn from the seed and the cluster's first cell alone: in one survey, a cluster's
light is the same, to the last bit, in any order and with any others.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from megalopta.core.arrays import Floats, Ints
from megalopta.render import RenderSettings, dr, mi, path_tracing
from megalopta.render.baking.cells import Cells, Patches, UInt32, unpacked
from megalopta.render.loading.meshes import MergedMesh
from megalopta.render.loading.scene import MeshIndex
from megalopta.render.loading.sky import SkyPatterns
from megalopta.render.shading import WAVELENGTHS, Scattering, leaving
from megalopta.scenes.scene import Scene
from megalopta.scenes.spectra.spectrum import flat

_AHEAD = 2**20
"""First sample of paths whose light is kept; those of light are before."""
_PARTS = 2
"""Parts of a band in which kept light is distinguished."""


class Places(NamedTuple):
    """Sample places of clusters: some cells of each, one cluster after the other."""

    patches: Patches
    seen: UInt32
    """Place in each cell where a point was seen."""
    draws: int


@dataclass
class Lanes:
    """Layout of the samples of both halves of C clusters in one launch.

    A half has as many groups as its cluster has shares, of `size` lanes each.
    """

    shares: Ints
    size: int

    def __post_init__(self) -> None:
        groups = np.repeat(self.shares, 2)
        self._start = np.cumsum(groups) - groups
        self._samples = groups * self.size
        entry = np.repeat(np.arange(len(groups), dtype=np.uint32), groups)
        number = (np.arange(len(entry)) - self._start[entry]).astype(np.uint32)
        lane = dr.arange(mi.UInt, len(entry) * self.size)
        group = lane // self.size
        of_half = dr.gather(mi.UInt, mi.UInt(entry), group)
        first = dr.gather(mi.UInt, mi.UInt(number), group) * self.size
        self.sample = first + lane - group * self.size
        """Number of each lane's sample in its half."""
        self.half = of_half & 1
        self.cluster = of_half >> 1
        self.samples = dr.gather(mi.UInt, mi.UInt(self._samples.astype(np.uint32)), of_half)
        """Number of samples of each lane's half."""

    def of_cluster(self, values: UInt32) -> Any:
        """Values of clusters (C,) for lanes."""
        return dr.gather(mi.UInt, mi.UInt(values), self.cluster)

    def means(self, values: list[Any]) -> Floats:
        """Means (2C, n) over the samples of each half of n values per lane."""
        dr.eval(values)  # otherwise rays would be traced again for each of them
        sums = [dr.block_sum(value, self.size) for value in values]
        dr.eval(sums)
        groups = np.stack([np.array(value, np.float64) for value in sums], axis=1)
        totals = np.add.reduceat(groups, self._start, axis=0)
        return np.asarray(totals / self._samples[:, None])


STRIDE = 16
"""Number of rays for each that finds light of other surfaces."""
_SIDES = 16
"""Parts of each coordinate of directions by which rays are sorted."""


def by_direction(rays: Any) -> Any:
    """Order (N,) in which rays of similar direction are neighbors, and are traced faster."""
    number = mi.UInt(0)
    for x in rays.d:
        number = number * _SIDES + mi.UInt(dr.clip((x + 1) * (_SIDES / 2), 0, _SIDES - 1))
    dr.eval(rays, number)
    return mi.UInt(np.argsort(np.array(number, np.uint16), kind="stable").astype(np.uint32))


class Gatherer:
    """Radiance of clusters of a scene's cells; the seed has 32 bits."""

    def __init__(
        self,
        loaded: Any,
        scene: Scene,
        meshes: Sequence[MergedMesh],
        cells: Cells,
        settings: RenderSettings,
        seed: int,
    ) -> None:
        self._scene = loaded
        self._shapes = loaded.shapes_dr()
        self._cells = cells
        self._bands = settings.bands_nm
        # The segment from camera to cell is the first of the path.
        self._paths = path_tracing.LightPaths(settings.max_depth - 1)
        self._sampler = path_tracing.keyed_sampler()
        self._seed = dr.opaque(mi.UInt, seed)
        scattering = Scattering([scene.materials[mesh.material] for mesh in meshes], self._bands)
        self._scattered = mi.Float(scattering.of_rays().astype(np.float32).ravel())
        self._through = mi.Float(scattering.through.astype(np.float32))
        self.spectra = scattering.spectra
        """Number of spectra that textures mix."""
        # Paths of one segment end at the first surface.
        lit = scene.lighting if settings.max_depth > 1 else None
        patterns = lit.patterns if lit else ()
        self._patterns = SkyPatterns(patterns)
        skies = [lit.sky if lit else flat(0.0), *(pattern.radiance for pattern in patterns)]
        self._under_sky = scattering.under(skies)
        self._index = MeshIndex(loaded)
        self._table = self._tags = dr.zeros(mi.UInt, 1)
        self._kept = mi.Float(0.0)
        self._bright = scattering.brightness(lit.mean_sky() if lit else flat(0.0))
        # Without light from the sky all rays have to be followed.
        self._stride = STRIDE if self._under_sky.any() else 1

    def brightness(self, cell: UInt32) -> Floats:
        """Brightness of the material of cells (C,) under the sky, relative to the brightest."""
        return np.asarray(self._bright[self._cells.patches(cell).mesh])

    def leaving(
        self, leader: UInt32, cell: UInt32, seen: UInt32, *, shares: Ints, least: int
    ) -> Floats:
        """Radiance (C, 2 halves, spectra·bands) that leaves clusters, one spectrum after the other.

        A cluster is seeded by its leader (C,). Its light is gathered uniformly at its cells (C, n),
        where these are visible from the points at which they were seen (C, n). Each half takes
        `least` rays, a multiple of STRIDE, for each of a cluster's shares (C,).
        """
        places = Places(self._cells.patches(cell.ravel()), seen.ravel(), cell.shape[1])
        in_view = self._in_view(leader, places, Lanes(shares, least))
        mesh = places.patches.mesh[:: places.draws]
        sky = np.einsum("cst,cstk->ck", in_view, self._under_sky[np.repeat(mesh, 2)])
        followed = self._followed(leader, mesh, places, Lanes(shares, least // self._stride))
        return np.asarray(sky + followed).reshape(len(leader), 2, -1)

    def _in_view(self, leader: UInt32, places: Places, lanes: Lanes) -> Floats:
        """Share (2C, 2, S) of rays that see the sky, and patterns, on this side and the other."""
        skies = self._under_sky.shape[2]
        if not self._under_sky.any():
            return np.zeros((2 * len(leader), 2, skies))
        rays, through = self._rays(places, lanes, lanes.sample, self._keys(leader, lanes)[0])
        order = by_direction(rays)
        blocked = self._scene.ray_test(dr.gather(mi.Ray3f, mi.Ray3f(rays), order))
        free = dr.zeros(mi.Bool, dr.width(order))
        dr.scatter(free, ~blocked, order)
        sides = free & ~through, free & through
        bright = [mi.Float(1.0), *self._patterns.toward(rays.d, free)]
        parts = [dr.select(side, value, 0.0) for side in sides for value in bright]
        return lanes.means(parts).reshape(-1, 2, skies)

    def _followed(self, leader: UInt32, mesh: UInt32, places: Places, lanes: Lanes) -> Floats:
        """Radiance (2C, spectra·bands) that leaves meshes (C,) due to light from surfaces."""
        bands, columns = len(self._bands), self.spectra * len(self._bands)
        order, through, step, _, arriving = self._arriving(leader, places, lanes, 0)
        of_side = 2 * lanes.of_cluster(mesh) + dr.select(through, mi.UInt(1), mi.UInt(0))
        leaving: list[Any] = [None] * columns
        for band, values in enumerate(arriving):
            light = dr.zeros(mi.Float, dr.width(order))
            dr.scatter(light, values, order)
            for column in range(band, columns, bands):
                entry = (of_side * columns + column) * WAVELENGTHS + step
                leaving[column] = light * dr.gather(mi.Float, self._scattered, entry)
        return lanes.means(leaving)

    def keep(self, parts: Iterable[Sequence[UInt32]]) -> None:
        """Keep the mean light of what a path of each half of clusters hits, for rays to come.

        Parts are arguments of `leaving`.
        """
        hits, lights = [], []
        for leader, cell, seen in parts:
            lanes = Lanes(np.ones(len(leader), np.int64), 1)
            places = Places(self._cells.patches(cell.ravel()), seen.ravel(), cell.shape[1])
            _, _, _, (a, b), arriving = self._arriving(leader, places, lanes, _AHEAD)
            dr.eval(a, b, arriving)
            hits.append(np.array(a, np.uint64) << np.uint64(32) | np.array(b, np.uint64))
            lights.append(np.stack([np.array(values) for values in arriving], axis=1))
        numbers, group, count = np.unique(
            np.concatenate(hits), return_inverse=True, return_counts=True
        )
        light = np.concatenate(lights)
        sums = np.stack([np.bincount(group, column) for column in light.T], axis=1)
        table = np.zeros(1 << int(4 * len(numbers)).bit_length(), np.uint32)
        slots = (numbers >> np.uint64(32)).astype(np.uint32) & (len(table) - 1)
        table[slots] = 1 + np.arange(len(numbers))
        self._table = mi.UInt(table)
        self._tags = mi.UInt(np.insert(numbers.astype(np.uint32), 0, 0))
        self._kept = mi.Float(
            np.insert((sums / count[:, None]).astype(np.float32), 0, 0, 0).ravel()
        )

    def _arriving(
        self, leader: UInt32, places: Places, lanes: Lanes, first: int
    ) -> tuple[Any, Any, Any, Any, list[Any]]:
        """Light of each band that arrives from surfaces along rays, and what these hit.

        Lanes are in another order, the first result; rays that leave from the other side, and
        wavelengths' places, are not.
        """
        key, draw = self._keys(leader, lanes)
        sample = lanes.sample * self._stride + first
        rays, through = self._rays(places, lanes, sample, key)
        # One wavelength in each of as many parts of the band as there are samples.
        samples = dr.maximum(lanes.samples, 1)  # 0 in padding of LLVM's vectors
        step = (lanes.sample * WAVELENGTHS + draw % WAVELENGTHS) // samples
        order = by_direction(rays)
        lane: list[Any] = [mi.Ray3f(rays), step, sample, key, lanes.half]
        ray, steps, sample, key, half = (dr.gather(type(x), x, order) for x in lane)
        hit = self._scene.ray_intersect_preliminary(ray)
        kind = 2 * (steps * _PARTS // WAVELENGTHS) + half
        # Without a hit all else is left over from other work.
        spot = [dr.select(hit.is_valid(), x, 0) for x in self._spot(ray, hit, kind)]
        entry = dr.gather(mi.UInt, self._table, spot[0] & (dr.width(self._table) - 1))
        kept = hit.is_valid() & (entry > 0) & (dr.gather(mi.UInt, self._tags, entry) == spot[1])
        bands = len(self._bands)
        light = [dr.gather(mi.Float, self._kept, entry * bands + k, kept) for k in range(bands)]
        followed = hit.is_valid() & ~kept
        dr.eval(ray, steps, sample, key, spot, light, followed)
        some: Any = dr.compress(followed)
        if dr.width(some):
            lane = [ray, steps, sample, key]
            ray, steps, sample, key = (dr.gather(type(x), x, some) for x in lane)
            place = (mi.Float(steps) + 0.5) / WAVELENGTHS
            for band, size, wavelengths in path_tracing.wavelength_groups(self._bands, place):
                ray.wavelengths = wavelengths
                self._sampler.start(key, sample)
                values, _ = self._paths.radiance(self._scene, self._sampler, ray)
                for k in range(size):
                    dr.scatter(light[band + k], values[k], some)
        return order, through, step, spot, light

    def _spot(self, ray: Any, hit: Any, kind: Any) -> tuple[Any, Any]:
        """Two numbers of what rays hit: the voxel, about half as wide as far, mesh and facing."""
        point = hit.compute_surface_interaction(ray, mi.RayFlags.Minimal)
        level = dr.floor(dr.log2(dr.maximum(hit.t, 1e-3))) - 1  # m; nearer hits are alike
        x, y, z = (mi.UInt(mi.Int(dr.floor(place * dr.exp2(-level)))) for place in point.p)
        facing = mi.UInt(0)
        for axis in dr.select(dr.dot(point.n, ray.d) > 0, -point.n, point.n):
            facing = 3 * facing + mi.UInt(mi.Int(dr.round(axis)) + 1)
        a, b = path_tracing.hashed(x, y)
        a, b = path_tracing.hashed(a ^ z, b ^ self._index.of(hit))
        return path_tracing.hashed(a ^ mi.UInt(mi.Int(level) + 64), b ^ (32 * kind + facing))

    def _keys(self, leader: UInt32, lanes: Lanes) -> tuple[Any, Any]:
        """Two random numbers per lane, shared within its cluster and its half of the samples."""
        of_leader, _ = path_tracing.hashed(lanes.of_cluster(leader), self._seed)
        return path_tracing.hashed(of_leader, lanes.half)

    def _rays(self, places: Places, lanes: Lanes, sample: Any, key: Any) -> tuple[Any, Any]:
        """Cosine-distributed rays from cells of clusters; True for those from the other side."""
        x, y, a, b, draw = path_tracing.recurrence(sample, key)
        drawn = mi.UInt(draw * places.draws) + lanes.cluster * places.draws

        def of(values: UInt32) -> Any:
            return dr.gather(mi.UInt, mi.UInt(values), drawn)

        patch = places.patches
        hit: Any = dr.zeros(mi.PreliminaryIntersection3f, dr.width(sample))
        hit.valid = True
        hit.t = 0.0
        hit.prim_index = of(patch.triangle)
        hit.shape = dr.gather(mi.ShapePtr, self._shapes, of(patch.mesh))
        front = of(patch.side) == 0

        def surface(place: Any) -> Any:
            hit.prim_uv = place
            return hit.compute_surface_interaction(dr.zeros(mi.Ray3f), mi.RayFlags.All)

        inside = patch.barycentric(of, a, b)
        seen = patch.barycentric(of, *unpacked(of(places.seen)))
        # If the ground or another object is in between, this point was not seen.
        points, upward = map(surface, (inside, seen)), dr.select(front, 1.0, -1.0)
        ends = [point.spawn_ray(upward * point.n).o for point in points]  # slightly above
        between: Any = mi.Ray3f(ends[0], ends[1] - ends[0])
        between.maxt = 1.0
        point = surface(dr.select(self._scene.ray_test(between), seen, inside))
        share = dr.gather(mi.Float, self._through, of(patch.mesh))
        rays, through = leaving(point, front, share, mi.Point2f(x, y))
        return mi.RayDifferential3f(rays), through
