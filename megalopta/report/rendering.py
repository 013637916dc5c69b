"""What the report says about the noise of the rendering itself.

Light is gathered by random samples, so the "noise-free" frames are themselves a little noisy. The
render stage measures how much, on pixels without sky where there are any: `monte_carlo` in the
scene record.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from megalopta.plotting.text import number, percent

_CAUTION = 0.1
_LITTLE = 1e-3
"""Of the light of surfaces: not worth a sentence"""


@dataclass(frozen=True)
class RenderNoise:
    """Noise of the rendered light."""

    relative: str
    """σ/mean of a pixel, median over pixels"""
    rms: str
    """RMS of the noise over the mean of the light"""
    photons: str
    """Photons per pixel that are as noisy"""
    surfaces: str
    """What of it stands on surfaces, fakes their texture and is in the sky, and what light is left
    out; empty if not known"""
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
        _surfaces(measured.get("surface"), measured.get("sky"))
        + _left_out(record.get("light_left_out")),
        relative > _CAUTION,
    )


def _surfaces(surface: Mapping[str, Any] | None, sky: Mapping[str, Any] | None) -> str:
    if not surface:
        return ""
    text = (
        f"On pixels without sky the error is {percent(surface['rms'])} of their mean light (RMS; "
        f"{percent(surface['p95'])} or less of a pixel's in 95 % of the image) and makes "
        f"{percent(surface['gradient'])} of the squared differences between neighbors."
    )
    if surface["standing"]:
        text += (
            f" {percent(surface['standing'])} (RMS) is that of baked light: the same in all "
            "frames, it moves with the surfaces as texture does, and makes "
            f"{percent(surface['standing_gradient'])} of the squared differences."
        )
    if sky:
        text += f" In the sky it is {percent(sky['rms'])} of the sky's light."
    return text


def _left_out(shares: Sequence[float] | None) -> str:
    if not shares or max(shares) < _LITTLE:
        return ""
    return (
        f" Light that takes more hits than paths may have is left out: {percent(max(shares))} of "
        "that of surfaces in the band that loses most."
    )
