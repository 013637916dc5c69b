"""The render stage: scene to radiance and ground truth of every frame, on disk."""

import numpy as np

from megalopta import files, sintel
from megalopta.dataset import Dataset
from megalopta.progress import progress, say
from megalopta.render.exr import read_radiance, write_radiance, write_truth
from megalopta.render.renderer import SceneRenderer, frame_seed
from megalopta.scenes.build import build_scene
from megalopta.scenes.color import encode_srgb, linear_srgb
from megalopta.scenes.grating import Grating
from megalopta.scenes.light import planckian
from megalopta.scenes.spectrum import flat

# The brightest tenth of the first frame, mostly sky, may be shown as pure white.
_WHITE_PERCENTILE = 90.0


def render(dataset: Dataset) -> None:
    """Render what is not there yet; a frame is there when its truth file is."""
    frames = range(dataset.configuration.trajectory.frames)
    missing = [index for index in frames if not dataset.truth(index).exists()]
    if missing:
        say("render: building the scene")
        writer = FrameWriter(dataset)
        say(f"render: {writer.objects} objects, {writer.triangles:,} triangles; {writer.variant}")
        record = {
            "objects": writer.objects,
            "triangles": writer.triangles,
            "variant": writer.variant.name,
        }
        files.write_json(dataset.scene_record, record)
        with progress("Rendering radiance and truth", len(missing), "frame") as advance:
            for index in missing:
                writer.write(index)
                advance()
    _write_previews(dataset)


class FrameWriter:
    """Renders single frames of a dataset's sequence to their files."""

    def __init__(self, dataset: Dataset) -> None:
        self._dataset = dataset
        settings = dataset.configuration
        scene = build_scene(settings.scene, settings.light, settings.camera, settings.trajectory)
        self._renderer = SceneRenderer(scene, settings.camera, settings.render)
        self._poses = settings.trajectory.poses()
        self.objects, self.triangles = len(scene.placements), scene.triangle_count
        self.variant = self._renderer.variant

    def write(self, index: int) -> None:
        """Render one frame; its truth file is written last and marks it as complete."""
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


def _write_previews(dataset: Dataset) -> None:
    """Tone-mapped radiance, all frames exposed alike, after the first."""
    configuration = dataset.configuration
    is_grating = isinstance(configuration.scene, Grating)
    light = configuration.light.resolved()
    white = flat(1.0) if is_grating else planckian(light.color_temperature_k)
    exposure = None
    for index in range(configuration.trajectory.frames):
        linear = linear_srgb(*read_radiance(dataset.radiance(index)), white)
        exposure = exposure or float(np.percentile(linear, _WHITE_PERCENTILE)) or 1.0
        image = encode_srgb(linear / exposure)
        sintel.write_png(dataset.frame("training/clean", index, "png"), image)
