"""The render stage: scene to radiance and ground truth of every frame, on disk."""

import math
from pathlib import Path

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
from megalopta.scenes.build import build_scene, glows
from megalopta.scenes.color import encode_srgb, linear_srgb
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
            record = {
                "objects": writer.objects,
                "triangles": writer.triangles,
                "variant": writer.variant.name,
                "monte_carlo": writer.monte_carlo_noise(advance),
            }
        files.write_json(dataset.scene_record, record)
    _write_previews(dataset)


def _frame_files(dataset: Dataset, index: int) -> list[Path]:
    kinds = [("depth", "dpt"), ("camdata_left", "cam")]
    if index + 1 < dataset.configuration.trajectory.frames:
        kinds += [("flow", "flo"), ("occlusions", "png"), ("invalid", "png")]
    training = [dataset.frame(f"training/{kind}", index, suffix) for kind, suffix in kinds]
    return [dataset.radiance(index), dataset.truth(index), *training]


def _build(settings: Configuration) -> Scene:
    try:
        return build_scene(settings.scene, settings.light, settings.camera, settings.trajectory)
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
        self.objects, self.triangles = len(scene.placements), scene.triangle_count
        self.variant = self._renderer.variant

    def write(self, index: int) -> None:
        """Render one frame to all its files."""
        dataset, pose = self._dataset, self._poses[index]
        settings = dataset.configuration
        radiance = self._renderer.radiance(pose, frame_seed(settings.seed, index))
        truth = self._renderer.truth(self._poses, index)
        attributes = {
            "illuminanceLux": f"{settings.light.resolved().illuminance_lux:g}",
            "timeSeconds": f"{settings.trajectory.times_s[index]:.9g}",
        }
        write_radiance(dataset.radiance(index), radiance, settings.render.bands_nm, attributes)
        if index + 1 < len(self._poses):
            sintel.write_flow(dataset.root / "training", dataset.sequence, index, truth)
        sintel.write_depth(dataset.frame("training/depth", index, "dpt"), truth.depth)
        camera_path = dataset.frame("training/camdata_left", index, "cam")
        sintel.write_camera(camera_path, settings.camera, pose)
        write_truth(dataset.truth(index), truth)

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
            second = self._renderer.radiance(self._poses[index], seed)
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
    white = flat(1.0) if glows(configuration.scene) else configuration.light.resolved().spectrum()
    exposure = None
    for index in range(configuration.trajectory.frames):
        linear = linear_srgb(*read_radiance(dataset.radiance(index)), white)
        exposure = exposure or _white_level(linear)
        image = encode_srgb(linear / exposure)
        sintel.write_png(dataset.frame("training/clean", index, "png"), image)
