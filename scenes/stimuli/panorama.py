"""A photographed panorama at infinity around the camera: an HDRI.

Points at infinity move by rotation alone, so a camera that also moves along a path sees the same as
one that turns in place, and so says the truth.

The picture's values are relative: they are scaled until the upper half gives the light's
illuminance to a horizontal plane. The light's direction is the picture's own; `disc_fraction` and
the disc's angles have no effect. Spectra are those of three primaries of the light's own color
(`scenes/spectra/color.py`).
"""

from pathlib import PurePath
from typing import Literal

from megalopta.scenes.base import SceneDescription
from megalopta.scenes.cameras.base import Camera
from megalopta.scenes.hashed_file import PictureFile
from megalopta.scenes.lighting.light import Light
from megalopta.scenes.scene import Environment, Scene
from megalopta.scenes.spectra.color import primaries
from megalopta.scenes.trajectories.base import Path


class Panorama(SceneDescription, frozen=True):
    """An equirectangular picture, 2:1, as environment."""

    kind: Literal["panorama"] = "panorama"

    file: PictureFile
    """HDR, EXR (linear sRGB) or PNG (sRGB) file: the path, relative to the folder that the program
    runs in."""

    turn_deg: float = 0.0
    """Turns the picture counterclockwise seen from above (degrees); at 0 its center lies toward
    +x."""

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
