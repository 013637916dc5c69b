"""What a few pixels of a sequence tell: samples of each part of the light, and where the sky is.

In rooms a guide sends rays to where the sky is seen. Its directions are bins of equal solid angle,
its places voxels. It counts the light of rays from surfaces that light paths meet. Where it counted
few, larger voxels tell, and every direction keeps some chance.
"""

from typing import Any, NamedTuple

import numpy as np

from megalopta.core.arrays import Floats, Ints
from megalopta.core.progress import step
from megalopta.render import RenderSettings, dr, mi
from megalopta.render.film import Film, pixel_means
from megalopta.render.loading.materials import mean
from megalopta.render.loading.scene import LoadedScene, of_shapes
from megalopta.render.loading.sky import SkyPatterns, sky_of
from megalopta.render.path_tracing import SplitPaths
from megalopta.render.settings import part_seed
from megalopta.scenes.cameras.base import Camera
from megalopta.scenes.scene import Lighting

_RINGS, _SECTORS = 8, 16
_BINS = _RINGS * _SECTORS
_OCTAVES = 4
"""Halvings of the box of the points met, along its longest side, to voxels."""
_PRIOR = 16.0
"""Number of rays that a larger voxel counts for."""
_EVEN = 0.2
"""Chance of an even direction."""
_HITS = 3
"""Hits of a path from each of which a ray looks for the sky."""
_FEWEST, _MOST = 2**17, 2**22
"""Rays that show whether a guide helps, and most that teach one."""
_NOISE = 0.6
"""Largest mean square of the light of guided rays, relative to the usual ones."""


class Looks(NamedTuple):
    """Rays from N points (3, N): their bins, their light, and the usual density (N,)."""

    points: Floats
    bins: Ints
    light: Floats
    usual: Floats


