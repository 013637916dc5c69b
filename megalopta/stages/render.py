"""The render stage: radiance and ground truth of every frame, on disk."""

import json
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.config.model import Configuration
from megalopta.config.rendering import RenderingSettings
from megalopta.core import files
from megalopta.core.errors import UserError, refused_as
from megalopta.core.freshness import BAKE_MODEL, RENDER_MODEL, TRUTH_MODEL
from megalopta.core.progress import progress, say, step
from megalopta.core.quantities import number, percent, short, with_error
from megalopta.dataset import labels, sintel
from megalopta.dataset.frames import decoded
from megalopta.dataset.rendering_noise import ATTRIBUTE, noise_record
from megalopta.dataset.store import SUFFIXES, Dataset
from megalopta.render import (
    MEASURED_EVERY,
    MeasuredPass,
    RenderNoise,
    choose_variant,
    frame_seed,
    llvm_in_use,
    read_radiance,
    render_once,
    render_until,
    write_radiance,
    write_truth,
)
from megalopta.render.exr import read_headers
from megalopta.scenes import ToneCurve, build_scene, preview
from megalopta.scenes.scene import Scene
from megalopta.scenes.spectra.color import linear_srgb
from megalopta.stages.declaration import Stage
from megalopta.stages.importing import check_pictures, import_pictures

_REFLECTANCE = {"emissiveUnits": "1", "quantity": "diffuse reflectance"}
"""Attributes of the files of albedo, which are laid out as those of radiance"""


def render(dataset: Dataset) -> None:
    """Render the missing frames; for pictures, copy the files."""
    if not dataset.configuration.scene.has_truth:
        import_pictures(dataset)
        return
    frames = range(dataset.configuration.trajectory.frames)
    missing = [
        index for index in frames if not all(path.exists() for path in _frame_files(dataset, index))
    ]
    if missing or not dataset.scene_record.exists():
        say("render: building the scene")
        writer = FrameWriter(dataset)
        say(f"render: {writer.objects} objects, {writer.triangles:,} triangles; {writer.variant}")
        say(f"render: integrator {writer.integrator}")
        with progress("Rendering radiance and truth", len(missing), "frame") as advance:
            for index in missing:
                writer.write(index)
                advance()
        writer.write_sequence_labels()
        with step("measuring light"):
            record = writer.record()
        files.write_json(dataset.scene_record, record)
        _say_light(dataset.configuration, record)
    with step("writing previews"):
        write_previews(dataset)


def _frame_files(dataset: Dataset, index: int) -> list[Path]:
    settings = dataset.configuration
    kinds = ["depth", *settings.labels]
    if settings.camera.intrinsics is not None:
        kinds += ["camdata_left"]
    if index + 1 < settings.trajectory.frames:
        kinds += ["flow", "occlusions", "invalid"]
    if settings.stereo_with:
        kinds += ["disparities", "occlusions_stereo"]
    training = [dataset.frame(f"training/{kind}", index) for kind in kinds]
    of_shutter = dataset.exposed_radiance(index), dataset.exposed_truth(index)
    return [dataset.frame("radiance", index), dataset.frame("truth", index), *of_shutter, *training]


def build(settings: Configuration) -> Scene:
    """Build the scene of a configuration, and tell what of it has no effect. Raises UserError."""
    with refused_as("scene"):
        scene = build_scene(
            settings.scene,
            settings.light,
            settings.scene_camera or settings.camera,
            settings.trajectory,
            settings.objects,
        )
    for note in scene.notes:
        say(f"scene: {note}")
    return scene


