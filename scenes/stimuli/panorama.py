"""Photographed panorama (HDRI) at infinity around the camera.

Points at infinity move by rotation alone. A camera that also moves along a path sees the same as
one that turns in place, and the ground truth agrees.

The picture's values are relative: they are scaled so that the upper half gives a horizontal plane
the light's illuminance. The light's direction comes from the picture; `disc_fraction` and the
disc's angles have no effect. Spectra are those of three primaries in the light's own color
(`scenes/spectra/color.py`).
"""

from pathlib import PurePath
from typing import Literal

from megalopta.scenes.base import SceneDescription
from megalopta.scenes.cameras.base import Camera
from megalopta.scenes.hashed_file import PictureFile
from megalopta.scenes.light import Light
from megalopta.scenes.scene import Environment, Scene
from megalopta.scenes.spectra.color import primaries
from megalopta.scenes.trajectories.base import Path


class Panorama(SceneDescription, frozen=True):
    """Equirectangular picture, 2:1, as environment."""

    kind: Literal["panorama"] = "panorama"

    file: PictureFile
    """Path, in YAML below the file's folder, of an HDR, EXR (linear sRGB) or PNG (sRGB) file."""

    turn_deg: float = 0.0
    """Counterclockwise turn of the picture seen from above (degrees); at 0 its center is toward
    +x."""

    has_bounces = False

    def build(self, light: Light, camera: Camera, trajectory: Path) -> Scene:
        """Return a scene with only the panorama, with the light's brightness and white."""
        level = light.resolved()
        spectra = primaries(level.spectrum())
        environment = Environment(self.file, self.turn_deg, spectra, level.illuminance_lux)
        return Scene({}, {}, (), environment=environment)

    def describe(self) -> str:
        """Sentence for the report."""
        return f"A photographed panorama, {PurePath(self.file.path).name}."
