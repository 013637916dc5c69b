"""What grows and lies on the forest's floor, and what covers the ground between."""

from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np

from megalopta.assets_gen import Surface
from megalopta.assets_gen.ground import grow_rock
from megalopta.assets_gen.plants import (
    grow_bilberry,
    grow_fern,
    grow_flowers,
    grow_grass,
    grow_herbs,
    grow_log,
    merged_leaves,
    strew_litter,
)
from megalopta.scenes.forest.flora import BUSHES, TREES
from megalopta.scenes.forest.plants import Coat, Layer, Lying, Organs, Plant, Small, by_name
from megalopta.scenes.forest.stand import LodLevel
from megalopta.scenes.spectra import reflectance as spectra

Draw = Callable[[LodLevel, np.random.Generator], Organs]


def _merged(parts: Organs, lod: LodLevel, rng: np.random.Generator) -> Organs:
    if lod.merged_small == 1:
        return parts
    return {organ: merged_leaves(part, lod.merged_small, rng) for organ, part in parts.items()}


def _leaves(grow: Callable[[np.random.Generator], Surface]) -> Draw:
    return lambda lod, rng: _merged({"leaf": grow(rng)}, lod, rng)


def _grass(lod: LodLevel, rng: np.random.Generator) -> Organs:
    return {"leaf": grow_grass(rng, lod.merged_small)}


def _flower(lod: LodLevel, rng: np.random.Generator) -> Organs:
    leaves, petals = grow_flowers(rng)
    return _merged({"leaf": leaves, "petal": petals}, lod, rng)


def _log(lod: LodLevel, rng: np.random.Generator) -> Organs:
    bark, ends = grow_log(rng, lod.sides // 2)
    return {"bark": bark, "wood": ends}


def _rock(lod: LodLevel, rng: np.random.Generator) -> Organs:
    return {"": grow_rock(rng, lod.sides)}


def _leaf(dark: float, light: float) -> Coat:
    return Coat((spectra.LEAF_DARK.scaled(dark), spectra.LEAF_LIGHT.scaled(light)), "leaf")


SMALL: Mapping[str, Small] = by_name(
    Small("fern", Layer(0.55, 30, 0.9), {"leaf": _leaf(1.1, 1.1)}, _leaves(grow_fern)),
    Small("bilberry", Layer(0.3, 22, 0.6), {"leaf": _leaf(0.9, 1.0)}, _leaves(grow_bilberry)),
    Small(
        "grass",
        Layer(4.0, 30, 0.35),
        {"leaf": Coat((spectra.GRASS_DARK, spectra.GRASS_LIGHT), "leaf")},
        _grass,
    ),
    Small("herb", Layer(1.4, 18, 0.3), {"leaf": _leaf(1.0, 1.0)}, _leaves(grow_herbs)),
    Small(
        "flower",
        Layer(0.15, 18, 0.3),
        {
            "leaf": _leaf(1.0, 1.0),
            "petal": Coat((spectra.WHITE_PETAL.scaled(0.75), spectra.WHITE_PETAL), "leaf"),
        },
        _flower,
    ),
    Lying(
        "litter",
        Layer(1.0, 9, 0.0),
        {"leaf": Coat((spectra.SOIL.scaled(1.6), spectra.LITTER), "leaf")},
        _leaves(strew_litter),
    ),
    Lying(
        "log",
        Layer(0.008, 40, 2.2, (0.7, 1.1)),
        {
            "bark": Coat(
                (spectra.SPRUCE_BARK_DARK.scaled(1.5), spectra.LEAF_LIGHT.scaled(0.55)), "mossy"
            ),
            "wood": Coat((spectra.FRESH_WOOD, spectra.FRESH_WOOD.scaled(0.5)), "smooth"),
        },
        _log,
    ),
    Lying(
        "rock",
        Layer(0.012, 40, 1.6, (0.25, 1.6)),
        {"": Coat((spectra.STONE_DARK, spectra.STONE_LIGHT), "stone")},
        _rock,
    ),
)
"""Small plants and what lies, by name."""

LAYERS: Mapping[str, Layer] = MappingProxyType(
    {name: bush.layer for name, bush in BUSHES.items() if bush.layer}
    | {name: plant.layer for name, plant in SMALL.items()}
)
"""The undergrowth, by kind."""

PLANTS: Mapping[str, Plant] = MappingProxyType({**TREES, **BUSHES, **SMALL})
"""Everything that a forest holds."""

COVERS: Mapping[str, Coat] = MappingProxyType(
    {
        "litter": Coat((spectra.SOIL, spectra.LITTER), "litter"),
        "meadow": Coat((spectra.GRASS_DARK.scaled(0.8), spectra.GRASS_LIGHT.scaled(0.85)), "turf"),
        "moss": Coat((spectra.SOIL.scaled(0.5), spectra.LEAF_LIGHT.scaled(0.7)), "turf"),
    }
)
"""What covers the ground."""
