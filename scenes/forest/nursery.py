"""Grown plants and painted textures, kept for all forests that have them in common.

They depend on the forest's seed, their kind and number alone, not on where they stand: sequences of
a dataset share them, and so do the processes that render these.
"""

from collections.abc import Iterator, Sequence
from dataclasses import fields
from functools import cache, lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from megalopta.assets_gen import TEXTURES, Surface, generator
from megalopta.core.array_store import ArrayStore
from megalopta.core.folders import cache_folder
from megalopta.core.freshness import code_digest, digest
from megalopta.scenes.forest.plants import Organs, Plant, Woody
from megalopta.scenes.forest.stand import LodLevel

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

    What is woody bears `fullness` times its species' leaves, and furrows `bark_relief` times as
    deep as its species'.
    """
    levels = (lod.name for lod in lods)
    store = store_of("plant", seed, plant.name, number, fullness, str(bark_relief), *levels)
    if kept := store.read():
        return _organs(kept, len(lods))
    rng = generator(seed, "plant", plant.name, number)
    individual = plant.individual(number)
    if bark_relief and isinstance(individual, Woody) and (relief := individual.shape.relief):
        individual = individual.carved(bark_relief, texture(seed, relief.pattern))
    found = list(individual.grow(lods, rng, fullness))
    store.write(dict(_arrays(found)))
    return found


@lru_cache(maxsize=2 * len(TEXTURES))
def texture(seed: int, pattern: str) -> NDArray[np.float32]:
    """Return weights that all forests of a seed share; a megabyte or four each."""
    store = store_of("texture", seed, pattern)
    kept = store.read()
    weight = kept["weight"] if kept else TEXTURES[pattern](generator(seed, "texture", pattern))
    if kept is None:
        store.write({"weight": weight})
    weight.flags.writeable = False
    return weight


def store_of(*what: str | int) -> ArrayStore:
    """Where what depends on some values, and on all that makes forests, is kept."""
    return ArrayStore(cache_folder() / "plants", digest(_model(), repr(what)), _MOST_BYTES)


@cache
def _model() -> str:
    """Hash of all that makes plants, textures and floors."""
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
