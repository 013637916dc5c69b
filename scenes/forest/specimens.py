"""The shapes and surfaces of the plants of one forest.

Of every kind a few individuals grow, each drawn at several levels of detail. An asset is one of
these, such as "young spruce 3 far".
"""

from collections.abc import Iterable, Mapping
from itertools import groupby, product
from types import MappingProxyType
from typing import NamedTuple

from megalopta.scenes.forest.nursery import grown, texture
from megalopta.scenes.forest.plants import Plant
from megalopta.scenes.forest.stand import LODS, LodLevel
from megalopta.scenes.forest.undergrowth import COVERS, PLANTS
from megalopta.scenes.world import Asset, Material, Texture

INDIVIDUALS = 5
"""Distinct grown plants of each kind; turned, leaning and scaled, they do not look repeated."""


class Specimen(NamedTuple):
    """An individual at a level of detail."""

    plant: Plant
    number: int
    lod: LodLevel

    @property
    def name(self) -> str:
        """That of its asset."""
        return f"{self.plant.name} {self.number} {self.lod.name}"


_SPECIMENS = MappingProxyType(
    {
        each.name: each
        for each in map(Specimen._make, product(PLANTS.values(), range(INDIVIDUALS), LODS))
    }
)
_COATS = MappingProxyType(
    {plant.part(organ): coat for plant in PLANTS.values() for organ, coat in plant.coats.items()}
    | {f"{cover} ground": coat for cover, coat in COVERS.items()}
)


def plant_assets(seed: int, names: Iterable[str]) -> dict[str, Asset]:
    """Grow the named specimens; every individual grows once, whatever its levels of detail."""
    ordered = sorted(
        map(_SPECIMENS.__getitem__, names),
        key=lambda each: (each.plant.name, each.number, LODS.index(each.lod)),
    )
    assets = {}
    for (kind, number), group in groupby(ordered, lambda each: (each.plant.name, each.number)):
        individual = list(group)
        levels = grown(seed, PLANTS[kind], number, [each.lod for each in individual])
        for specimen, organs in zip(individual, levels, strict=True):
            parts = {PLANTS[kind].part(organ): each.to_mesh() for organ, each in organs.items()}
            assets[specimen.name] = Asset(parts)
    return assets


def materials(seed: int, assets: Mapping[str, Asset]) -> dict[str, Material]:
    """Return the materials of all parts of the assets."""
    result = {}
    for part in sorted({part for asset in assets.values() for part in asset.parts}):
        coat = _COATS[part]
        (first, second), (through, more) = coat.spectra, coat.transmittances or (None, None)
        mixed = Texture(texture(seed, coat.texture), second, more)
        result[part] = Material(first, mixed, transmittance=through)
    return result
