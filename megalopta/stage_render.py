"""The render stage: scene to radiance and ground truth of every frame, on disk."""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta import files, sintel
from megalopta.configuration import Configuration
from megalopta.dataset import Dataset
from megalopta.errors import UserError
from megalopta.progress import Advance, progress, say
from megalopta.render.exr import read_radiance, write_radiance, write_truth
from megalopta.render.renderer import SceneRenderer
from megalopta.render.settings import frame_seed
from megalopta.scenes.build import build_scene
from megalopta.scenes.camera import PerspectiveCamera
from megalopta.scenes.color import encode_srgb, linear_srgb
from megalopta.scenes.grating import Grating
from megalopta.scenes.light import planckian
from megalopta.scenes.scene import Scene
from megalopta.scenes.spectrum import flat

# White in the previews: the brightest tenth of the first frame, or less where an open sky would
# leave the ground in the dark.
_WHITE_PERCENTILE = 90.0
_WHITE_OVER_MEDIAN = 8.0


# Frames rendered a second time, with other seeds, to measure the renderer's noise.
_NOISE_FRAMES = 2


def render(dataset: Dataset) -> None:
    """Render the frames of which any file is not there yet."""
    frames = range(dataset.configuration.trajectory.frames)
    missing = [
        index for index in frames if not all(path.exists() for path in _frame_files(dataset, index))
    ]
    if missing or not dataset.scene_record.exists():
        say("render: building the scene")
        writer = FrameWriter(dataset)
        say(f"render: {writer.objects} objects, {writer.triangles:,} triangles; {writer.variant}")
        steps = len(missing) + _NOISE_FRAMES
        with progress("Rendering radiance and truth", steps, "frame") as advance:
            for index in missing:
                writer.write(index)
                advance()
            record = {**writer.record(), "monte_carlo": writer.monte_carlo_noise(advance)}
        files.write_json(dataset.scene_record, record)
    _write_previews(dataset)


def _frame_files(dataset: Dataset, index: int) -> list[Path]:
    kinds = [("depth", "dpt")]
    if isinstance(dataset.configuration.camera, PerspectiveCamera):
        kinds += [("camdata_left", "cam")]
    if index + 1 < dataset.configuration.trajectory.frames:
        kinds += [("flow", "flo"), ("occlusions", "png"), ("invalid", "png")]
    training = [dataset.frame(f"training/{kind}", index, suffix) for kind, suffix in kinds]
    of_shutter = dataset.exposed_radiance(index), dataset.exposed_truth(index)
    return [dataset.radiance(index), dataset.truth(index), *of_shutter, *training]


def _build(settings: Configuration) -> Scene:
    try:
        return build_scene(
            settings.scene,
            settings.light,
            settings.camera,
            settings.trajectory,
            settings.objects,
        )
    except ValueError as problem:
        raise UserError(f"scene: {problem}") from None


