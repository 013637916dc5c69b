"""What any scene in a configuration has to tell.

A package adds a scene of its own by deriving from `SceneDescription` and naming the class in an
entry point of the group `megalopta.scenes`.
"""

from abc import abstractmethod
from collections.abc import Mapping
from typing import ClassVar

from megalopta.core.record import Record
from megalopta.scenes.cameras.base import Camera
from megalopta.scenes.lighting.light import Light
from megalopta.scenes.scene import Scene
from megalopta.scenes.spectra.spectrum import Spectrum, flat
from megalopta.scenes.trajectories.base import Path


class SceneDescription(Record, frozen=True):
    """What stands there, as frozen parameters; `kind: Literal["…"] = "…"` names it."""

    kind: str
    """Which scene this is."""

    is_self_luminous: ClassVar[bool] = False
    """Whether its surfaces are its only light, of flat spectrum."""

    has_truth: ClassVar[bool] = True
    """Whether it is rendered, so that its motion and depth are known."""

    has_bounces: ClassVar[bool] = True
    """Whether light goes from surface to surface, which takes most of the time of rendering."""

    def white(self, light: Light) -> Spectrum:
        """Spectrum of the light on what is white, W·m⁻²·nm⁻¹; flat, in any unit, where it glows."""
        return flat(1.0) if self.is_self_luminous else light.resolved().spectrum()

    @property
    def is_lit_from_outside(self) -> bool:
        """Whether sky, sun or moon light its surfaces."""
        return self.has_bounces and not self.is_self_luminous

    @property
    def is_moving(self) -> bool:
        """Whether anything in it moves."""
        return False

    @property
    def is_hazy(self) -> bool:
        """Whether droplets in the air scatter light."""
        return False

    @property
    def counts(self) -> Mapping[str, int]:
        """How many there are of what, for the report."""
        return {}

    def expected_triangles(self, path_m: float) -> float:
        """Return how many triangles there will be along a path of this length, roughly."""
        del path_m
        return 1.0

    @property
    def canopy_ring_m(self) -> tuple[float, float] | None:
        """Distances from the camera's path between which its canopy is measured; None without."""
        return None

    @abstractmethod
    def build(self, light: Light, camera: Camera, trajectory: Path) -> Scene:
        """The scene around a camera on its way, lit from outside or by itself.

        What is its own light is as bright as a sky of the light's illuminance.

        Raises
        ------
        ValueError
            With field, value and remedy, when camera and way do not fit the scene.
        """

    @abstractmethod
    def describe(self) -> str:
        """A sentence for the report, with its full stop."""