class FrameWriter:
    """Renders frames of a dataset's sequence to their files.

    `whole` is the sequence of which the dataset's frames are the first, to measure its cost. Then
    baked light kept on disk is not used.
    """

    def __init__(self, dataset: Dataset, whole: Configuration | None = None) -> None:
        self._dataset = dataset
        settings = self._settings = whole or dataset.configuration
        path, shutter = settings.trajectory, settings.shutter
        with step("building the scene"):
            scene = build(settings)
        self._poses, self._times_s = path.poses(), path.times_s
        seen_s = self._times_s  # with a shutter, also the ends of exposures
        if not shutter.is_instant:
            reach = (shutter.exposure_s + shutter.readout_s) / 2
            seen_s = np.asarray(seen_s[:, None] + reach * np.array([-1, 0, 1])).ravel()
        with step("loading the scene"), refused_as("render"):
            from megalopta.render import SceneRenderer

            poses, seed = path.pose_at(seen_s), settings.seed
            self._renderer = SceneRenderer(
                scene, settings.camera, settings.render, poses, seed, seen_s
            )
        self._work = "compiling and rendering radiance"  # of the first frame
        self._kinds, self._origin_m, self._notes = scene.kinds, scene.origin_m, scene.notes
        if "classes" in settings.labels and len(self._kinds) > labels.MOST_CLASSES:
            raise UserError(
                f"labels: {len(self._kinds)} kinds of objects, and `classes` holds "
                f"{labels.MOST_CLASSES}; omit it"
            )
        self._motions = {
            str(index + 1): placement.motion.record()
            for index, placement in enumerate(scene.placements)
            if placement.motion
        }
        self.objects, self.triangles = len(scene.placements), scene.triangle_count
        self.variant, self.integrator = self._renderer.variant, self._renderer.integrator

    def record(self) -> dict[str, Any]:
        """Record of the rendering: counts, names of kinds, motions by object, light and its noise.

        The truncation bias is the share of the light of surfaces, by band, that needs more hits
        than paths may have.
        """
        middle = len(self._poses) // 2
        left_out = self._renderer.light_left_out(self._poses[middle], float(self._times_s[middle]))
        # illuminance is measured below nine points of the camera's path
        metered = np.unique(np.linspace(0, len(self._poses) - 1, 9).astype(int))
        illuminance = None  # of a self-luminous scene
        if survey := self._renderer.light_survey(self._poses[metered, :3, 3]):
            illuminance = {
                "requested_lux": self._settings.light.resolved().illuminance_lux,
                "unshaded_lux": survey.unshaded.lux,
                "unshaded_standard_error_lux": survey.unshaded.standard_error_lux,
                "ground": [asdict(point) for point in survey.ground],
            }
        return {
            "objects": self.objects,
            "triangles": self.triangles,
            "variant": self.variant.name,
            "integrator": self.integrator,
            "kinds": list(self._kinds),
            "notes": list(self._notes),
            "motions": self._motions,
            "illuminance": illuminance,
            "light_left_out": None if left_out is None else left_out.tolist(),
            "monte_carlo": noise_record(self._dataset, self._renderer.samples_per_pixel),
        }

    def _view(self, index: int) -> dict[str, str]:
        """Attributes of a truth file: camera, pose, time and names."""
        camera = self._settings.camera
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
        settings, renderer, frame = self._settings, self._renderer, dataset.frame
        camera, seed = settings.camera, settings.seed
        radiance, noise = self._until_good(
            index,
            lambda number: renderer.radiance(pose, frame_seed(seed, index, number), time),
            lambda number: renderer.measured(pose, frame_seed(seed, index, number), time),
        )
        with step("tracing truth"):
            truth = renderer.truth(self._poses, index, self._times_s)
        attributes = {
            "illuminanceLux": f"{settings.light.resolved().illuminance_lux:g}",
            "timeSeconds": f"{time:.9g}",
        }
        measured = {ATTRIBUTE: noise.to_json()} if noise else {}
        self._write_light(frame("radiance", index), radiance, {**attributes, **measured})
        if index + 1 < len(self._poses):
            sintel.write_flow(dataset, index, truth)
        sintel.write_depth(frame("training/depth", index), truth.depth)
        if camera.intrinsics is not None:
            sintel.write_camera(frame("training/camdata_left", index), camera.intrinsics, pose)
        has_clusters = "clusters" in settings.labels
        clusters = renderer.leaf_clusters(pose, time) if has_clusters else None
        write_truth(frame("truth", index), truth, self._origin_m, self._view(index), clusters)
        labels.write_labels(dataset, index, truth, clusters)
        if "albedo" in settings.labels:
            albedo = renderer.albedo(pose, time)
            self._write_light(frame("training/albedo", index), albedo, _REFLECTANCE)
        if (baseline_m := settings.baseline_m) is not None:  # of a rig's other camera
            right = settings.trajectory.mounted(settings.stereo_with).pose_at([time])
            both = np.concatenate([self._poses[index : index + 1], right])
            flow = renderer.flow(both, 0, 1, [time, time])
            sintel.write_disparity(dataset, index, flow, baseline_m)
        if not settings.shutter.is_instant:
            self._write_exposed(index, attributes)

    def _write_light(
        self, path: Path, light: NDArray[np.float32], attributes: Mapping[str, str]
    ) -> None:
        """Write light in bands; the pictures in a folder have the exposure of the first."""
        settings, stops = self._settings, None
        white, bands_nm = settings.scene.white(settings.light), settings.render.bands_nm
        first = path.with_name(self._dataset.frame("radiance", 0).name)
        with suppress(FileNotFoundError, ValueError):  # a damaged file is reported by others
            stops = read_headers(first)[0].get("EV")
        if not (isinstance(stops, float) and abs(stops) < 100.0):  # steps of 2; more are ignored
            stops = None
        write_radiance(path, light, bands_nm, attributes, white=white, stops=stops)

    def write_sequence_labels(self) -> None:
        """Write names of classes and tracks of points, which belong to all frames."""
        dataset, tracked = self._dataset, self._settings.tracks
        if "classes" in self._settings.labels:
            path = dataset.frame("training/classes", 0).with_name("names.json")
            files.write_json(path, ["sky", *self._kinds])
        if tracked:
            image = tracked.points(self._settings.camera)
            with step("following points"):
                tracks = [
                    self._renderer.tracks(self._poses, frame, image, self._times_s)
                    for frame in tracked.frames
                ]
            labels.write_tracks(dataset.tracks, tracked, tracks)

    def _write_exposed(self, index: int, attributes: Mapping[str, str]) -> None:
        """Render one frame with the shutter; its seeds are independent of the sharp frame's."""
        dataset, settings, renderer = self._dataset, self._settings, self._renderer
        path, shutter = settings.trajectory, settings.shutter
        frame = path, shutter, index, settings.seed
        radiance, noise = self._until_good(
            index,
            lambda number: renderer.exposed(*frame, number),
            lambda number: renderer.exposed_measured(*frame, number),
        )
        times = {
            "exposureSeconds": repr(shutter.exposure_s), "readoutSeconds": repr(shutter.readout_s)
        }  # fmt: skip
        if noise:
            times[ATTRIBUTE] = noise.to_json()
        self._write_light(dataset.exposed_radiance(index), radiance, {**attributes, **times})
        if shutter.readout_s:
            with step("tracing truth"):
                truth = renderer.shutter_truth(path, shutter, index)
            file = dataset.exposed_truth(index)
            write_truth(file, truth, self._origin_m, {**self._view(index), **times})

    def _until_good(
        self,
        index: int,
        render_pass: Callable[[int], NDArray[np.float32]],
        measure_pass: Callable[[int], MeasuredPass],
    ) -> tuple[NDArray[np.float32], RenderNoise | None]:
        """Render a frame in as many passes as its target needs; return it and its error."""
        settings, work, self._work = self._settings.render, self._work, "rendering radiance"
        with step(work):
            if settings.target_error is None:
                return render_once(render_pass, None if index % MEASURED_EVERY else measure_pass)
            target, most = settings.target_error, settings.max_passes
            return render_until(render_pass, measure_pass, target, most)


