"""What a forest is made of, as data: presets, undergrowth, levels of detail."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from megalopta.assets_gen.plants import Detail


@dataclass(frozen=True)
class Layer:
    """How one kind of undergrowth is strewn around the path.

    Attributes
    ----------
    per_m2 : float
        Plants per square meter where the layer is densest, unless the forest says otherwise.
    reach_m : float
        Farthest distance from the path (m); smaller plants cannot be made out farther away.
    clearance_m : float
        Least distance from the path (m).
    scale : (float, float)
        Smallest and largest size, as a factor on the grown plant.
    """

    per_m2: float
    reach_m: float
    clearance_m: float
    scale: tuple[float, float] = (0.6, 1.25)


LAYERS: Mapping[str, Layer] = MappingProxyType(
    {
        "hazel": Layer(0.04, 40, 3.0),
        "young beech": Layer(0.02, 40, 2.5),
        "young birch": Layer(0.01, 40, 2.5),
        "young spruce": Layer(0.02, 40, 3.5),
        "fern": Layer(0.55, 30, 0.9),
        "bilberry": Layer(0.3, 22, 0.6),
        "grass": Layer(4.0, 30, 0.35),
        "herb": Layer(1.4, 18, 0.3),
        "flower": Layer(0.15, 18, 0.3),
        "litter": Layer(1.0, 9, 0.0),
        "log": Layer(0.008, 40, 2.2, (0.7, 1.1)),
        "rock": Layer(0.012, 40, 1.6, (0.25, 1.6)),
    }
)
"""The undergrowth, by kind."""


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
class Level:
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
    """

    name: str
    beyond_m: float
    detail: Detail
    triangles: int


LEVELS = (
    Level("near", 0.0, Detail(merged=1, thinnest_m=0.0, chord_m=0.0), 7500),
    Level("middle", 33.0, Detail(merged=2, thinnest_m=0.008, chord_m=0.06), 2700),
    Level("far", 60.0, Detail(merged=4, thinnest_m=0.012, chord_m=0.1), 1500),
    Level("horizon", 96.0, Detail(merged=10, thinnest_m=0.025, chord_m=0.2), 600),
)
"""From fine to coarse."""

SMALL_DETAIL = 0.4
"""Factor on these distances for what has small leaves: the floor's plants, rocks and logs."""
