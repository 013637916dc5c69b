"""The render stage: scene to radiance and ground truth of every frame, on disk."""

import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from megalopta import sintel
from megalopta.configuration import Configuration
from megalopta.dataset import Dataset, begin_stage
from megalopta.progress import console, progress
from megalopta.render.exr import read_radiance, write_radiance, write_truth
from megalopta.render.renderer import SceneRenderer, frame_seed
from megalopta.scenes.build import build_scene
from megalopta.scenes.color import encode_srgb, linear_srgb
from megalopta.scenes.grating import Grating
from megalopta.scenes.light import planckian
from megalopta.scenes.spectrum import flat

# Share of the first frame that may be shown as pure white.
_WHITE_PERCENTILE = 99.0


def render_dataset(root: Path, configuration: Configuration, redo: bool = False) -> Dataset:
    """Render what is not there yet; a frame is there when its last file is."""
    dataset = begin_stage(root, configuration, "render", redo)
    if dataset.is_finished("render"):
        console.print(f"render: {root} is finished already", highlight=False)
        return dataset
    start = time.perf_counter()
    frames = range(configuration.trajectory.frames)
    missing = [index for index in frames if not _last_file(dataset, index).exists()]
    if missing:
        _render_frames(dataset, missing)
    _write_previews(dataset)
    dataset.finish("render", time.perf_counter() - start)
    return dataset


def _render_frames(dataset: Dataset, missing: list[int]) -> None:
    configuration = dataset.configuration
    console.print("render: building the scene", highlight=False)
    scene = build_scene(
        configuration.scene, configuration.light, configuration.camera, configuration.trajectory
    )
    renderer = SceneRenderer(scene, configuration.camera, configuration.render)
    console.print(
        f"render: {len(scene.placements)} objects, {scene.triangle_count:,} triangles; "
        f"{renderer.variant}",
        highlight=False,
    )
    poses = configuration.trajectory.poses()
    with progress("Rendering radiance and truth", len(missing), "frame") as advance:
        for index in missing:
            _render_frame(dataset, renderer, poses, index)
            advance()


def _render_frame(
    dataset: Dataset, renderer: SceneRenderer, poses: NDArray[np.float64], index: int
) -> None:
    configuration = dataset.configuration
    radiance = renderer.radiance(poses[index], frame_seed(configuration.seed, index))
    truth = renderer.truth(list(poses), index)
    training = dataset.root / "training"
    level = configuration.light.resolved()
    attributes = {
        "illuminanceLux": f"{level.illuminance_lux:g}",
        "timeSeconds": f"{configuration.trajectory.times_s[index]:.9g}",
    }
    write_radiance(dataset.radiance(index), radiance, configuration.render.bands_nm, attributes)
    if index + 1 < len(poses):
        sintel.write_flow(training, dataset.sequence, index, truth)
    sintel.write_depth(dataset.frame("training/depth", index, "dpt"), truth.depth)
    sintel.write_camera(
        dataset.frame("training/camdata_left", index, "cam"), configuration.camera, poses[index]
    )
    write_truth(_last_file(dataset, index), truth)


def _last_file(dataset: Dataset, index: int) -> Path:
    return dataset.truth(index)


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
