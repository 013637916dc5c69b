"""A photographed panorama at infinity around the camera: an HDRI.

Points at infinity move by rotation alone, so a camera that also moves along a path sees the same as
one that turns in place, and so says the truth.

The picture's values are relative: they are scaled until the upper half gives the light's
illuminance to a horizontal plane. The light's direction is the picture's own; `disc_fraction` and
the disc's angles have no effect. Three colors say little about a spectrum. Here each pixel has the
light's spectrum times a smooth function of wavelength: red, green and blue take one another's place
in logistic steps, so that white has the light's spectrum, nothing is negative, and no light is lost
or gained. The steps lie where each color has the share in the luminance that sRGB gives it. Beyond
the visible red goes on to the infrared and blue to the ultraviolet, of which the picture knows
nothing.
"""

from pathlib import PurePath
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import field_validator
from scipy.optimize import brentq
from scipy.special import expit

from megalopta.scenes.base import SceneDescription
from megalopta.scenes.cameras import Camera
from megalopta.scenes.lighting import Light
from megalopta.scenes.spectra import Spectrum, luminous
from megalopta.scenes.trajectories import Path
from megalopta.scenes.world import Environment, HashedFile, Scene

LUMINANCE_SHARES = (0.2126, 0.7152, 0.0722)
"""Of red, green and blue in linear sRGB (IEC 61966-2-1)."""

_STEP_WIDTH_NM = 12.0
_GRID_NM = np.concatenate([np.arange(300.0, 800.0, 5.0), np.arange(800.0, 2001.0, 10.0)])


class Panorama(SceneDescription, frozen=True):
    """An equirectangular picture, 2:1, as environment."""

    kind: Literal["panorama"] = "panorama"
    """Which scene this is."""

    file: HashedFile
    """HDR, EXR (linear sRGB) or PNG (sRGB) file: the path, relative to the folder that the program
    runs in."""

    turn_deg: float = 0.0
    """Turns the picture counterclockwise seen from above (degrees); at 0 its center lies toward
    +x."""

    @field_validator("file")
    @classmethod
    def _is_named_as_a_picture(cls, file: HashedFile) -> HashedFile:
        if not file.path.lower().endswith((".hdr", ".exr", ".png")):
            raise ValueError(f"{file.path} is no HDR, EXR or PNG file; give one of these")
        return file

    has_bounces = False

    def build(self, light: Light, camera: Camera, trajectory: Path) -> Scene:
        """Nothing but the panorama, as bright as the light and white as it."""
        level = light.resolved()
        spectra = primaries(level.spectrum())
        environment = Environment(self.file, self.turn_deg, spectra, level.illuminance_lux)
        return Scene({}, {}, (), environment=environment)

    def describe(self) -> str:
        """A sentence for the report."""
        return f"A photographed panorama, {PurePath(self.file.path).name}."


def primaries(light: Spectrum) -> tuple[Spectrum, Spectrum, Spectrum]:
    """Spectra of red, green and blue that add up to that of white, with sRGB's luminances."""
    red_share, _, blue_share = LUMINANCE_SHARES
    values = light(_GRID_NM)
    total = luminous(_spectrum(values))

    def luminance_below(edge_nm: float) -> float:
        return luminous(_spectrum(values * expit((edge_nm - _GRID_NM) / _STEP_WIDTH_NM))) / total

    blue_edge = brentq(lambda edge: luminance_below(edge) - blue_share, 400.0, 700.0)
    red_edge = brentq(lambda edge: luminance_below(edge) - 1 + red_share, 400.0, 700.0)
    not_blue, red = (expit((_GRID_NM - edge) / _STEP_WIDTH_NM) for edge in (blue_edge, red_edge))
    green, blue = not_blue - red, 1 - not_blue
    return _spectrum(values * red), _spectrum(values * green), _spectrum(values * blue)


def _spectrum(values: NDArray[np.float64]) -> Spectrum:
    return Spectrum(tuple(_GRID_NM.tolist()), tuple(values.tolist()))
