"""Gray methods with the settings that were tuned to each light (`tuning`)."""

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
from pydantic import SerializeAsAny

from megalopta.config.yaml_model import mapping, yaml_text
from megalopta.core import strict_yaml
from megalopta.core.arrays import Floats
from megalopta.core.errors import shell_command
from megalopta.flow.detectors.base import Frames
from megalopta.flow.detectors.blocks import BlockDetector, BlockGrid
from megalopta.flow.detectors.gray_detector import GrayDetector
from megalopta.flow.detectors.registry import method

PARAMETERS: Mapping[str, tuple[str, tuple[Any, ...]]] = MappingProxyType(
    {
        "TV-L1": ("attachment", (3.0, 5.0, 8.0, 12.0, 18.0)),
        "DIS": ("preset", ("ultrafast", "fast", "medium")),
        "FB": ("window_blocks", (0.25, 0.35, 0.5, 0.75, 1.0, 1.5)),
        "LK": ("window_blocks", (0.75, 1.0, 1.5, 2.0, 3.0, 4.0)),
        "ILK": ("window_blocks", (0.25, 0.35, 0.5, 0.75, 1.0, 1.5)),
    }
)
"""Main parameter of each method, and its values"""
Settings = Mapping[str, Any]
_OWN = "stretch", "blur_px"
"""Settings of methods without a main parameter"""
_TABLE = Path(__file__).with_name("tuned.yaml")
ERROR = "error_px"
"""Name of the error on the tuning scenes, next to the settings"""


class TunedMethod(BlockDetector, frozen=True):
    """A gray method with the settings chosen for the light nearest to that of its frames."""

    takes_counts: ClassVar[bool] = True

    method: SerializeAsAny[GrayDetector]
    settings: tuple[tuple[float, tuple[tuple[str, Any], ...]], ...]
    """Photons per pixel, and names and values of the settings there"""

    def grid(self, shape: tuple[int, int]) -> BlockGrid:
        """Return the blocks of the method in a frame (H, W)."""
        return self._inner(1.0).grid(shape)

    def dense(self, *frames: Frames) -> Floats:
        """Return the flow as the method does, with the settings for the light."""
        return self._inner(float(self.checked(frames).mean())).dense(*frames)

    def velocities(self, grid: BlockGrid, window: list[Frames]) -> Floats:
        """Return the velocities of the method, with the settings for the light."""
        return self._inner(float(np.mean(window))).velocities(grid, window)

    def _inner(self, photons: float) -> GrayDetector:
        distance = [abs(np.log(max(photons, 1e-9) / each)) for each, _ in self.settings]
        chosen = dict(self.settings[int(np.argmin(distance))][1])
        blocks = {"block_px": self.block_px, "fewest_blocks": self.fewest_blocks}
        return self.method.model_copy(update={**chosen, **blocks})


def tuned(name: str) -> TunedMethod:
    """Return a gray method with its tuned settings, as `NAME tuned`.

    Those of `PARAMETERS` come with the program. Of others they are in `tuned.yaml`, next to an ONNX
    file or in the working folder. Raises ValueError if there is no such method, or no settings.
    """
    gray = gray_method(name)
    rows = tuned_settings().get(gray.name) or _own(Path(name), gray)
    kept = tuple(
        (float(photons), tuple((key, value) for key, value in row.items() if key != ERROR))
        for photons, row in rows.items()
    )
    label = f"{gray.label}, tuned to the light"
    return TunedMethod(name=f"{gray.name} tuned", label=label, method=gray, settings=kept)


def gray_method(name: str) -> GrayDetector:
    """Return a method that takes gray levels. Raises ValueError for any other."""
    found = method(name)
    if not isinstance(found, GrayDetector):
        raise ValueError(f"{found.name} takes no gray levels: give DIS, an ONNX file or the like")
    return found


@cache
def tuned_settings() -> Mapping[str, Mapping[float, Settings]]:
    """Return the settings of `tuned.yaml` by method and photons per pixel, with their errors."""
    return MappingProxyType(strict_yaml.load(_TABLE.read_text("utf-8")))


def _own(path: Path, method: GrayDetector) -> Mapping[Any, Settings]:
    """Return the settings of a method in `tuned.yaml` next to its file; raise ValueError."""
    table = path.with_name(_TABLE.name)
    remedy = f"run: {shell_command('benchmark', 'tune', path, '--out', table)}"
    if not table.exists():
        raise ValueError(f"{table}: no such file of settings; {remedy}")
    rows = mapping(yaml_text(table, "file of settings"), str(table))
    try:
        found = {
            float(photons): {key: row[key] for key in _OWN}
            for photons, row in rows[method.name].items()
        }
        for row in found.values():
            type(method).model_validate(dict(method) | row)
    except (AttributeError, KeyError, TypeError, ValueError):
        raise ValueError(f"{table} has no settings for {method.name}; {remedy}") from None
    return found