class FrameWriter:
    """Renders single frames of a dataset's sequence to their files."""

    def __init__(self, dataset: Dataset) -> None:
        self._dataset = dataset
        settings = dataset.configuration
        scene = _build(settings)
        self._renderer = SceneRenderer(scene, settings.camera, settings.render)
        self._poses = settings.trajectory.poses()
        self._times_s = settings.trajectory.times_s
        self._kinds, self._origin_m = scene.kinds, scene.origin_m
        self._motions = {
            str(index + 1): placement.motion.record()
            for index, placement in enumerate(scene.placements)
            if placement.motion
        }
        self.objects, self.triangles = len(scene.placements), scene.triangle_count
        self.variant = self._renderer.variant

    def record(self) -> dict[str, Any]:
        """What was rendered, for the scene's record: counts, names of kinds, motions by object."""
        return {
            "objects": self.objects,
            "triangles": self.triangles,
            "variant": self.variant.name,
            "kinds": list(self._kinds),
            "motions": self._motions,
        }

    def _view(self, index: int) -> dict[str, str]:
        """Attributes of a truth file: camera, pose, time and names, so that it explains itself."""
        camera = self._dataset.configuration.camera
        return {
            "camera": camera.model_dump_json(),
            "cameraToWorld": " ".join(map(repr, self._poses[index].ravel().tolist())),
            "depthMeaning": camera.depth_meaning,
            "kindNames": json.dumps(self._kinds),
            "timeSeconds": repr(float(self._times_s[index])),
        }

    def write(self, index: int) -> None:
        """Render one frame to all its files."""
        dataset, pose, time = self._dataset, self._poses[index], float(self._times_s[index])
        settings = dataset.configuration
        radiance = self._renderer.radiance(pose, frame_seed(settings.seed, index), time)
        truth = self._renderer.truth(self._poses, index, self._times_s)
        attributes = {
            "illuminanceLux": f"{settings.light.resolved().illuminance_lux:g}",
            "timeSeconds": f"{time:.9g}",
        }
        write_radiance(dataset.radiance(index), radiance, settings.render.bands_nm, attributes)
        if index + 1 < len(self._poses):
            root, wraps = dataset.root / "training", settings.camera.wraps
            sintel.write_flow(root, dataset.sequence, index, truth, wraps)
        sintel.write_depth(dataset.frame("training/depth", index, "dpt"), truth.depth)
        if isinstance(settings.camera, PerspectiveCamera):
            camera_path = dataset.frame("training/camdata_left", index, "cam")
            sintel.write_camera(camera_path, settings.camera, pose)
        write_truth(dataset.truth(index), truth, self._origin_m, self._view(index))
        if not settings.shutter.is_instant:
            self._write_exposed(index, attributes)

    def _write_exposed(self, index: int, attributes: Mapping[str, str]) -> None:
        """Render one frame as the shutter takes it; its seeds are unrelated to the sharp one's."""
        dataset, settings = self._dataset, self._dataset.configuration
        path, shutter = settings.trajectory, settings.shutter
        radiance = self._renderer.exposed(path, shutter, index, settings.seed)
        times = {
            "exposureSeconds": repr(shutter.exposure_s), "readoutSeconds": repr(shutter.readout_s)
        }  # fmt: skip
        file, bands_nm = dataset.exposed_radiance(index), settings.render.bands_nm
        write_radiance(file, radiance, bands_nm, {**attributes, **times})
        if shutter.readout_s:
            truth = self._renderer.shutter_truth(path, shutter, index)
            file = dataset.exposed_truth(index)
            write_truth(file, truth, self._origin_m, {**self._view(index), **times})

    def monte_carlo_noise(self, advance: Advance) -> dict[str, float]:
        """Noise of the rendering, from frames rendered twice (sum over bands).

        Returns
        -------
        dict
            median_relative: σ/mean of a pixel, median over pixels; rms_over_mean: RMS of the noise
            over the mean radiance; equivalent_photons_per_pixel: Poisson counts that scatter as
            much as the median pixel.
        """
        settings = self._dataset.configuration
        count = settings.trajectory.frames
        pairs = []
        for index in np.linspace(0, count - 1, _NOISE_FRAMES).astype(int).tolist():
            first, _ = read_radiance(self._dataset.radiance(index))
            seed = frame_seed(settings.seed, count + index)
            second = self._renderer.radiance(self._poses[index], seed, self._times_s[index])
            pairs.append([first.sum(axis=-1), second.sum(axis=-1)])
            advance()
        a, b = np.array(pairs, dtype=np.float64).swapaxes(0, 1)
        mean, difference = (a + b) / 2, np.abs(a - b) / math.sqrt(2)
        lit = mean > 0
        # The median of |N(0, 1)| is 0.6745.
        median = float(np.median(difference[lit] / mean[lit]) / 0.6745) if lit.any() else 0.0
        return {
            "median_relative": median,
            "rms_over_mean": float(np.sqrt((difference**2).mean()) / max(mean.mean(), 1e-300)),
            "equivalent_photons_per_pixel": 1 / max(median, 1e-6) ** 2,
        }


def _white_level(linear: NDArray[np.float64]) -> float:
    bright, middle = np.percentile(linear, [_WHITE_PERCENTILE, 50])
    return float(min(bright, _WHITE_OVER_MEDIAN * middle)) or float(linear.max()) or 1.0


def _write_previews(dataset: Dataset) -> None:
    """Tone-mapped radiance, all frames exposed alike, after the first."""
    configuration = dataset.configuration
    is_grating = isinstance(configuration.scene, Grating)
    light = configuration.light.resolved()
    white = flat(1.0) if is_grating else planckian(light.color_temperature_k)
    exposure = None
    for index in range(configuration.trajectory.frames):
        linear = linear_srgb(*read_radiance(dataset.radiance(index)), white)
        exposure = exposure or _white_level(linear)
        image = encode_srgb(linear / exposure)
        sintel.write_png(dataset.frame("training/clean", index, "png"), image)
