"""Photographed panorama (HDRI) at infinity around the camera.

Points at infinity move by rotation alone. A camera that also moves along a path sees the same as
one that turns in place, and the ground truth agrees.

Its upper half gives a horizontal plane the light's illuminance. Spectra are those of three
primaries of the light's color (`scenes/spectra/color.py`).
"""

from pathlib import PurePath
from typing import ClassVar, Literal

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
    is_lit_from_outside: ClassVar[bool] = False
    has_surfaces: ClassVar[bool] = False

    def build(self, light: Light, camera: Camera, trajectory: Path) -> Scene:
        """Return a scene with only the panorama, with the light's brightness and white."""
        level = light.resolved()
        spectra = primaries(level.spectrum())
        environment = Environment(self.file, self.turn_deg, spectra, level.illuminance_lux)
        return Scene({}, {}, (), environment=environment)

    def describe(self) -> str:
        """Sentence for the report."""
        return f"A photographed panorama, {PurePath(self.file.path).name}."
