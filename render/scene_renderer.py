"""Radiance and ground truth of a scene along a trajectory.

Every frame has its own seed: equal seeds give noise that is fixed on the sensor and seen at rest.
"""

from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from megalopta.core.arrays import Floats
from megalopta.render.baking.choice import path_tracing_reason
from megalopta.render.baking.integrator import BakedLightIntegrator
from megalopta.render.environment import EnvironmentView, under_panorama
from megalopta.render.film import ExposurePart, FrameExposure
from megalopta.render.guiding import FEWEST_SAMPLES, fitted_shares, guided
from megalopta.render.loading.meshes import leaf_clusters
from megalopta.render.loading.scene import MovingScene, fill, is_layered, whole_scene
from megalopta.render.mitsuba_loader import activate, is_scalar
from megalopta.render.noise import MeasuredPass
from megalopta.render.path_tracing import PathIntegrator, SplitPaths, can_split
from megalopta.render.settings import RenderSettings, bake_seed, frame_seed
from megalopta.render.surface_view import Integrator, LightSurvey, SurfaceView
from megalopta.render.truth.geometry import Geometry, Instant, Rolling
from megalopta.render.truth.tracer import Flow, Tracks, Truth, TruthTracer, albedo_of
from megalopta.render.variant import Variant, choose_variant
from megalopta.scenes import Shutter
from megalopta.scenes.cameras.base import Camera
from megalopta.scenes.scene import Scene
from megalopta.scenes.trajectories.base import Path
from megalopta.scenes.trajectories.orbit import Fit, bounds_of

# Poses of an exposure whose lines all start at the same time, and of one with a rolling shutter.
_POSES, _ROLLING_POSES = 256, 64


