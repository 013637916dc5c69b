"""Radiance and ground truth of a scene seen along a trajectory.

The scene is loaded once; per frame only the pose moves, with a seed of its own, since the same seed
would give noise that stands still on the sensor and reads as "no motion".
"""

from typing import Annotated, Any, Literal

import mitsuba as mi
import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field, model_validator

from megalopta.render.exr import channel_names
from megalopta.render.merge import merge
from megalopta.render.mitsuba_scene import load_scene, load_sensor, sensor_transform
from megalopta.render.truth import TriangleTable, Truth, frame_truth
from megalopta.render.variant import Backend, Variant, activate, choose_variant
from megalopta.scenes.camera import PerspectiveCamera
from megalopta.scenes.scene import Scene

# Dr.Jit numbers the samples of one pass with 32 bits and crashes beyond.
MAXIMUM_SAMPLES = 2**32


class RenderSettings(
    BaseModel, frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True
):
    """How radiance is computed."""

    samples_per_pixel: Annotated[int, Field(ge=1)] = 25
    """Light paths per pixel and frame. Samplers round up: multijitter to a product of two near
    factors, orthogonal to the square of a prime, ldsampler to a power of four; independent takes
    any number."""

    max_depth: Annotated[int, Field(ge=1)] = 4
    """Longest path in surface hits plus one: 2 is direct light, each more one bounce."""

    bands_nm: Annotated[tuple[tuple[float, float], ...], Field(min_length=1)] = (
        (400, 475),
        (475, 550),
        (550, 625),
        (625, 700),
    )
    """Spectral bands, lower and upper edge (nm). A path carries four wavelengths: more bands make
    each band noisier, not their sum."""

    sampler: Literal["independent", "multijitter", "orthogonal", "ldsampler"] = "multijitter"
    """Mitsuba's sample generator."""

    backend: Backend = "auto"
    """Mitsuba variant family; auto takes cuda, else llvm, else scalar."""

    @model_validator(mode="after")
    def _bands_are_intervals(self) -> "RenderSettings":
        for lower, upper in self.bands_nm:
            if not 100 <= lower < upper <= 4000:
                raise ValueError(
                    f"bands_nm: [{lower:g}, {upper:g}] is not a band between 100 and 4000 nm; "
                    "give the lower edge first"
                )
        channel_names(self.bands_nm)
        return self


def check_sample_count(
    camera: PerspectiveCamera, settings: RenderSettings, rounded: int | None = None
) -> None:
    """Refuse more samples a frame than one pass can number (2³²).

    Parameters
    ----------
    camera : PerspectiveCamera
    settings : RenderSettings
    rounded : int, optional
        Samples per pixel that the sampler makes of those asked for; by default the same.
    """
    asked, pixels = settings.samples_per_pixel, camera.width * camera.height
    samples = rounded or asked
    if samples * pixels >= MAXIMUM_SAMPLES:
        is_rounded = samples != asked
        made = f", which {settings.sampler} rounds up to {samples}," if is_rounded else ""
        raise ValueError(
            f"samples_per_pixel {asked}{made} at {camera.width} × {camera.height} pixels makes "
            f"{samples * pixels} samples a frame, and one pass holds fewer than 2³²: "
            f"use at most {(MAXIMUM_SAMPLES - 1) // pixels}"
            + (", counted after rounding" if is_rounded else "")
        )


def frame_seed(seed: int, frame: int) -> int:
    """Mitsuba's 32-bit seed of one frame, unrelated between frames and between sequence seeds."""
    return int(np.random.SeedSequence(seed, spawn_key=(frame,)).generate_state(1)[0])


def trace_paths(integrator: Any, scene: Any, sensor: Any, seed: int, samples: int) -> Any:
    """Mitsuba's image, in its type.

    The integrator is called itself: `mi.render` wraps it for differentiation, and that wrapper
    turns Ctrl-C into a RuntimeError.
    """
    return integrator.render(scene, sensor, seed=seed, spp=samples)


class SceneRenderer:
    """A loaded scene and a camera, ready to be moved along poses.

    Parameters
    ----------
    scene : Scene
        What to render.
    camera : PerspectiveCamera
        Image size and field of view.
    settings : RenderSettings
        Samples, bands, backend.

    Attributes
    ----------
    samples_per_pixel : int
        Light paths per pixel as the sampler rounds them.
    variant : Variant
        The Mitsuba variant in use.

    Raises
    ------
    ValueError
        When a frame has more samples than one pass can number.
    """

    def __init__(self, scene: Scene, camera: PerspectiveCamera, settings: RenderSettings) -> None:
        check_sample_count(camera, settings)
        self.camera = camera
        self.settings = settings
        self.variant: Variant = choose_variant(settings.backend)
        activate(self.variant)
        self._sensor = load_sensor(
            camera, settings.bands_nm, settings.sampler, settings.samples_per_pixel
        )
        self.samples_per_pixel = int(self._sensor.sampler().sample_count())
        check_sample_count(camera, settings, self.samples_per_pixel)
        meshes = merge(scene)
        self._scene = load_scene(scene, meshes)
        self._table = TriangleTable.of(meshes)
        self._sensor_parameters = mi.traverse(self._sensor)
        self._integrator = mi.load_dict({"type": "path", "max_depth": settings.max_depth})

    def radiance(self, pose: NDArray[np.float64], seed: int) -> NDArray[np.float32]:
        """Spectral radiance (H, W, B) seen from a pose (4, 4), W·m⁻²·sr⁻¹·nm⁻¹, band means.

        Raises
        ------
        FloatingPointError
            When the renderer returns a value that is not finite.
        """
        self._sensor_parameters["to_world"] = sensor_transform(pose)
        self._sensor_parameters.update()
        image = trace_paths(
            self._integrator, self._scene, self._sensor, seed, self.samples_per_pixel
        )
        radiance = np.array(image, dtype=np.float32)
        if not np.isfinite(radiance).all():
            raise FloatingPointError(
                "the renderer returned radiance that is not finite: look for NaN in textures, "
                "spectra or vertices"
            )
        return radiance

    def truth(self, poses: NDArray[np.float64], frame: int) -> Truth:
        """Ground truth of one frame of a sequence of poses (T, 4, 4)."""
        return frame_truth(
            self._scene,
            self._table,
            self.camera,
            poses[frame],
            poses[frame + 1] if frame + 1 < len(poses) else None,
            poses[frame - 1] if frame > 0 else None,
        )
