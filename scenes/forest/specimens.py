"""The shapes and surfaces of the plants of one forest.

Of every kind a few individuals grow, each drawn at several levels of detail. An asset is one of
these, such as "young spruce 3 far".
"""

from collections.abc import Iterable, Mapping
from itertools import groupby, product
from types import MappingProxyType
from typing import NamedTuple

from megalopta.assets_gen import generator
from megalopta.assets_gen.plants.detail import some_leaves
from megalopta.scenes.forest.nursery import grown, texture
from megalopta.scenes.forest.plants import Organs, Plant, Woody
from megalopta.scenes.forest.stand import HEIGHTS, LODS, LodLevel
from megalopta.scenes.forest.undergrowth import COVERS, PLANTS
from megalopta.scenes.material import Material, Texture
from megalopta.scenes.scene import Asset

INDIVIDUALS = 5
"""Distinct grown plants of each kind; turned, leaning and scaled, they do not look repeated. Trees
have as many as there are classes of height."""


class Specimen(NamedTuple):
    """An individual at a level of detail."""

    plant: Plant
    number: int
    lod: LodLevel

    @property
    def name(self) -> str:
        """That of its asset."""
        return f"{self.plant.name} {self.number} {self.lod.name}"


SPECIMENS = MappingProxyType(
    {
        each.name: each
        for each in map(Specimen._make, product(PLANTS.values(), range(len(HEIGHTS)), LODS))
    }
)
"""Every specimen by its name."""
_COATS = MappingProxyType(
    {plant.part(organ): coat for plant in PLANTS.values() for organ, coat in plant.coats.items()}
    | {f"{cover} ground": coat for cover, coat in COVERS.items()}
)
_CARVED = MappingProxyType(
    {
        plant.part("bark"): plant.carved_bark
        for plant in PLANTS.values()
        if isinstance(plant, Woody) and plant.carved_bark
    }
)


def grow_specimens(
    seed: int, names: Iterable[str], fullness: int = 1, bark_relief: float = 0.0
) -> dict[str, Organs]:
    """Grow the named specimens; every individual grows once, whatever its levels of detail.

    Trees and bushes bear `fullness` times their leaves, and furrows `bark_relief` times as deep as
    their species'.
    """
    ordered = sorted(
        map(SPECIMENS.__getitem__, names),
        key=lambda each: (each.plant.name, each.number, LODS.index(each.lod)),
    )
    found: dict[str, Organs] = {}
    for (kind, number), group in groupby(ordered, lambda each: (each.plant.name, each.number)):
        individual, plant = list(group), PLANTS[kind]
        full = fullness if isinstance(plant, Woody) else 1
        lods = [each.lod for each in individual]
        levels = grown(seed, plant, number, lods, full, bark_relief)
        found.update(zip((each.name for each in individual), levels, strict=True))
    return found


def plant_assets(
    seed: int, specimens: Mapping[str, Organs], leaf_share: float = 1.0
) -> dict[str, Asset]:
    """Return the assets of grown specimens; trees and bushes keep a share of their leaves."""
    assets = {}
    for name, organs in specimens.items():
        plant = SPECIMENS[name].plant
        if isinstance(plant, Woody) and leaf_share < 1:
            rng = generator(seed, "leaf share", name)
            organs = {**organs, "leaf": some_leaves(organs["leaf"], leaf_share, rng)}
        assets[name] = Asset({plant.part(organ): each.to_mesh() for organ, each in organs.items()})
    return assets


def materials(
    seed: int, assets: Mapping[str, Asset], has_furrows: bool = False
) -> dict[str, Material]:
    """Return the materials of all parts of the assets, bark with furrows or without."""
    result = {}
    for part in sorted({part for asset in assets.values() for part in asset.parts}):
        coat = (has_furrows and _CARVED.get(part)) or _COATS[part]
        (first, second), (through, more) = coat.spectra, coat.transmittances or (None, None)
        mixed = Texture(texture(seed, coat.texture), second, more)
        result[part] = Material(first, mixed, transmittance=through)
    return result
