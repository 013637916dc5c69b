"""Frames from baked light: primary rays, and a visibility ray to the sun.

Paths are traced where the survey of the sequence met no cell near, for moving objects, and
near these. An object inside a sphere of radius r at a distance d contributes at most (r/d)² to the
irradiance of a point at rest. Where this exceeds 0.01, paths are traced.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats
from megalopta.core.progress import silent, step
from megalopta.render import MEASURED_EVERY, RenderSettings, dr, mi
from megalopta.render.baking import choice
from megalopta.render.baking.cells import VIEWS, CellFinder, Cells, CellSight, survey, views
from megalopta.render.baking.gathering import Gatherer
from megalopta.render.baking.light import NOT_SURVEYED, BakedLight
from megalopta.render.film import pixel_means
from megalopta.render.loading.meshes import MergedMesh, MovingMesh
from megalopta.render.loading.scene import LoadedScene, of_shapes
from megalopta.render.loading.sky import sky_of
from megalopta.render.path_tracing import BandPaths, SplitPaths, wavelength_groups
from megalopta.render.settings import part_seed
from megalopta.render.shading import SunLight, Textures, Weights
from megalopta.scenes.cameras.base import Camera

# Samples of a frame for each that shows its fixed error once more.
_FIXED_EVERY = 4
# Rays per view of a cluster, to estimate how many the target error takes.
_PILOT_DENSITY = 1.0


class BakedLightIntegrator:
    """Scene with baked light, as seen by cameras.

    The poses (T, 4, 4) of the sequence are relative to the scene's origin; the seed has 32 bits.
    `reason` says why nothing was baked, if tracing split paths pays more.
    """

    reason = ""

    def __init__(
        self,
        whole: LoadedScene,
        split: SplitPaths | None,
        camera: Camera,
        settings: RenderSettings,
        poses: Floats,
        seed: int,
    ) -> None:
        scene, meshes, loaded = whole.scene, whole.meshes, whole.loaded
        self._bands = settings.bands_nm
        self._paths = BandPaths(self._bands, settings.max_depth)
        self._moving = Neighborhood(meshes)
        if self._moving:
            meshes = [mesh for mesh in meshes if not isinstance(mesh, MovingMesh)]
            loaded = of_shapes(loaded.shapes()[: len(meshes)], scene)
            if sky_of(loaded):
                sky_of(loaded).aim(sky_of(whole.loaded).directions)
        positions = poses[:, :3, 3]
        cells = Cells.of(meshes, camera, positions)
        self._finder = CellFinder(cells, whole.loaded)
        gatherer = Gatherer(loaded, scene, meshes, cells, settings, seed)
        self._textures = Textures(scene, meshes)
        sun = scene.lighting.sun if scene.lighting and settings.max_depth > 1 else None
        self._sun = SunLight(scene, meshes, sun, self._bands) if sun else None
        pixels = camera.width * camera.height
        with step("counting the rays that baked light takes"):
            rays = views(camera, poses, VIEWS, seed)
            met = survey(loaded, self._finder, rays)
            self._light = BakedLight(gatherer, cells, len(self._bands), met)
            self._light.prepare()
            # The pilot: light of the clusters that some views of a few frames meet.
            frames = choice.pilot_views(camera, poses, seed)
            seen = [survey(loaded, self._finder, frame)[0] for frame in frames]
            clusters = np.unique(self._light.clusters_of(np.unique(np.concatenate(seen))))
            with silent():
                self._light.compute(clusters[clusters < NOT_SURVEYED], _PILOT_DENSITY)
            sampler = mi.load_dict({"type": "independent"})
            sampler.seed(0, len(frames[0]) * dr.width(frames[0][0].d))
            # Any point of the sun's disc will do.
            look = partial(self._seen, loaded, place=mi.Float(0.5), sampler=sampler)
            pilot = choice.pilot(frames, look)
            mean = max(pilot.mean, 1e-300)
            density, error = _PILOT_DENSITY, math.sqrt(pilot.standing) / mean
            if error:
                density = self._light.density_for(settings.standing_error / error, density)
            parts = split.parts if split else []
            traced = choice.work_of_paths(parts, frames, sampler) if parts else math.nan
        rays_in_all = self._light.rays(density)
        if settings.integrator == "auto":
            baked = math.sqrt(pilot.variance) / mean
            self.reason = choice.cost_reason(
                rays_in_all, len(poses) * pixels, baked, traced, settings
            )
        if not self.reason:
            with step("baking light"):
                self._light.compute_all(density)
        samples = len(poses) * pixels * settings.samples_per_pixel
        work = choice.BAKE * rays_in_all + choice.SAMPLE * samples
        measured = -(-len(poses) // MEASURED_EVERY)
        paths = choice.SHARE_TO_COMPARE * work / (choice.WHOLE_PATH + choice.SAMPLE) / measured
        several = max(int(paths / (choice.GROUPS * choice.GROUP)), choice.FEWEST_TO_COMPARE)
        self._compared = min(1.0, several / pixels)

    def move_to(self, time_s: float) -> None:
        """Update the positions of moving objects to a time."""
        self._moving.move_to(time_s)
        self._paths.move_to(time_s)

    def render(self, scene: Any, sensor: Any, seed: int, spp: int) -> NDArray[np.float32]:
        """Radiance (H, W, B) at a sensor, band means, W·m⁻²·sr⁻¹·nm⁻¹; as Mitsuba's own."""
        return pixel_means(
            sensor,
            sensor.sampler(),
            seed,
            lambda *each: self._seen(scene, *each)[: len(self._bands)],
        )

    def measured(self, scene: Any, sensor: Any, seed: int, spp: int) -> NDArray[np.float32]:
        """Radiance, share of the sky, two views of a draw of the fixed error (H, W, 3·B + 1).

        Then the differences from paths of some pixels, in groups (H, W, G·B); NaN for others.
        """
        image = pixel_means(sensor, sensor.sampler(), seed, partial(self._seen, scene))
        differences = choice.compared(
            sensor, seed, image, self._compared, partial(self._off, scene)
        )
        draws = {"type": "independent", "sample_count": math.ceil(spp / _FIXED_EVERY)}
        again = pixel_means(
            sensor, mi.load_dict(draws), part_seed(seed, "fixed error"), partial(self._fixed, scene)
        )
        radiance, fixed, sky = np.split(image, [len(self._bands), -1], axis=-1)
        return np.concatenate([radiance, sky, fixed, again, differences], axis=-1)

    def _fixed(self, scene: Any, ray: Any, *_: Any) -> list[Any]:
        """A draw of the fixed error of each band along a ray's first hit."""
        sight, at_rest, weights = self._surface(scene, ray)
        dr.eval(sight.cell, at_rest, weights)
        cluster, is_baked = self._light.look_up(sight.cell, at_rest)
        return self._light.standing(cluster, weights, is_baked)

    def _off(self, scene: Any, ray: Any, place: Any, sampler: Any) -> list[Any]:
        """Difference of baked light from that of paths, per band."""
        _, baked, _, _, is_baked, _ = self._look(scene, ray, place, sampler)
        paths = self._paths.radiance(scene, ray, place, sampler, is_baked)
        return [light - path for light, path in zip(baked, paths, strict=True)]

    def _seen(self, scene: Any, ray: Any, place: Any, sampler: Any) -> list[Any]:
        """Radiance of each band along rays, a draw of its fixed error, and 1 for the sky."""
        emitted, baked, standing, sky, is_baked, surface = self._look(scene, ray, place, sampler)
        # Paths of surfaces without baked light.
        paths = self._paths.radiance(scene, ray, place, sampler, surface & ~is_baked)
        parts = zip(emitted, baked, paths, strict=True)
        return [*(sum(of_band) for of_band in parts), *standing, sky]

    def _surface(self, scene: Any, ray: Any) -> tuple[CellSight, Any, Weights]:
        """Surfaces seen, True where they are away from moving objects, and textures' weights."""
        sight = self._finder.look(scene, ray)
        at_rest = sight.shaded & ~self._moving.holds(sight.point.p)
        return sight, at_rest, self._textures.weights(sight)

    def _look(self, scene: Any, ray: Any, place: Any, sampler: Any) -> tuple[Any, ...]:
        """Emitted and baked light by band, a draw of its error, sky, baked and other surfaces."""
        sight, at_rest, weights = self._surface(scene, ray)
        direct = [mi.Float(0.0)] * len(self._bands)
        if self._sun:
            part = replace(sight, shaded=at_rest)
            direct = self._sun.radiance(scene, part, weights, sampler.next_1d())
        point = sight.point
        emitter = point.emitter(scene)
        emitted = []
        for _, size, wavelengths in wavelength_groups(self._bands, place):
            point.wavelengths = wavelengths
            values = emitter.eval(point)
            emitted += [values[band] for band in range(size)]
        sky = sight.sky
        surface = sight.moving | sight.shaded
        # Otherwise the rays would be traced again for each of them.
        dr.eval(sight.cell, at_rest, weights, direct, emitted, sky, surface, ray.o, ray.d)
        cluster, is_baked = self._light.look_up(sight.cell, at_rest)
        baked = self._light.radiance(cluster, weights, is_baked)
        baked = [a + dr.select(is_baked, b, 0.0) for a, b in zip(baked, direct, strict=True)]
        standing = self._light.standing(cluster, weights, is_baked)
        return emitted, baked, standing, sky, is_baked, surface


_LARGEST_SHARE = 0.01


class Neighborhood:
    """Points near moving objects."""

    def __init__(self, meshes: Sequence[MergedMesh]) -> None:
        self._meshes = [mesh for mesh in meshes if isinstance(mesh, MovingMesh)]
        self._spheres: list[tuple[Any, Any]] = []
        self.move_to(0.0)

    def __bool__(self) -> bool:
        return bool(self._meshes)

    def move_to(self, time_s: float) -> None:
        """Move the objects to a time."""
        self._spheres = []
        for mesh in self._meshes:
            vertices = mesh.vertices_at(time_s)
            for part in mesh.parts:
                points = vertices[part.vertices]
                center = (points.min(axis=0) + points.max(axis=0)) / 2.0
                reach = float(np.linalg.norm(points - center, axis=1).max())
                sphere = mi.Point3f(center.tolist()), mi.Float(reach**2 / _LARGEST_SHARE)
                dr.make_opaque(sphere)  # otherwise every time would be compiled anew
                self._spheres.append(sphere)

    def holds(self, points: Any) -> Any:
        """True for points (N,) near moving objects."""
        near = mi.Bool(False)
        for center, reach2 in self._spheres:
            near |= dr.squared_norm(points - center) < reach2
        return near
