"""Light on surfaces, computed once per cell and kept: the part of shading that no view changes.

A diffuse surface with reflectance ρ under irradiance E sends out L = ρE/π in all directions. For
each cell that is asked for, and each band, the band means of ρ₀E/π and ρ₁E/π are kept, where ρ₀ and
ρ₁ are the two reflectances that the surface's texture mixes: with its weight w the surface then
shows (1 − w)·ρ₀E/π + w·ρ₁E/π. Band means of ρ and E apart would lose how the two go together
within a band, several percent under green leaves. E is the light of the sky and of all surfaces,
bounces included; what comes straight from the disc of sun or moon is left to the frame, which knows
where shadows fall to the pixel.

E/π is the mean radiance that arrives from directions distributed as the cosine. Position,
direction and wavelength of the samples of a cell follow additive recurrences shifted at random; the
rest of each path is random. All of it is drawn from seed and cell alone, so that a cell has the
same light, to the last bit, in whatever order and company it is computed.
"""

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.render import Bands, RenderSettings, dr, mi
from megalopta.render.baking.cells import Cells
from megalopta.render.baking.sampling import cell_sampler, hashed, recurrence
from megalopta.render.loading import MergedMesh
from megalopta.scenes.spectra import Spectrum, flat
from megalopta.scenes.world import Material, Scene

NOT_BAKED = 2**32 - 1

# Paths traced at once, in about a second: what they bring is kept until it is summed, and Ctrl-C
# waits for them.
PATHS_AT_ONCE = 2**19
FIRST_ROWS = 2**12
# Wavelengths in a band, of which each sample takes one.
_WAVELENGTHS = 2**8
# How often a cell is seen, and how many sixteenths of the samples it then takes. Its noise weighs
# with how much of the sequence it fills; a given number of paths leaves the least noise when
# samples grow as the square root of that.
_SEEN = (1, 16)
_SHARES = (1, 4, 16)


def reflectances(material: Material) -> tuple[Spectrum, Spectrum]:
    """Reflectance of a material where its texture's weight is 0 and where it is 1."""
    if material.emission:
        return flat(0.0), flat(0.0)
    first = material.reflectance
    return first, material.texture.reflectance if material.texture else first


def wavelength_groups(bands_nm: Bands, place: Any) -> Iterator[tuple[int, int, Any]]:
    """Bands in groups that fit Mitsuba's four wavelengths: first band, bands, wavelengths.

    `place` is where in each band the wavelength lies, 0 to 1.
    """
    for first in range(0, len(bands_nm), 4):
        group = bands_nm[first : first + 4]
        # Wavelengths that are left over repeat the last band and are not read.
        padded = [*group, *[group[-1]] * (4 - len(group))]
        wavelengths = [lower + (upper - lower) * place for lower, upper in padded]
        yield first, len(group), mi.Spectrum(wavelengths)


