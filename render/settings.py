"""Settings of radiance, and the seeds of its noise; no renderer is needed here."""

import hashlib
from collections.abc import Sequence
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from megalopta.core.record import Record

Bands = Sequence[tuple[float, float]]


def channel_names(bands_nm: Bands) -> list[str]:
    """Channel name of each band, after its center, which must be unique (ValueError)."""
    centers = [f"{(lower + upper) / 2:.3f}".replace(".", ",") for lower, upper in bands_nm]
    for number, center in enumerate(centers):
        first = centers.index(center)
        if first < number:
            bands = ["{:g}-{:g}".format(*bands_nm[index]) for index in (first, number)]
            raise ValueError(
                f"bands_nm: {' and '.join(bands)} nm share a center, which names the channel "
                f"S0.{center}nm; move an edge of one"
            )
    return [f"S0.{center}nm" for center in centers]


Backend = Literal["auto", "cuda", "llvm", "scalar"]


class RenderSettings(Record, frozen=True):
    """Settings of radiance."""

    samples_per_pixel: Annotated[int, Field(ge=1, le=2**20)] = 64
    """Camera rays per pixel and frame, each with a ray to sun or moon. Fewer rays look for the sky,
    and fewer are followed over other surfaces: as many as their noise in a few pixels asks for, or
    one in four (all, without sun or moon) and one in 16 in short sequences. Samplers round up:
    multijitter to a product of two near factors, orthogonal to the square of a prime, ldsampler to
    a power of four; independent accepts any number."""
    max_depth: Annotated[int, Field(ge=1, le=1000)] = 16
    """Longest path in surface hits plus one: 2 is direct light, 3 adds one reflection, and so on.
    16 omits up to 0.1 % of a forest's light in the near infrared, less in the visible, and costs no
    more than 8. By default scenes of meshes have 64: of a closed room of albedo 0.8, 16 omit 3 %.
    The scene record states the omitted share. In haze a scattering counts as a hit,
    and 64 more are allowed: enough down to a visibility of 20 m."""
    bands_nm: Annotated[tuple[tuple[float, float], ...], Field(min_length=1)] = (
        (400.0, 500.0),
        (500.0, 580.0),
        (580.0, 640.0),
        (640.0, 700.0),
    )
    """Spectral bands, lower and upper edge (nm): by default the peak of green leaves is one, which
    an edge near 550 nm would turn olive. Direct light is known for each band as a whole;
    paths over other surfaces are traced for four bands at a time."""
    sampler: Literal["independent", "multijitter", "orthogonal", "ldsampler"] = "multijitter"
    """Mitsuba's sample generator. In the demo's forest, at 49 samples, the others have 4.3 times
    the efficiency of independent, 1/(error² · CPU-seconds); multijitter rounds up least."""
    target_error: Annotated[float, Field(gt=0, lt=1)] | None = None
    """Target RMS error of pixels without sky, over their mean (sum over bands): passes of
    samples_per_pixel are added up, two at least, until it is reached; null renders one pass. Baked
    light's own error is at most half of this."""
    max_passes: Annotated[int, Field(ge=2, le=10_000)] = 16
    """Passes after which a frame is finished even if target_error is not reached."""
    integrator: Literal["auto", "path", "plain", "baked"] = "auto"
    """path traces the light of every frame anew, in parts, each with as many samples as its noise
    asks for, and in rooms looks for the sky where windows are; plain traces whole paths, as
    Mitsuba's path integrator does; baked computes the light on each surface once, which all views
    share, and traces paths for moving objects and near them; auto bakes if frames of the same error
    on surfaces then take less work. Scalar variants, and scenes with more than 16 moving objects,
    always use path; in haze auto does, and baked is rejected."""
    bake_error: Annotated[float, Field(gt=0, lt=1)] = 0.022
    """Noise of baked light, fixed on surfaces in all frames: RMS over pixels without sky, relative
    to their mean (sum over bands). It sets the number of rays; the scene record states the error
    reached, including that of sharing light between neighbors."""
    truth_rays: Annotated[int, Field(ge=1, le=1024)] = 16
    """Rays per pixel, rounded up to a square, for the ground truth of whole pixels: purity, sky,
    mean flow, its spread, occlusion. All other truth is that of the pixel's center."""
    backend: Backend = "auto"
    """Mitsuba variant family; auto takes llvm, otherwise scalar. cuda, on a graphics card, agrees
    with llvm to rounding, not to the bit, so auto never takes it."""
    samples_per_pass: Annotated[int, Field(ge=1, le=2**28)] | None = None
    """Largest number of light paths traced at once; Ctrl-C waits for them. By default one or two
    seconds' work, 2¹⁹ in scalar, 2²⁰ in llvm and 2²⁴ in cuda mode. The division of a frame into
    passes affects the seeds of its noise."""

    @property
    def most_samples(self) -> int:
        """Most samples of a pixel of a frame, in all passes."""
        passes = self.max_passes if self.target_error is not None else 1
        return self.samples_per_pixel * passes

    @property
    def standing_error(self) -> float:
        """Target error of baked light."""
        return min(self.bake_error, (self.target_error or 1) / 2)

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


def frame_seed(seed: int, frame: int, *parts: int) -> int:
    """32-bit Mitsuba seed of one frame, or of a numbered exposure of it, or an instant of one.

    Seeds of frames and sequences are unrelated.
    """
    return int(np.random.SeedSequence(seed, spawn_key=(frame, *parts)).generate_state(1)[0])


def part_seed(seed: int, purpose: str, number: int = 0) -> int:
    """32-bit Mitsuba seed of a numbered draw within a frame, unrelated to those of frames.

    `purpose` says what is drawn, such as "pass"; draws of different purposes are unrelated.
    """
    key = f"{purpose} {number} of {seed}".encode()
    return int.from_bytes(hashlib.blake2b(key, digest_size=4).digest(), "little")


def bake_seed(seed: int) -> int:
    """32-bit Mitsuba seed of a sequence's baked light, unrelated to those of its frames."""
    return frame_seed(seed, 0, 0, 0, 0)
