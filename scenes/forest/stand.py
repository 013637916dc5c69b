"""What a forest is made of, as data: presets and levels of detail."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

from megalopta.assets_gen.plants.detail import Detail
from megalopta.core import strict_yaml

PRESETS: Mapping[str, Mapping[str, Any]] = MappingProxyType(
    strict_yaml.load(Path(__file__).with_name("presets.yaml").read_text("utf-8"))
)
"""Fields of a forest by name of the preset; what is not given has its default."""


@dataclass(frozen=True)
class LodLevel:
    """A level of detail."""

    name: str
    """Part of the names of the assets."""
    beyond_m: float
    """Distance from the path where it begins (m)."""
    detail: Detail
    wood_triangles: int
    """Of a tree's wood, roughly; bushes have a fourth."""
    sides: int
    """Of rocks; logs have half as many."""
    merged_small: int
    """Leaves of small plants that are drawn as one."""


LODS = (
    LodLevel("near", 0.0, Detail(0.0, 1, 0.0, 0.0), 4000, 28, 1),
    LodLevel("close", 8.0, Detail(0.009, 3, 0.006, 0.04), 1600, 20, 1),
    LodLevel("middle", 16.0, Detail(0.026, 5, 0.015, 0.07), 600, 14, 2),
    LodLevel("far", 32.0, Detail(0.07, 8, 0.03, 0.12), 250, 10, 4),
    LodLevel("horizon", 60.0, Detail(0.16, 16, 0.05, 0.25), 90, 8, 8),
)
"""From fine to coarse, for pixels of 0.0065 rad: a leaf is about a pixel wide."""

HEIGHTS = (0.35, 0.55, 0.75, 0.9, 1.0, 1.0, 1.12, 1.25)
"""What share of its species' height each individual of a tree has reached."""
