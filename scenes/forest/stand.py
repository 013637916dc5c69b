"""What a forest is made of, as data: presets and levels of detail."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from megalopta.assets_gen.plants import Detail

PRESETS: Mapping[str, Mapping[str, Any]] = MappingProxyType(
    {
        "open": {
            "trees": 140,
            "density_per_ha": 190.0,
            "mix": {"oak": 0.4, "birch": 0.3, "pine": 0.3},
            "ground": "meadow",
            "undergrowth_per_m2": {
                "grass": 7.0,
                "herb": 1.0,
                "flower": 0.3,
                "bilberry": 0.25,
                "fern": 0.12,
                "hazel": 0.008,
                "young birch": 0.02,
                "rock": 0.02,
                "log": 0.004,
            },
        },
        "dense": {
            "trees": 300,
            "density_per_ha": 1000.0,
            "mix": {"spruce": 0.5, "beech": 0.35, "pine": 0.15},
            "height_spread": 0.2,
            "ground": "moss",
            "undergrowth_per_m2": {
                "litter": 1.0,
                "fern": 0.25,
                "bilberry": 0.5,
                "herb": 0.4,
                "young spruce": 0.02,
                "young beech": 0.02,
                "log": 0.015,
                "rock": 0.015,
            },
        },
        "understorey": {
            "trees": 200,
            "density_per_ha": 420.0,
            "mix": {"beech": 0.4, "oak": 0.3, "aspen": 0.15, "birch": 0.15},
            "undergrowth_per_m2": {
                "hazel": 0.09,
                "young beech": 0.07,
                "young birch": 0.03,
                "young spruce": 0.03,
                "fern": 1.1,
                "grass": 2.0,
                "herb": 2.0,
                "flower": 0.3,
                "litter": 0.8,
                "log": 0.012,
                "rock": 0.008,
            },
        },
        "clearing": {
            "trees": 320,
            "density_per_ha": 520.0,
            "mix": {"beech": 0.25, "birch": 0.25, "oak": 0.15, "pine": 0.1, "spruce": 0.25},
            "clearance_m": 20.0,
            "ground": "meadow",
            "undergrowth_per_m2": {
                "grass": 8.0,
                "herb": 0.8,
                "flower": 1.0,
                "fern": 0.15,
                "bilberry": 0.2,
                "hazel": 0.015,
                "young birch": 0.012,
                "young spruce": 0.008,
                "log": 0.008,
                "rock": 0.012,
            },
        },
    }
)
"""Fields of a forest by name of the preset; what is not given has its default."""


@dataclass(frozen=True)
class LodLevel:
    """A level of detail.

    Attributes
    ----------
    name : str
        Part of the names of the assets.
    beyond_m : float
        Distance from the path where it begins (m).
    detail : Detail
        How plants are drawn.
    triangles : int
        Of a tree, roughly; bushes have a fourth.
    sides : int
        Of rocks; logs have half as many.
    """

    name: str
    beyond_m: float
    detail: Detail
    triangles: int
    sides: int

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
