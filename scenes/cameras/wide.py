"""A pinhole with as many rows as columns."""

from typing import Literal

from megalopta.scenes.cameras.perspective import PerspectiveCamera


class WideCamera(PerspectiveCamera, frozen=True):
    """Pinhole camera of a wide field of view."""

    kind: Literal["wide"] = "wide"  # type: ignore[assignment]
    """Which camera this is."""

    fov_deg: float = 120.0
    """Horizontal field of view (degrees)."""
