"""What a forest is made of, as data: presets and levels of detail."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

from megalopta import strict_yaml
from megalopta.assets_gen.plants import Detail

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
    triangles: int
    """Of a tree, roughly; bushes have a fourth."""
    sides: int
    """Of rocks; logs have half as many."""

    @property
    def merged_small(self) -> int:
        """Leaves of small plants that are drawn as one."""
        return min(self.detail.merged, 8)


LODS = (
    LodLevel("near", 0.0, Detail(merged=1, thinnest_m=0.0, chord_m=0.0), 7500, 28),
    LodLevel("middle", 33.0, Detail(merged=2, thinnest_m=0.008, chord_m=0.06), 2700, 14),
    LodLevel("far", 60.0, Detail(merged=4, thinnest_m=0.012, chord_m=0.1), 1500, 10),
    LodLevel("horizon", 96.0, Detail(merged=10, thinnest_m=0.025, chord_m=0.2), 600, 8),
)
"""From fine to coarse."""