class SceneRenderer:
    """Loaded scene and camera, to be moved along poses.

    Raises ValueError if a panorama cannot be read, a band is beyond what is known of a material, or
    none of the poses sees a surface.

    Parameters
    ----------
    poses : (T, 4, 4), optional
        Poses of the camera; light is baked for these, and haze covers them. Without them paths are
        traced.
    seed : int
        Seed of the sequence, for data shared by its frames.
    times_s : (T,), optional
        Times of the poses, s; with these, a view of no surface is refused.

    Attributes
    ----------
    samples_per_pixel : int
        Light paths per pixel, as rounded by the sampler.
    integrator : str
        "baked" or "path", with the reason for tracing paths.
    """

    def __init__(
        self,
        scene: Scene,
        camera: Camera,
        settings: RenderSettings,
        poses: Floats | None = None,
        seed: int = 0,
        times_s: Floats | None = None,
    ) -> None:
        self.camera = camera
        self.variant: Variant = choose_variant(settings.backend)
        activate(self.variant)
        scene.check_bands(settings.bands_nm)
        scene = under_panorama(scene)
        is_plain = settings.integrator == "plain"
        full_scene = self._whole = whole_scene(scene, is_plain)
        meshes, loaded = full_scene.meshes, full_scene.loaded
        self._scene, self._loaded = scene, loaded
        geometry = self._geometry = Geometry(meshes, loaded)
        self._meshes, self._bands_nm = meshes, settings.bands_nm
        self._tracer = TruthTracer(scene, geometry, camera, settings.truth_rays)
        if poses is not None and times_s is not None:
            self._refuse_empty_view(poses, times_s)
        pixels = camera.width * camera.height
        reason = path_tracing_reason(scene, self.variant.name, poses, settings, pixels)
        self._view: SurfaceView | EnvironmentView
        if scene.environment:
            if camera.lens_m:
                raise ValueError("camera.aperture_mm: a panorama has no distances; omit it")
            self._view = EnvironmentView(
                scene.environment, camera, settings.bands_nm, settings.samples_per_pixel
            )
        else:
            local = np.zeros((0, 4, 4)) if poses is None else self._local(poses)
            its_seed, places = bake_seed(seed), local[:, :3, 3]
            samples = len(local) * pixels * settings.most_samples
            adapts = samples >= FEWEST_SAMPLES and not (is_plain or scene.haze or is_scalar())
            if adapts:
                full_scene = self._whole = guided(full_scene, camera, local, samples, its_seed)
                self._loaded = full_scene.loaded
            air = fill(scene, scene.haze, loaded, meshes, places) if scene.haze else None
            integrator: Integrator = PathIntegrator(settings.max_depth, air)
            exposing = split = None
            if can_split(scene, meshes) and not is_plain:
                integrator = split = SplitPaths(full_scene, settings)
                if adapts:
                    split.shares = fitted_shares(split, camera, settings, local, its_seed)
                if is_layered(meshes):
                    layers = MovingScene(meshes, full_scene.loaded, geometry.still)
                    exposing = SplitPaths(full_scene, settings, layers)
                    exposing.shares = split.shares
            if poses is not None and not reason:
                baked = BakedLightIntegrator(full_scene, split, camera, settings, local, its_seed)
                reason = baked.reason
                if not reason:
                    integrator, exposing = baked, None
            self._view = SurfaceView(full_scene, camera, settings, integrator, exposing, air)
        self.integrator = f"path ({reason})" if reason else "baked"
        self.samples_per_pixel = self._view.samples_per_pixel

    def _refuse_empty_view(self, poses: Floats, times_s: Floats) -> None:
        """Raise ValueError with a path that sees the scene if none of the poses sees a surface."""
        scene = self._scene
        if not scene.placements or scene.haze:
            return  # a panorama or haze is seen
        sampled = np.unique(np.linspace(0, len(poses) - 1, 256).astype(int))  # most poses searched
        views = map(Instant, times_s[sampled].tolist(), self._local(poses[sampled]))
        if all(self._tracer.see(view).is_sky.all() for view in views):
            bounds = bounds_of(scene)
            low, high = (", ".join(f"{x:.7g}" for x in corner) for corner in bounds)
            orbit = Fit().around(bounds, self.camera)
            center = " ".join(f"{x:.12g}" for x in orbit.center_m)
            raise ValueError(
                "the camera sees no surface in any frame; surfaces extend from "
                f"({low}) to ({high}) m, and this path sees all of them: --trajectory.kind orbit "
                f"--trajectory.center_m {center} --trajectory.radius_m {orbit.radius_m:g} "
                f"--trajectory.height_m {orbit.height_m:g}"
            )

    def radiance(self, pose: Floats, seed: int, time_s: float = 0.0) -> NDArray[np.float32]:
        """Spectral radiance (H, W, B) seen from a pose (4, 4), W·m⁻²·sr⁻¹·nm⁻¹, band means.

        `time_s` sets the positions of moving objects. Raises FloatingPointError if the renderer
        returns a value that is not finite.
        """
        return self._view.radiance(self._at(pose, seed, time_s))

    def measured(self, pose: Floats, seed: int, time_s: float = 0.0) -> MeasuredPass:
        """The same as `radiance`, with the data that determines its error."""
        return self._view.measured(self._at(pose, seed, time_s))

    def exposed(
        self, path: Path, shutter: Shutter, frame: int, seed: int, number: int = 0
    ) -> NDArray[np.float32]:
        """Spectral radiance (H, W, B) of a frame with a shutter: blurred, rolling or both.

        The samples of a sharp frame are spread over the exposure, with their own noise from the
        seed of the sequence and the number of the pass. With moving objects, they share
        `shutter.poses` instants at which the objects are placed.
        """
        return self._view.radiance(self._exposure(path, shutter, frame, seed, number))

    def exposed_measured(
        self, path: Path, shutter: Shutter, frame: int, seed: int, number: int = 0
    ) -> MeasuredPass:
        """The same as `exposed`, with the data that determines its error."""
        return self._view.measured(self._exposure(path, shutter, frame, seed, number))

    def _at(self, pose: Floats, seed: int, time_s: float) -> FrameExposure:
        return FrameExposure((ExposurePart(self._local(pose), [time_s], seed),))

    def _exposure(
        self, path: Path, shutter: Shutter, frame: int, seed: int, number: int
    ) -> FrameExposure:
        if shutter.readout_s:
            self._refuse_panorama(shutter)
        is_rolling, size = shutter.readout_s > 0, self.camera.shape[1 - shutter.across]
        lines = (
            shutter.delay_s(np.arange(size, dtype=float) + 0.5, size) if is_rolling else np.zeros(1)
        )
        parts = shutter.poses if self._scene.is_moving or self._scene.environment else 1
        total = parts if self._scene.environment else _ROLLING_POSES if is_rolling else _POSES
        parts, total = (parts, max(total, parts)) if shutter.exposure_s else (1, 1)
        count = -(-total // parts)
        middles = (np.arange(parts * count) + 0.5) / (parts * count) - 0.5
        times = path.times_s[frame] + shutter.exposure_s * middles[:, None] + lines
        poses = self._local(path.pose_at(times.ravel())).reshape(parts, count, len(lines), 4, 4)
        instants = times.reshape(parts, count, len(lines)).mean(axis=1).tolist()
        seeds = [frame_seed(seed, frame, number, part) for part in range(parts)]
        by_columns = is_rolling and shutter.across == 0
        return FrameExposure(
            tuple(map(ExposurePart, poses, instants, seeds)), is_rolling, by_columns
        )

    def light_survey(self, positions: Floats) -> LightSurvey | None:
        """Illuminance above and below camera positions (N, 3); None if only surfaces emit."""
        return self._view.light_survey(positions)

    def light_left_out(self, pose: Floats, time_s: float = 0.0) -> Floats | None:
        """Truncation bias: missing share of surface light, by band, due to the path limit, (B,).

        It is for a pose (4, 4); None for a panorama.
        """
        return self._view.light_left_out(self._local(pose), time_s)

    def truth(self, poses: Floats, frame: int, times_s: ArrayLike | None = None) -> Truth:
        """Ground truth of one frame of a sequence, with flow toward the one after and before.

        Poses (T, 4, 4) are camera to world; times (T,), s, are required if objects move.
        """
        last = len(poses) - 1
        return self._tracer.truth(
            self._instant(poses, frame, times_s),
            self._instant(poses, frame + 1, times_s) if frame < last else None,
            self._instant(poses, frame - 1, times_s) if frame > 0 else None,
        )

    def flow(self, poses: Floats, frame: int, other: int, times_s: ArrayLike | None = None) -> Flow:
        """Flow and occlusion between any two frames of a sequence; arguments as for `truth`."""
        return self._tracer.flow(
            self._instant(poses, frame, times_s), self._instant(poses, other, times_s)
        )

    def tracks(
        self, poses: Floats, frame: int, image: Floats, times_s: ArrayLike | None = None
    ) -> Tracks:
        """Follow the points seen at image coordinates (N, 2) of a frame through all frames.

        Other arguments as for `truth`.
        """
        instants = [self._instant(poses, index, times_s) for index in range(len(poses))]
        return self._tracer.tracks(instants[frame], instants, image)

    def albedo(self, pose: Floats, time_s: float = 0.0) -> NDArray[np.float32]:
        """Diffuse reflectance (H, W, B) at the pixel centers, means over the bands; sky: 0."""
        surface = self._tracer.see(Instant(time_s, self._local(pose)))
        albedo = albedo_of(
            surface, self._geometry, self._meshes, self._scene.materials, self._bands_nm
        )
        return albedo.reshape(*self.camera.shape, -1).astype(np.float32)

    def leaf_clusters(self, pose: Floats, time_s: float = 0.0) -> NDArray[np.uint32]:
        """Number of the twig (H, W), within its plant from 1, whose leaf the pixel centers see.

        0 elsewhere: only trees and bushes of a forest have leaves on twigs.
        """
        surface = self._tracer.see(Instant(time_s, self._local(pose)))
        return self._clusters[surface.triangle].reshape(self.camera.shape)

    @cached_property
    def _clusters(self) -> NDArray[np.uint32]:
        return leaf_clusters(self._scene)

    def shutter_truth(self, path: Path, shutter: Shutter, frame: int) -> Truth:
        """Ground truth of one frame of a rolling shutter; every line has its own time.

        Flow leads to the point's position in the other frame, with the same shutter.
        """
        if shutter.readout_s:
            self._refuse_panorama(shutter)

        def pose_at(times_s: Floats) -> Floats:
            return self._local(path.pose_at(times_s))

        views = [Rolling(time, shutter, pose_at) for time in path.times_s.tolist()]
        following = views[frame + 1] if frame + 1 < len(views) else None
        return self._tracer.truth(views[frame], following, views[frame - 1] if frame else None)

    def _refuse_panorama(self, shutter: Shutter) -> None:
        if self._scene.environment:
            raise ValueError(
                f"shutter.readout_s {shutter.readout_s:g}: the scene is a panorama, but a rolling "
                "shutter needs surfaces; use 0"
            )

    def _instant(self, poses: Floats, frame: int, times_s: ArrayLike | None) -> Instant:
        if times_s is None and self._scene.is_moving:
            raise ValueError("times_s is missing: objects move in this scene; give the times")
        time = 0.0 if times_s is None else float(np.asarray(times_s)[frame])
        return Instant(time, self._local(poses[frame]))

    def _local(self, pose: Floats) -> Floats:
        """Pose (..., 4, 4) relative to the scene's origin, in the renderer's precision."""
        local = pose.copy()
        local[..., :3, 3] = (pose[..., :3, 3] - self._scene.origin_m).astype(np.float32)
        return local
