"""Shapes and surfaces of a forest's plants, cached for all forests of a seed.

Leaf-area index is the one-sided area of the leaves of trees, bushes and climbers over the area of
the ground below them. Wood counts with half of its surface, like one of a leaf's two sides (Chen
and Black 1992, Plant, Cell and Environment 15:421). It applies in a ring around the camera's path.
Trees grow with all their leaves, or with twice or four times as many, and then lose some at random.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields, replace
from functools import cache, lru_cache
from itertools import groupby
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from platformdirs import user_cache_path
from scipy.spatial import cKDTree

from megalopta.assets_gen import TEXTURES, Surface, generator
from megalopta.assets_gen.plants.bark import Furrows
from megalopta.assets_gen.plants.detail import coarsened, some_leaves
from megalopta.assets_gen.plants.growth import grow_plant, moss_on
from megalopta.assets_gen.plants.species import aged
from megalopta.assets_gen.scatter import distance_to
from megalopta.core.array_store import ArrayStore
from megalopta.core.arrays import Floats, Mask
from megalopta.core.freshness import code_digest, digest
from megalopta.scenes.forest import flora
from megalopta.scenes.material import Material, Texture
from megalopta.scenes.scene import Asset, Placement

_FIELDS = tuple(field.name for field in fields(Surface))


def grown(
    seed: int,
    plant: flora.Woody | flora.Small,
    number: int,
    lods: Sequence[flora.LodLevel],
    fullness: int = 1,
    bark_relief: float = 0.0,
) -> list[flora.Organs]:
    """Return the organs of an individual at each of some levels of detail.

    Woody plants have `fullness` times their species' leaves, and furrows `bark_relief` times as
    deep as their species'.
    """
    levels = (lod.name for lod in lods)
    store = store_of("plant", seed, plant.name, number, fullness, str(bark_relief), *levels)
    if kept := store.read():
        fields_of: list[dict[str, dict[str, NDArray[np.generic]]]] = [{} for _ in lods]
        for name, values in kept.items():
            level, organ, field = name.split("/")
            fields_of[int(level)].setdefault(organ, {})[field] = values
        return [
            {organ: Surface(**arrays) for organ, arrays in organs.items()}  # type: ignore[arg-type]
            for organs in fields_of
        ]
    rng = generator(seed, "plant", plant.name, number)
    organs_of: list[flora.Organs] = []
    if isinstance(plant, flora.Woody):
        shape = plant.shape if plant.layer else aged(plant.shape, flora.HEIGHTS[number])
        furrows = None
        if bark_relief and (relief := shape.relief):
            furrows = Furrows(texture(seed, relief.pattern), bark_relief * relief.depth_m)
        tree = grow_plant(shape, rng, fullness, furrows)
        for lod in lods:
            is_full = lod.detail.leaf_m2 == 0
            wood, leaves = (tree.wood, tree.leaves) if is_full else coarsened(tree, lod.detail, rng)
            organs = {"bark": wood, "leaf": leaves}
            if lod.moss_m and not plant.layer:
                mossy = generator(seed, "moss", plant.name, number)
                organs["moss"] = moss_on(tree.tubes[0], lod.moss_m, mossy)
            organs_of.append(organs)
    else:
        key = int(rng.integers(2**63))
        organs_of = [plant.drawn(lod, np.random.default_rng(key)) for lod in lods]
    arrays = {
        f"{level}/{organ}/{field}": values
        for level, organs in enumerate(organs_of)
        for organ, surface in organs.items()
        for field in _FIELDS
        if (values := getattr(surface, field)) is not None
    }
    store.write(arrays)
    return organs_of


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


def store_of(*values: str | int) -> ArrayStore:
    """Return the cache for arrays that depend on some values and on the code that makes forests."""
    folder = user_cache_path("megalopta", appauthor=False) / "plants"
    return ArrayStore(folder, digest(_model(), repr(values)), 2 * 10**9)  # most bytes


@cache
def _model() -> str:
    """Hash of the code that makes plants, textures and floors."""
    table = Path(__file__).with_name("flora.yaml").read_text("utf-8")
    return digest(table, code_digest("megalopta.assets_gen", "megalopta.scenes.forest"))


INDIVIDUALS = 5
"""Distinct individuals of each kind; turned, leaning and scaled, they do not look repeated. Trees
have one for each class of height."""


def grow_specimens(
    seed: int, names: Iterable[str], fullness: int = 1, bark_relief: float = 0.0
) -> dict[str, flora.Organs]:
    """Grow the named specimens; every individual grows once for all its levels of detail.

    Trees and bushes have `fullness` times their leaves, and furrows `bark_relief` times as deep as
    their species'.
    """
    levels: dict[tuple[str, int], set[str]] = {}
    for name in names:
        kind, number, level = name.rsplit(" ", 2)
        levels.setdefault((kind, int(number)), set()).add(level)
    specimens: dict[str, flora.Organs] = {}
    for (kind, individual), drawn in sorted(levels.items()):
        plant, lods = flora.PLANTS[kind], [lod for lod in flora.LODS if lod.name in drawn]
        full = fullness if isinstance(plant, flora.Woody) else 1
        organs_of = grown(seed, plant, individual, lods, full, bark_relief)
        for lod, organs in zip(lods, organs_of, strict=True):
            specimens[f"{kind} {individual} {lod.name}"] = organs
    return specimens


def plant_assets(
    seed: int, specimens: Mapping[str, flora.Organs], leaf_share: float = 1.0
) -> dict[str, Asset]:
    """Return the assets of grown specimens; trees and bushes keep a share of their leaves."""
    assets = {}
    for name, organs in specimens.items():
        plant = flora.PLANTS[name.rsplit(" ", 2)[0]]
        if isinstance(plant, flora.Woody) and leaf_share < 1:
            rng = generator(seed, "leaf share", name)
            organs = {**organs, "leaf": some_leaves(organs["leaf"], leaf_share, rng)}
        assets[name] = Asset(
            {plant.part(organ): surface.to_mesh() for organ, surface in organs.items()}
        )
    return assets


def materials(
    seed: int, assets: Mapping[str, Asset], has_furrows: bool = False
) -> dict[str, Material]:
    """Return the materials of all parts of the assets, bark with furrows or without."""
    result, coats = {}, {f"{cover} ground": coat for cover, coat in flora.COVERS.items()}
    for plant in flora.PLANTS.values():
        coats |= {plant.part(organ): coat for organ, coat in plant.coats.items()}
        if has_furrows and isinstance(plant, flora.Woody) and (relief := plant.shape.relief):
            coats[plant.part("bark")] = replace(plant.coats["bark"], texture=relief.pattern)
    for part in sorted({part for asset in assets.values() for part in asset.parts}):
        coat = coats[part]
        (first, second), (through, more) = coat.spectra, coat.transmittances or (None, None)
        mixed = Texture(texture(seed, coat.texture), second, more)
        result[part] = Material(first, mixed, transmittance=through, gloss=coat.gloss)
    return result


RING_M = 20.0
"""Width of the ring around the path in which the leaf-area index is set and measured (m)."""
GRID_M = 0.2
"""Grid step for measuring ground area (m)."""


def _is_in(ring_m: tuple[float, float], distance: Floats) -> Mask:
    return np.asarray((distance >= ring_m[0]) & (distance < ring_m[1]))


def ground_area(path: cKDTree, ring_m: tuple[float, float]) -> float:
    """Return the area whose distance from a path is within a ring (m²)."""
    low, high = path.mins - ring_m[1], path.maxes + ring_m[1]
    steps = [np.arange(low[i], high[i], GRID_M) + GRID_M / 2 for i in range(2)]
    distance = distance_to(path, np.stack(np.meshgrid(*steps), axis=-1).reshape(-1, 2))
    return GRID_M**2 * int(_is_in(ring_m, distance).sum())


def in_leaf(
    leaf_area_index: float,
    natural: float,
    grow: Callable[[int], Mapping[str, flora.Organs]],
    placements: Sequence[Placement],
    path: cKDTree,
    ring_m: tuple[float, float],
) -> tuple[Mapping[str, flora.Organs], float]:
    """Return specimens and the share of leaves to keep for a leaf-area index in a ring of a path.

    `grow` returns all specimens for a factor on their species' leaves: 1, or 2 or 4 if that is too
    few. `natural` is about the index of 1. Raises ValueError if the stand cannot carry that many.
    """
    ground = ground_area(path, ring_m)
    ordered = sorted(placements, key=lambda placement: placement.asset)
    of_asset = {
        name: list(members) for name, members in groupby(ordered, lambda placement: placement.asset)
    }

    def grown_to(fullness: int) -> tuple[Mapping[str, flora.Organs], float]:
        specimens, area = grow(fullness), 0.0
        for name, members in of_asset.items():
            if name not in specimens or members[0].kind in flora.SMALL:
                continue
            to_world = np.stack([placement.to_world for placement in members])
            leaves = specimens[name]["leaf"]
            faces = leaves.faces[:: max(len(leaves.faces) // 200, 1)]  # a sample
            points = np.asarray(leaves.vertices[faces].mean(axis=1))
            places = points @ to_world[:, :2, :3].swapaxes(1, 2) + to_world[:, None, :2, 3]
            distance = distance_to(path, places.reshape(-1, 2)).reshape(places.shape[:2])
            inside = _is_in(ring_m, distance).mean(axis=1)
            area += leaves.area * float(inside @ np.cbrt(np.linalg.det(to_world[:, :3, :3])) ** 2)
        return specimens, leaf_area_index * ground / area

    share = np.inf
    for fullness in (1, 2, 4) if leaf_area_index <= 1.25 * natural else (2, 4):
        specimens, share = grown_to(fullness)
        if fullness == 2 and share < 0.55:  # the area of half the leaves is half, to a percent
            fewer, its_share = grown_to(1)
            specimens, share = (fewer, its_share) if its_share <= 1 else (specimens, share)
        if share <= 1:
            return specimens, share
    reached = leaf_area_index / share
    raise ValueError(
        f"leaf_area_index: {leaf_area_index:g} is more than the {reached:.2g} that these trees can "
        "carry; raise density_per_ha or lower leaf_area_index"
    )