class OpenSky:
    """Random directions from points to where the sky is seen and bright."""

    def __init__(self, looks: Looks) -> None:
        tails = (1 - 0.99) / 2  # beyond, the nearest voxels serve
        low, high = np.quantile(looks.points, [tails, 1 - tails], axis=1)
        side = max(float((high - low).max()) / 2**_OCTAVES, 1e-6)
        size = np.maximum(np.ceil((high - low) / side), 1).astype(int)
        self._low, self._side, self._size = mi.Point3f(low), mi.Float(side), mi.Point3i(size)
        dr.make_opaque(self._low, self._side, self._size)
        voxel = np.array(self._voxel(mi.Point3f(looks.points)), np.int64)
        entry = voxel * _BINS + looks.bins
        counts = np.concatenate(
            [
                np.bincount(entry, weights, size.prod() * _BINS).reshape(-1, _BINS)
                for weights in (None, looks.light)
            ],
            axis=1,
        )
        light: Any = looks.light.mean(dtype=np.float64)
        place = np.indices(size).reshape(3, -1)
        for octave in range(_OCTAVES, -1, -1):
            _, voxel = np.unique(place >> octave, axis=1, return_inverse=True)
            total = np.zeros((voxel.max() + 1, 2 * _BINS))
            np.add.at(total, voxel.ravel(), counts)
            rays, of_rays = np.split(total[voxel.ravel()], 2, axis=1)
            light = (of_rays + _PRIOR * light) / (rays + _PRIOR)
        chance = (1 - _EVEN) * light / light.sum(axis=1, keepdims=True) + _EVEN / _BINS
        cumulated = np.cumsum(chance, axis=1)
        cumulated[:, -1] = 1
        self._cumulated = mi.Float(np.pad(cumulated, ((0, 0), (1, 0))).astype(np.float32).ravel())
        self.tables = [self._cumulated, self._low, self._side, self._size]

    def sample(self, point: Any, sample: Any, active: Any) -> tuple[Any, Any]:
        """Return a direction for two random numbers, and its density per solid angle."""
        first = self._voxel(point) * (_BINS + 1)

        def below(index: Any) -> Any:
            return dr.gather(mi.Float, self._cumulated, first + index + 1, active) <= sample.x

        search: Any = dr.binary_search
        index = dr.minimum(search(0, _BINS, below), _BINS - 1)
        start, chance = self._chance(first + index, active)
        within = dr.clip((sample.x - start) / chance, 0, 1 - 2**-20)
        z = 1 - (mi.Float(index // _SECTORS) + within) * (2 / _RINGS)
        turn = ((mi.Float(index % _SECTORS) + sample.y) / _SECTORS - 0.5) * dr.two_pi
        sine, cosine = dr.sincos(turn)
        level = dr.safe_sqrt(1 - z * z)
        return mi.Vector3f(level * cosine, level * sine, z), chance * (_BINS / (4 * dr.pi))

    def density(self, point: Any, direction: Any, active: Any) -> Any:
        """Probability density of a direction from a point, per solid angle."""
        entry = self._voxel(point) * (_BINS + 1) + _bin_of(direction)
        return self._chance(entry, active)[1] * (_BINS / (4 * dr.pi))

    def densities(self, points: Floats, bins: Ints) -> Floats:
        """Densities (N,) of bins (N,) seen from points (3, N)."""
        first = np.array(self._voxel(mi.Point3f(points)), np.int64) * (_BINS + 1)
        chance = np.diff(np.array(self._cumulated), append=1.0)[first + bins]
        return np.asarray(chance * (_BINS / (4 * np.pi)))

    def _chance(self, entry: Any, active: Any) -> tuple[Any, Any]:
        start, end = (dr.gather(mi.Float, self._cumulated, entry + k, active) for k in (0, 1))
        return start, end - start

    def _voxel(self, point: Any) -> Any:
        place = mi.Point3i(dr.floor((point - self._low) / self._side))
        x, y, z = dr.clip(place, 0, self._size - 1)
        return mi.UInt((x * self._size[1] + y) * self._size[2] + z)


def _bin_of(direction: Any) -> Any:
    ring = dr.minimum(mi.UInt((1 - direction.z) * (_RINGS / 2)), _RINGS - 1)
    turn = dr.atan2(direction.y, direction.x) / dr.two_pi + 0.5
    return ring * _SECTORS + dr.minimum(mi.UInt(turn * _SECTORS), _SECTORS - 1)


def guided(
    whole: LoadedScene, camera: Camera, poses: Floats, samples: int, seed: int
) -> LoadedScene:
    """Scene with a guide, if its rays have less noise than the usual ones.

    It is for a camera at poses (T, 4, 4), and for so many samples of light paths. A scene at rest
    may be another's too, so it is copied, with the same shapes.
    """
    scene, loaded = whole.scene, whole.loaded
    if not (sky_of(loaded) and scene.lighting):
        return whole
    of_view = loaded, scene.lighting, camera, poses
    learnt, kept = (_looks(*of_view, _FEWEST // 2, part_seed(seed, "sky", k)) for k in (0, 1))
    if not (learnt.light.any() and kept.light.any()):
        return whole
    density, square = OpenSky(learnt).densities(kept.points, kept.bins), kept.light**2
    if (square * kept.usual / density).sum() > _NOISE * square.sum():
        return whole
    with step("looking where the sky is seen"):
        guide = OpenSky(_looks(*of_view, min(max(samples // 2, _FEWEST), _MOST), seed))
    if scene.is_moving:
        parameters = mi.traverse(loaded)
        parameters["sky.sampling_weight"] = 1.0
        parameters.update()
    else:
        loaded = of_shapes(loaded.shapes(), scene)
    sky_of(loaded).aim(guide)
    return LoadedScene(scene, whole.meshes, loaded)


def _looks(
    scene: Any, lighting: Lighting, camera: Camera, poses: Floats, rays: int, seed: int
) -> Looks:
    """Look for the sky from where diffuse paths of a camera's rays meet surfaces."""
    count, random = rays // _HITS, np.random.default_rng(seed)
    pose = poses[random.integers(len(poses), size=count)]
    direction = camera.directions().reshape(-1, 3)
    direction = direction[random.integers(len(direction), size=count)]
    toward_scene = np.einsum("nij,nj->in", pose[:, :3, :3], direction)
    ray: Any = mi.Ray3f(mi.Point3f(pose[:, :3, 3].T), mi.Vector3f(toward_scene))
    usual = sky_of(scene).directions
    patterns, sampler = SkyPatterns(lighting.patterns), mi.load_dict({"type": "independent"})
    sampler.seed(seed, count)
    looks = []
    for _ in range(_HITS):
        hit = scene.ray_intersect(ray)
        is_met = hit.is_valid()
        toward = mi.warp.square_to_uniform_sphere(sampler.next_2d())
        free = is_met & ~scene.ray_test(hit.spawn_ray(toward), is_met)
        light = mi.Float(mean(lighting.sky))
        for sky, value in zip(lighting.patterns, patterns.toward(toward, free), strict=True):
            light += mean(sky.radiance) * value
        light = dr.select(free, light, 0.0)
        density = usual.density(hit.p, toward, free) + dr.zeros(mi.Float, count)
        side = dr.select(hit.wi.z > 0, 1.0, -1.0)
        upward = side * mi.warp.square_to_cosine_hemisphere(sampler.next_2d())
        ray = hit.spawn_ray(hit.to_world(upward))
        ray.maxt = dr.select(is_met, ray.maxt, 0.0)
        of_hit = hit.p, _bin_of(toward), light, density
        dr.eval(of_hit, ray, is_met)
        kept = np.array(is_met)
        looks.append([np.array(values)[..., kept] for values in of_hit])
    points, bins, *draws = (np.concatenate(parts, axis=-1) for parts in zip(*looks, strict=True))
    return Looks(points, bins.astype(np.int64), *draws)


_POSES, _PIXELS, _SAMPLES = 2, 200, 16
_LEAST_SHARE = 1 / 64
FEWEST_SAMPLES = 2**18
"""Fewest samples in all frames of a sequence for which a pilot pays."""


def fitted_shares(
    paths: SplitPaths, camera: Camera, settings: RenderSettings, poses: Floats, seed: int
) -> tuple[float, ...]:
    """Samples of the parts of split paths over those of a pixel.

    They are in proportion to the root of variance over cost, in pixels that show only surfaces at
    some of the poses (T, 4, 4); these hold the error that frames state.
    """
    whole_frame = settings.model_copy(update={"samples_per_pass": 2**28})
    film, parts = Film(camera, whole_frame, _SAMPLES), paths.parts
    variances = np.zeros(len(parts))

    def trace(_: Any, sensor: Any, seed: int, spp: int) -> Any:
        pixels = np.random.default_rng(seed).permutation(camera.width * camera.height)[:_PIXELS]
        shows_surfaces = True
        for number, part in enumerate(parts):
            twice = pixel_means(sensor, sensor.sampler(), seed, part.look, np.tile(pixels, 2))
            first, second = twice[:, :-1].sum(axis=1, dtype=np.float64).reshape(2, -1)
            shows_surfaces &= (twice[:, -1] == 0).reshape(2, -1).all(axis=0)
            variances[number] += ((first - second)[shows_surfaces] ** 2).sum()
        return np.zeros((camera.height, camera.width, 1))

    for pose in poses[np.linspace(0, len(poses) - 1, _POSES).round().astype(int)]:
        film.expose(trace, None, pose, seed)
    samples = np.sqrt(variances / [part.cost for part in parts])
    if not samples.any():
        return paths.shares
    shares = np.maximum(samples / samples.max(), _LEAST_SHARE)
    return 1.0, *shares[1:].tolist()  # what is seen is cheap, and sharp only with all rays
