"""The choice between all paths: every one in a module of this folder."""

from typing import TYPE_CHECKING

from megalopta.scenes.kinds import any_of, models_in
from megalopta.scenes.trajectories.base import Path

if TYPE_CHECKING:
    CameraPath = Path
else:
    CameraPath = any_of(models_in(__package__, Path), "steady")
    """Any path of the camera in a configuration; without `kind`, a steady one."""
