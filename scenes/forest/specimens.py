"""Shapes and surfaces of a forest's plants, cached for all that share them.

They depend only on the forest's seed, their kind and number, not on their positions: sequences of a
dataset and their rendering processes share them.

A few individuals of every kind grow, each with several levels of detail. An asset is one of these,
such as "young spruce 3 far".
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import fields, replace
from functools import cache, lru_cache
from itertools import groupby, product
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from megalopta.assets_gen import TEXTURES, Surface, generator
from megalopta.assets_gen.plants.detail import some_leaves
from megalopta.core.array_store import ArrayStore
from megalopta.core.folders import cache_folder
from megalopta.core.freshness import code_digest, digest
from megalopta.scenes.forest.flora import (
    COVERS,
    FLORA,
    HEIGHTS,
    LODS,
    Flora,
    LodLevel,
    Organs,
    Plant,
    Woody,
)
from megalopta.scenes.material import Material, Texture
from megalopta.scenes.scene import Asset

_MOST_BYTES = 2 * 10**9
_FIELDS = tuple(each.name for each in fields(Surface))


def grown(
    seed: int,
    plant: Plant,
    number: int,
    lods: Sequence[LodLevel],
    fullness: int = 1,
    bark_relief: float = 0.0,
) -> list[Organs]:
    """Return the organs of an individual at each of some levels of detail.

    Woody plants have `fullness` times their species' leaves, and furrows `bark_relief` times as
    deep as their species'.
    """
    levels = (lod.name for lod in lods)
    own = [plant.variety] if isinstance(plant, Woody) and plant.variety else []
    store = store_of("plant", seed, plant.name, number, fullness, str(bark_relief), *levels, *own)
    if kept := store.read():
        return _organs(kept, len(lods))
    rng = generator(seed, "plant", plant.name, number)
    individual = plant.individual(number)
    if isinstance(individual, Woody):
        individual = replace(individual, fullness=fullness)
        if bark_relief and (relief := individual.shape.relief):
            individual = individual.carved(bark_relief, texture(seed, relief.pattern))
    found = list(individual.grow(lods, rng))
    store.write(dict(_arrays(found)))
    return found


@lru_cache(maxsize=2 * len(TEXTURES))
def texture(seed: int, pattern: str) -> NDArray[np.float32]:
    """Return texture weights that all forests of a seed share; one to four megabytes each."""
    store = store_of("texture", seed, pattern)
    kept = store.read()
    weight = kept["weight"] if kept else TEXTURES[pattern](generator(seed, "texture", pattern))
    if kept is None:
        store.write({"weight": weight})
    weight.flags.writeable = False
    return weight


def store_of(*what: str | int) -> ArrayStore:
    """Return the cache for arrays that depend on some values and on the code that makes forests."""
    return ArrayStore(cache_folder() / "plants", digest(_model(), repr(what)), _MOST_BYTES)


@cache
def _model() -> str:
    """Hash of the code that makes plants, textures and floors."""
    table = Path(__file__).with_name("flora.yaml").read_text("utf-8")
    return digest(table, code_digest("megalopta.assets_gen", "megalopta.scenes.forest"))


def _arrays(levels: Sequence[Organs]) -> Iterator[tuple[str, NDArray[np.generic]]]:
    for level, organs in enumerate(levels):
        for organ, surface in organs.items():
            for field in _FIELDS:
                if (values := getattr(surface, field)) is not None:
                    yield f"{level}/{organ}/{field}", values


def _organs(arrays: dict[str, NDArray[np.generic]], levels: int) -> list[Organs]:
    found: list[dict[str, dict[str, NDArray[np.generic]]]] = [{} for _ in range(levels)]
    for name, values in arrays.items():
        level, organ, field = name.split("/")
        found[int(level)].setdefault(organ, {})[field] = values
    return [
        {organ: Surface(**each) for organ, each in organs.items()}  # type: ignore[arg-type]
        for organs in found
    ]


INDIVIDUALS = 5
"""Distinct individuals of each kind; turned, leaning and scaled, they do not look repeated. Trees
have one for each class of height."""


class Specimen(NamedTuple):
    """Individual at a level of detail."""

    plant: Plant
    number: int
    lod: LodLevel

    @property
    def name(self) -> str:
        """Name of its asset."""
        return f"{self.plant.name} {self.number} {self.lod.name}"


@lru_cache(maxsize=8)
def specimens_of(flora: Flora) -> Mapping[str, Specimen]:
    """Every specimen of a flora by its name."""
    of = product(flora.plants.values(), range(len(HEIGHTS)), LODS)
    return MappingProxyType({each.name: each for each in map(Specimen._make, of)})


def grow_specimens(
    seed: int,
    names: Iterable[str],
    fullness: int = 1,
    bark_relief: float = 0.0,
    flora: Flora = FLORA,
) -> dict[str, Organs]:
    """Grow the named specimens; every individual grows once for all its levels of detail.

    Trees and bushes have `fullness` times their leaves, and furrows `bark_relief` times as deep as
    their species'.
    """
    ordered = sorted(
        map(specimens_of(flora).__getitem__, names),
        key=lambda each: (each.plant.name, each.number, LODS.index(each.lod)),
    )
    found: dict[str, Organs] = {}
    for (kind, number), group in groupby(ordered, lambda each: (each.plant.name, each.number)):
        individual, plant = list(group), flora.plants[kind]
        full = fullness if isinstance(plant, Woody) else 1
        lods = [each.lod for each in individual]
        levels = grown(seed, plant, number, lods, full, bark_relief)
        found.update(zip((each.name for each in individual), levels, strict=True))
    return found


def plant_assets(
    seed: int,
    specimens: Mapping[str, Organs],
    leaf_share: float = 1.0,
    flora: Flora = FLORA,
) -> dict[str, Asset]:
    """Return the assets of grown specimens; trees and bushes keep a share of their leaves."""
    assets = {}
    for name, organs in specimens.items():
        plant = specimens_of(flora)[name].plant
        if isinstance(plant, Woody) and leaf_share < 1:
            rng = generator(seed, "leaf share", name)
            organs = {**organs, "leaf": some_leaves(organs["leaf"], leaf_share, rng)}
        assets[name] = Asset({plant.part(organ): each.to_mesh() for organ, each in organs.items()})
    return assets


def materials(
    seed: int, assets: Mapping[str, Asset], has_furrows: bool = False, flora: Flora = FLORA
) -> dict[str, Material]:
    """Return the materials of all parts of the assets, bark with furrows or without."""
    result, coats, carved = {}, {f"{cover} ground": coat for cover, coat in COVERS.items()}, {}
    for plant in flora.plants.values():
        coats |= {plant.part(organ): coat for organ, coat in plant.coats.items()}
        if isinstance(plant, Woody) and plant.carved_bark:
            carved[plant.part("bark")] = plant.carved_bark
    for part in sorted({part for asset in assets.values() for part in asset.parts}):
        coat = (has_furrows and carved.get(part)) or coats[part]
        (first, second), (through, more) = coat.spectra, coat.transmittances or (None, None)
        mixed = Texture(texture(seed, coat.texture), second, more)
        result[part] = Material(first, mixed, transmittance=through)
    return result
