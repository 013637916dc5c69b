"""How radiance is computed, as settings, and the seeds of its noise; no renderer is needed here."""

from collections.abc import Sequence
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from megalopta.core.record import Record

Bands = Sequence[tuple[float, float]]


def channel_names(bands_nm: Bands) -> list[str]:
    """Name of the channel of each band, after its center, which must be its own (ValueError)."""
    centers = [f"{(lower + upper) / 2:.3f}".replace(".", ",") for lower, upper in bands_nm]
    for number, center in enumerate(centers):
        first = centers.index(center)
        if first < number:
            one, other = ("{:g}-{:g}".format(*bands_nm[index]) for index in (first, number))
            raise ValueError(
                f"bands_nm: {one} and {other} nm share a center, which names the channel "
                f"S0.{center}nm; move an edge of one"
            )
    return [f"S0.{center}nm" for center in centers]


Backend = Literal["auto", "cuda", "llvm", "scalar"]


class RenderSettings(Record, frozen=True):
    """How radiance is computed."""

    samples_per_pixel: Annotated[int, Field(ge=1, le=2**20)] = 25
    """Light paths per pixel and frame. Samplers round up: multijitter to a product of two near
    factors, orthogonal to the square of a prime, ldsampler to a power of four; independent takes
    any number."""

    max_depth: Annotated[int, Field(ge=1, le=1000)] = 16
    """Longest path in surface hits plus one: 2 is direct light, each more one bounce. Of the light
    that forests' surfaces send to the camera 2, 3, 4, 6, 8 and 16 leave out 10 to 19, 2 to 3, 0.3
    to 0.7, 0.02, 0 and 0 % at 500 to 600 nm, and 47 to 70, 27 to 46, 16 to 30, 6 to 11, 2 to 4 and
    0.1 % at 0.8 to 1.3 µm, where leaves are bright; from 8 on paths end by themselves and cost no
    more, 1.1 to 1.5 times those of 4. The scene record tells what is left out. In haze a scattering
    counts as a hit, and 64 more are allowed: enough down to a visibility of 20 m; denser fog takes
    more."""

    bands_nm: Annotated[tuple[tuple[float, float], ...], Field(min_length=1)] = (
        (400, 475),
        (475, 550),
        (550, 625),
        (625, 700),
    )
    """Spectral bands, lower and upper edge (nm). A path carries four wavelengths: more bands make
    each band noisier, not their sum."""

    sampler: Literal["independent", "multijitter", "orthogonal", "ldsampler"] = "multijitter"
    """Mitsuba's sample generator. At 49 samples of the demo's forest multijitter, orthogonal and
    ldsampler have the same efficiency, 1/(error² · CPU-seconds), 4.3 times that of independent
    sampling; multijitter wastes the least by rounding (benchmarks/bench_sampler.py)."""

    target_error: Annotated[float, Field(gt=0, lt=1)] | None = None
    """RMS error to stop at, of pixels without sky, over their mean (sum over bands): passes of
    samples_per_pixel are added up, two at least, until it is met; None renders one pass. Where
    light is baked, its own error is at most half of this."""

    max_passes: Annotated[int, Field(ge=2, le=10_000)] = 16
    """Passes at which a frame is finished even if target_error is not met."""

    integrator: Literal["auto", "path", "baked"] = "auto"
    """path traces every path of every frame; baked computes the light on each surface once, which
    all views share, and traces paths for objects that move and what is near them; auto bakes where
    frames of the same error on surfaces then take less work. Scalar variants, and scenes where more
    than 16 objects move, always take path; in haze auto does, and baked is refused."""

    bake_error: Annotated[float, Field(gt=0, lt=1)] = 0.022
    """Noise of baked light, which stands on surfaces in all frames alike: RMS over pixels without
    sky, relative to their mean (sum over bands). As many rays are traced as bring it about there;
    the scene record tells what was reached, with what sharing light between neighbors adds."""

    truth_rays: Annotated[int, Field(ge=1, le=1024)] = 16
    """Rays per pixel, rounded up to a square, from which the truth tells what the whole pixel sees:
    purity, sky, mean flow, its spread, what is hidden. All else is told of the pixel's center."""

    backend: Backend = "auto"
    """Mitsuba variant family; auto takes llvm, else scalar. What cuda gives has not been compared
    with llvm on a real device yet."""

    samples_per_pass: Annotated[int, Field(ge=1, le=2**28)] | None = None
    """Most light paths of a frame traced at once: Ctrl-C waits for them. By default one or two
    seconds' work, 2¹⁹ in scalar, 2²⁰ in llvm and 2²⁴ in cuda mode. How a frame is divided is part
    of what seeds its noise."""

    @property
    def standing_error(self) -> float:
        """Error of baked light to aim at."""
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
    """Mitsuba's 32-bit seed of one frame, or of a numbered part of it: a pass, an instant of one.

    Unrelated between frames, their parts and sequence seeds.
    """
    return int(np.random.SeedSequence(seed, spawn_key=(frame, *parts)).generate_state(1)[0])


def bake_seed(seed: int) -> int:
    """Mitsuba's 32-bit seed of a sequence's baked light, unrelated to those of its frames."""
    return frame_seed(seed, 0, 0, 0, 0)
