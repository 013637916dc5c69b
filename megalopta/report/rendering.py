"""What the report says about the noise of the rendering itself.

A path tracer gathers random samples, so the "noise-free" frames are themselves a little noisy. The
render stage measures how much: `monte_carlo` in the scene record.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from megalopta.pages import number, percent

_CAUTION = 0.1


@dataclass(frozen=True)
class RenderNoise:
    """Noise of the rendered light."""

    relative: str
    """σ/mean of a pixel, median over pixels"""
    rms: str
    """RMS of the noise over the mean of the light"""
    photons: str
    """Photons per pixel that are as noisy"""
    caution: bool
    """Whether there is so much of it that the reader should be warned."""


def render_noise(record: Mapping[str, Any]) -> RenderNoise | None:
    """Noise from a scene record; None where it was not measured, or where there is none."""
    measured = record.get("monte_carlo")
    if not measured or not measured["median_relative"]:
        return None
    relative = measured["median_relative"]
    return RenderNoise(
        percent(relative),
        percent(measured["rms_over_mean"]),
        number(measured["equivalent_photons_per_pixel"]),
        relative > _CAUTION,
    )