def _say_light(settings: Configuration, record: Mapping[str, Any]) -> None:
    """Say how bright the rendering is, what light is missing, and its error."""
    rendering = settings.render
    if light := record["illuminance"]:
        measured = with_error(light["unshaded_lux"], light["unshaded_standard_error_lux"], "lux")
        text = f"{short(light['requested_lux'])} lux requested, {measured} measured"
        if ground := [point["lux"] for point in light["ground"]]:
            text += (
                f" in the open and {number(np.mean(ground))} on the ground below the camera "
                f"({number(min(ground))} to {number(max(ground))} along its path)"
            )
        say(f"render: {text}")
    shares = record["light_left_out"]
    if shares and max(shares) >= 0.01:
        low, high = rendering.bands_nm[int(np.argmax(shares))]
        say(
            f"render: {percent(max(shares))} of the light of surfaces at {low:g} to {high:g} nm "
            f"takes more hits than render.max_depth {rendering.max_depth} allows and is missing; "
            "16 are enough in forests, and 64 in rooms"
        )
    noise = record["monte_carlo"]
    if not noise or not noise["rms_over_mean"]:
        return
    if (surface := noise["surface"]) is None:
        say(f"render: error of a pixel {percent(noise['rms_over_mean'])} RMS, from two renderings")
    else:
        rms, median, fixed = (percent(surface[key]) for key in ("rms", "median", "standing"))
        text = f"render: error on surfaces {rms} RMS, {median} median"
        if surface["standing"]:
            text += f", of which {fixed} RMS is the same in all frames"
        say(text)
    target, errors = rendering.target_error, noise["rms_over_mean_of_frames"]
    if target is not None and max(errors) > target:
        missed = sum(error > target for error in errors)
        say(
            f"render: {missed} of {settings.trajectory.frames} frames did not meet target_error "
            f"{target:g} in {rendering.max_passes} passes; the worst has {max(errors):.2g}: "
            "raise render.max_passes or render.samples_per_pixel"
        )


