"""How radiance is computed, as settings, and the seeds of its noise; no renderer is needed here."""

from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, Field, model_validator

from megalopta.render.bands import channel_names
from megalopta.scenes.camera import PerspectiveCamera

Backend = Literal["auto", "cuda", "llvm", "scalar"]

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

    integrator: Literal["auto", "path", "baked"] = "auto"
    """path traces every path of every frame; baked computes the light on each surface once, which
    all views share; auto bakes where nothing moves and there are frames enough to pay for it.
    Scalar variants and scenes with moving objects always take path."""

    bake_samples: Annotated[int, Field(ge=1)] = 32
    """Light paths per baked cell, a piece of one side of a triangle that is up to 4 pixels long;
    cells that fill little of the sequence take a quarter or a sixteenth."""

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


def bake_seed(seed: int) -> int:
    """Mitsuba's 32-bit seed of a sequence's baked light, unrelated to those of its frames."""
    return int(np.random.SeedSequence(seed, spawn_key=(0, 0)).generate_state(1)[0])


def frame_seed(seed: int, frame: int) -> int:
    """Mitsuba's 32-bit seed of one frame, unrelated between frames and between sequence seeds."""
    return int(np.random.SeedSequence(seed, spawn_key=(frame,)).generate_state(1)[0])
