"""Base of every scene in a configuration; packages add theirs by entry points."""

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, ClassVar, Union

from pydantic import BaseModel, BeforeValidator, Field

from megalopta.core.record import Record
from megalopta.scenes.cameras.base import Camera
from megalopta.scenes.light import Light
from megalopta.scenes.scene import Scene
from megalopta.scenes.spectra.spectrum import Spectrum, flat
from megalopta.scenes.trajectories.base import Path


class SceneDescription(Record, frozen=True):
    """Frozen parameters of a scene; `kind: Literal["…"] = "…"` names it."""

    kind: str
    """Kind of scene."""
    is_self_luminous: ClassVar[bool] = False
    """True if its surfaces are the only light, of flat spectrum."""
    has_truth: ClassVar[bool] = True
    """True if it is rendered, so that its motion and depth are known."""
    has_surfaces: ClassVar[bool] = True
    """True if it has surfaces at known distances, which a lens may blur."""
    is_made_for_camera: ClassVar[bool] = True
    """True if its objects are where the camera goes, so that no path can be fitted to them."""
    max_depth: ClassVar[int] = 16
    """Longest path of light unless `render.max_depth` tells another."""

    def white(self, light: Light) -> Spectrum:
        """Spectrum of light on a white surface, W·m⁻²·nm⁻¹; flat, in any unit, if self-luminous."""
        return flat(1.0) if self.is_self_luminous else light.resolved().spectrum()

    @property
    def is_lit_from_outside(self) -> bool:
        """True if sky, sun or moon light its surfaces."""
        return self.has_truth and not self.is_self_luminous

    @property
    def is_hazy(self) -> bool:
        """True if droplets in the air scatter light."""
        return False

    @abstractmethod
    def build(self, light: Light, camera: Camera, trajectory: Path) -> Scene:
        """Return the scene around a camera on its path, lit from outside or by itself.

        A self-luminous scene is as bright as a sky of the light's illuminance.

        Raises ValueError with field, value and remedy, if camera and path do not fit the scene.
        """

    @abstractmethod
    def describe(self) -> str:
        """Sentence for the report, with its full stop."""


def any_of(models: Sequence[type[BaseModel]], default: str | None = None) -> Any:
    """Return the type of a field that holds any of some models, each with its own `kind`.

    The help of their `kind` lists them all, first the `default` of a mapping without one.
    """
    models = sorted(models, key=lambda model: kind_of(model) != default)
    kinds = ", ".join(map(kind_of, models))
    for model in models:
        model.model_fields["kind"].description = f"One of: {kinds}."
    union: Any = Union[tuple(models)]  # noqa: UP007
    told_apart: Any = Annotated[union, Field(discriminator="kind")]
    if not default:
        return told_apart

    def with_kind(values: Any) -> Any:
        has_kind = not isinstance(values, Mapping) or "kind" in values
        return values if has_kind else {"kind": default, **values}

    return Annotated[told_apart, BeforeValidator(with_kind)]


def kind_of(model: type[BaseModel]) -> str:
    """Kind that distinguishes a model from others."""
    return str(model.model_fields["kind"].default)