def write_previews(dataset: Dataset) -> None:
    """Write tone-mapped previews of the radiance, with one curve for all frames."""
    settings = dataset.configuration
    white = settings.scene.white(settings.light)
    bands_nm, frames = settings.render.bands_nm, range(settings.trajectory.frames)

    def radiance(index: int) -> Any:
        return decoded(dataset.frame("radiance", index), read_radiance)[0]

    curve = ToneCurve.of(linear_srgb(radiance(index), bands_nm, white) for index in frames)
    for index in frames:
        image = preview(radiance(index), bands_nm, white, curve)
        sintel.write_png(dataset.frame("training/clean", index), image)


_FOLDERS = sorted({*SUFFIXES, "training/tracks", "pictures"} - {"training/final"})


def _check(settings: Configuration) -> None:
    if settings.scene.has_truth:
        choose_variant(settings.render.backend)
    else:
        check_pictures(settings)


def _made_with(settings: Configuration) -> dict[str, str]:
    model = {"model": f"{RENDER_MODEL}.{BAKE_MODEL}.{TRUTH_MODEL}"}
    if not settings.scene.has_truth:
        return model
    variant = choose_variant(settings.render.backend).name
    libraries = {name: version(name) for name in ("mitsuba", "drjit")}
    llvm = {"llvm": llvm_in_use()[1]} if variant.startswith("llvm") else {}
    return {**model, "variant": variant, **libraries, **llvm}


STAGE: Stage = Stage(
    name="render",
    command="render",
    fields=tuple(RenderingSettings.model_fields),
    needs=(),
    outputs=lambda dataset: [dataset.root / kind / dataset.sequence for kind in _FOLDERS],
    work=render,
    made_with=_made_with,
    check=_check,
    rehearse=lambda settings: build(settings) if settings.scene.has_truth else None,
)