class BakedLight:
    """Radiance that the cells of a scene send out, without what the sun's disc adds directly.

    `seen` (cells.count,) is how often a survey of the sequence saw each cell; the seed has 32 bits.
    """

    def __init__(
        self,
        loaded: Any,
        scene: Scene,
        meshes: Sequence[MergedMesh],
        cells: Cells,
        seen: NDArray[np.uint32],
        settings: RenderSettings,
        seed: int,
    ) -> None:
        self._scene = loaded
        self._shapes = loaded.shapes_dr()
        self._cells = cells
        self._bands = settings.bands_nm
        self._least = math.ceil(settings.bake_samples / _SHARES[-1])
        self._shares = np.array(_SHARES, np.uint8)[np.digitize(seen, _SEEN)]
        # The way from the camera to the cell is the first segment of the path.
        self._integrator = mi.load_dict({"type": "path", "max_depth": settings.max_depth - 1})
        self._sampler = cell_sampler()
        self._seed = dr.opaque(mi.UInt, seed)
        self._reflectance = _reflectance_table(scene, meshes, self._bands)
        self._row = dr.full(mi.UInt, NOT_BAKED, cells.count)
        self._radiance = dr.zeros(mi.Float, FIRST_ROWS * self._width)
        self.baked_cells = 0

    @property
    def _width(self) -> int:
        return 2 * len(self._bands)

    def bake_missing(self, cell: Any, active: Any) -> None:
        """Compute the light of those cells (N,) that have none yet."""
        lanes: Any = dr.compress(
            active & (dr.gather(mi.UInt, self._row, cell, active) == NOT_BAKED)
        )
        if not dr.width(lanes):
            return
        missing = np.unique(np.array(dr.gather(mi.UInt, cell, lanes)))
        self._reserve(self.baked_cells + len(missing))
        paths = np.cumsum(self._least * self._shares[missing].astype(np.int64))
        parts = np.searchsorted(paths, np.arange(PATHS_AT_ONCE, paths[-1], PATHS_AT_ONCE))
        for part in np.split(missing, parts):
            self._bake(part)

    def radiance(self, cell: Any, weight: Any, active: Any) -> list[Any]:
        """Radiance of each band leaving cells (N,) where the texture's weight is (N,)."""
        start: Any = dr.gather(mi.UInt, self._row, cell, active) * self._width
        bands = len(self._bands)
        first, second = (
            [dr.gather(mi.Float, self._radiance, start + k + band, active) for band in range(bands)]
            for k in (0, bands)
        )
        return [dr.lerp(a, b, weight) for a, b in zip(first, second, strict=True)]

    def _bake(self, cell: NDArray[np.uint32]) -> None:
        """Compute the light of cells (C,) and put it into the table."""
        first, leaving = self.baked_cells, self._leaving(cell)
        # Opaque: a number that changes would make Dr.Jit compile anew every time.
        place = dr.arange(mi.UInt, leaving.size) + dr.opaque(mi.UInt, first * self._width)
        dr.scatter(self._radiance, mi.Float(leaving.ravel()), place)
        row = dr.arange(mi.UInt, len(cell)) + dr.opaque(mi.UInt, first)
        dr.scatter(self._row, row, mi.UInt(cell))
        dr.eval(self._radiance, self._row)
        dr.sync_thread()
        self.baked_cells += len(cell)

    def _reserve(self, rows: int) -> None:
        size, needed = dr.width(self._radiance), rows * self._width
        if needed > size:
            grown = dr.zeros(mi.Float, max(needed, 2 * size))
            dr.scatter(grown, self._radiance, dr.arange(mi.UInt, size))
            self._radiance = grown

    def _leaving(self, cell: NDArray[np.uint32]) -> NDArray[np.float32]:
        """Radiance (C, 2·bands) that leaves cells (C,), first reflectance before second.

        All cells are sampled at once, in groups of as many samples as the least of them take.
        """
        bands, least, shares = len(self._bands), self._least, self._shares[cell].astype(np.int64)
        start = np.cumsum(shares) - shares
        index = np.repeat(np.arange(len(cell), dtype=np.uint32), shares)
        group = (np.arange(len(index)) - start[index]).astype(np.uint32)
        lane = dr.arange(mi.UInt, len(index) * least)
        of_group = lane // least
        of_cell, group_of_lane, shares_of_lane = (
            dr.gather(mi.UInt, mi.UInt(values), of_group)
            for values in (index, group, shares[index].astype(np.uint32))
        )
        sample = group_of_lane * least + lane - of_group * least
        key, other = hashed(dr.gather(mi.UInt, mi.UInt(cell), of_cell), self._seed)
        mesh, rays = self._rays(cell, of_cell, sample, key)
        # One wavelength in each of as many parts of the band as there are samples.
        samples = dr.maximum(shares_of_lane * least, 1)  # 0 in what fills up LLVM's vectors
        step = (sample * _WAVELENGTHS + other % _WAVELENGTHS) // samples
        place = (mi.Float(step) + 0.5) / _WAVELENGTHS
        leaving: list[Any] = [None] * (2 * bands)
        for first, size, wavelengths in wavelength_groups(self._bands, place):
            rays.wavelengths = wavelengths
            self._sampler.start(key, sample)
            arriving, _, _ = self._integrator.sample(self._scene, self._sampler, rays)
            for band in range(size):
                for column in (first + band, bands + first + band):
                    entry = (mesh * (2 * bands) + column) * _WAVELENGTHS + step
                    rho = dr.gather(mi.Float, self._reflectance, entry)
                    leaving[column] = arriving[band] * rho
        dr.eval(leaving)
        sums = np.stack([np.array(dr.block_sum(values, least)) for values in leaving], axis=1)
        totals = np.add.reduceat(sums, start, axis=0)
        return np.asarray(totals / (shares[:, None] * least), np.float32)

    def _rays(
        self, cell: NDArray[np.uint32], of_cell: Any, sample: Any, key: Any
    ) -> tuple[Any, Any]:
        """Mesh of each sample, and its ray from the cell into a cosine-distributed direction."""
        patch = self._cells.patches(cell)

        def of(values: NDArray[np.uint32]) -> Any:
            return dr.gather(mi.UInt, mi.UInt(values), of_cell)

        x, y, a, b = recurrence(sample, key)
        hit: Any = dr.zeros(mi.PreliminaryIntersection3f, dr.width(sample))
        hit.valid = True
        hit.t = 0.0
        hit.prim_index = of(patch.triangle)
        hit.prim_uv = patch.barycentric(of, a, b)
        mesh = of(patch.mesh)
        hit.shape = dr.gather(mi.ShapePtr, self._shapes, mesh)
        point = hit.compute_surface_interaction(dr.zeros(mi.Ray3f), mi.RayFlags.All)
        upward = point.sh_frame.to_world(mi.warp.square_to_cosine_hemisphere(mi.Point2f(x, y)))
        side = dr.select(of(patch.side) == 0, 1.0, -1.0)
        return mesh, mi.RayDifferential3f(point.spawn_ray(side * upward))


def _reflectance_table(scene: Scene, meshes: Sequence[MergedMesh], bands_nm: Bands) -> Any:
    """Reflectance by mesh, then first or second, then band, then place in the band."""
    place = (np.arange(_WAVELENGTHS) + 0.5) / _WAVELENGTHS
    table = [
        [spectrum(lower + (upper - lower) * place) for lower, upper in bands_nm]
        for mesh in meshes
        for spectrum in reflectances(scene.materials[mesh.material])
    ]
    return mi.Float(np.ravel(table).astype(np.float32))
