"""The shapes and surfaces of everything that grows or lies in a forest, by name.

An asset is named after its kind, individual and level of detail: "young spruce 3 far". The same
individual has one name per level; all are coarsened from one plant.
"""

from collections.abc import Callable, Iterable, Mapping
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from megalopta.assets_gen import TEXTURES, Surface, generator
from megalopta.assets_gen.ground import grow_rock
from megalopta.assets_gen.plants import (
    WOODY,
    coarsened,
    grow_bilberry,
    grow_fern,
    grow_flowers,
    grow_grass,
    grow_herbs,
    grow_log,
    grow_plant,
    merged_leaves,
    strew_litter,
)
from megalopta.scenes.forest.stand import LEVELS, Level
from megalopta.scenes.spectra import BARK, GROUND, LEAF, LOG, PETAL, ROCK, WOOD, Spectrum
from megalopta.scenes.world import Asset, Material, Texture

LEAFY: Mapping[str, Callable[[np.random.Generator], Surface]] = MappingProxyType(
    {"fern": grow_fern, "herb": grow_herbs, "bilberry": grow_bilberry, "litter": strew_litter}
)
"""Kinds that are leaves alone."""
SIDES = MappingProxyType({"near": 28, "middle": 14, "far": 10, "horizon": 8})
"""Sides of rocks and logs at each level of detail."""

Parts = dict[str, Surface]


def plant_assets(seed: int, names: Iterable[str]) -> dict[str, Asset]:
    """Grow what the names tell; every individual grows once, whatever its levels of detail."""
    wanted: dict[tuple[str, int], set[str]] = {}
    for name in names:
        kind, individual, level_name = name.rsplit(" ", 2)
        wanted.setdefault((kind, int(individual)), set()).add(level_name)
    assets = {}
    for (kind, number), level_names in sorted(wanted.items()):
        levels = [level for level in LEVELS if level.name in level_names]
        for level, parts in _grow(kind, levels, generator(seed, "plant", kind, number)):
            meshes = {part: surface.to_mesh() for part, surface in parts.items()}
            assets[f"{kind} {number} {level.name}"] = Asset(meshes)
    return assets


def _grow(
    kind: str, levels: list[Level], rng: np.random.Generator
) -> Iterable[tuple[Level, Parts]]:
    """Return the parts of one individual at each of the levels."""
    if kind in WOODY:
        plant = grow_plant(WOODY[kind], rng)
        for level in levels:
            if level.detail.merged == 1:
                wood, leaves = plant.wood, plant.leaves
            else:
                wood, leaves = coarsened(plant, level.detail, rng)
            yield level, {f"{kind} bark": wood, f"{kind} leaf": leaves}
    else:
        key = int(rng.integers(2**63))
        for level in levels:
            yield level, _small(kind, level, np.random.default_rng(key))


def _small(kind: str, level: Level, rng: np.random.Generator) -> Parts:
    merged = min(level.detail.merged, 8)
    if kind == "grass":
        return {"grass leaf": grow_grass(rng, merged)}
    if kind == "rock":
        return {"rock": grow_rock(rng, SIDES[level.name])}
    if kind == "log":
        bark, ends = grow_log(rng, SIDES[level.name] // 2)
        return {"log bark": bark, "log wood": ends}
    if kind == "flower":
        leaves, petals = grow_flowers(rng)
        parts = {"flower leaf": leaves, "flower petal": petals}
    else:
        parts = {f"{kind} leaf": LEAFY[kind](rng)}
    if merged == 1:
        return parts
    return {name: merged_leaves(part, merged, rng) for name, part in parts.items()}


def materials(seed: int, assets: Mapping[str, Asset]) -> dict[str, Material]:
    """Return the materials of all parts of the assets."""
    parts = sorted({part for asset in assets.values() for part in asset.parts})
    textures: dict[str, NDArray[np.float32]] = {}
    result = {}
    for part in parts:
        spectra, pattern = _surface_of(part)
        if pattern not in textures:
            textures[pattern] = TEXTURES[pattern](generator(seed, "texture", pattern))
        result[part] = Material(spectra[0], Texture(textures[pattern], spectra[1]))
    return result


_SINGLE: Mapping[str, tuple[tuple[Spectrum, Spectrum], str]] = MappingProxyType(
    {
        "litter ground": (GROUND["litter"], "litter"),
        "meadow ground": (GROUND["meadow"], "turf"),
        "moss ground": (GROUND["moss"], "turf"),
        "rock": (ROCK, "stone"),
        "log bark": (LOG, "mossy"),
        "log wood": (WOOD, "smooth"),
        "flower petal": (PETAL, "leaf"),
    }
)


def _surface_of(part: str) -> tuple[tuple[Spectrum, Spectrum], str]:
    """Return a part's two reflectances and the name of the texture between them."""
    if part in _SINGLE:
        return _SINGLE[part]
    kind, organ = part.rsplit(" ", 1)
    if organ == "bark":
        return BARK[kind], WOODY[kind].bark
    return LEAF[kind], WOODY[kind].foliage.blade if kind in WOODY else "leaf"
