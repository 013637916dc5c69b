"""A forest around a camera's path, as scene data.

Trees are planted as a Poisson-disk pattern at the stand's density; the ones nearest the path are
the stand. Behind them a belt of more trees, bushes and young spruces on rising ground closes the
horizon. A handful of individuals of each kind is grown at three levels of detail and placed again
and again with another turn, lean and size; plants far from the path have fewer, larger leaves on
the same leaf area. Small plants are left out where they could not be made out. The level depends on
the whole path, so nothing changes shape while the camera moves.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Annotated, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import BaseModel, Field, field_validator
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from megalopta.assets_gen.noise import plane_waves
from megalopta.assets_gen.plant import grow_plant
from megalopta.assets_gen.scatter import distance_to, poisson_disk
from megalopta.assets_gen.seeding import generator
from megalopta.assets_gen.species import BUSHES, TREES, Species, coarsened
from megalopta.assets_gen.surface import Surface
from megalopta.assets_gen.terrain import Terrain, ground_surface, make_terrain
from megalopta.assets_gen.textures import TEXTURES
from megalopta.assets_gen.undergrowth import grow_fern, grow_grass, grow_herbs, strew_litter
from megalopta.scenes.reflectance import BARK, GROUND, LEAF
from megalopta.scenes.scene import Asset, Material, Placement, Scene, Texture
from megalopta.scenes.spectrum import Spectrum
from megalopta.scenes.sway import Wind, swaying

FloatArray = NDArray[np.float64]

DETAIL_M = (12.0, 24.0)
"""Distances from the path (m) beyond which plants are drawn coarser."""
LEVELS, MERGED_LEAVES = ("near", "middle", "far"), (1.0, 3.0, 10.0)
"""Levels of detail, and how many leaves are merged into one at each of them."""
INDIVIDUALS = 5
"""Distinct grown plants of each species; turned, leaning and scaled, they do not look repeated."""
REGULARITY = 0.72
"""Least distance between trees in units of 1/√density; 0.83 is the most that fits."""
LEAST_DEPTH_M = 8.0
"""The stand reaches at least this far from the path on all sides."""
BELT_M = 16.0
"""Width of the belt of trees, bushes and young spruces around the stand (m)."""
THICKET_PER_M2 = 0.14
"""Bushes and young spruces of the belt (1/m²)."""
RIM_WIDTH_M, RIM_HEIGHT_M = 22.0, 7.0
"""Behind the stand the land rises over this width by this height (m)."""
HORIZON_M = 160.0
"""The ground reaches this far beyond the stand (m)."""
GROUND_STEP_M, GROUND_NEAR_M = 0.4, 10.0
"""Grid of the ground's mesh up to a distance from the path (m)."""


class Forest(
    BaseModel, frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True
):
    """A mixed stand of trees with undergrowth on gently rolling ground."""

    kind: Literal["forest"] = "forest"
    """Kind of scene."""
    seed: Annotated[int, Field(ge=0)] = 1
    """Which forest: every seed grows another one."""
    trees: Annotated[int, Field(gt=0)] = 150
    """Trees of the stand, without those of the belt around it (count)."""
    density_per_ha: Annotated[float, Field(gt=0)] = 550.0
    """Trees per hectare; with the number of trees it sets how far the stand reaches (1/ha)."""
    mix: dict[str, Annotated[float, Field(ge=0)]] = Field(
        default={"beech": 0.45, "birch": 0.25, "spruce": 0.3}
    )
    """Share of each species; shares are relative to their sum (1)."""
    height_spread: Annotated[float, Field(ge=0, le=0.3)] = 0.15
    """Standard deviation of tree height over the species' mean; cut at twice this (1)."""
    undergrowth: Annotated[float, Field(ge=0, le=4)] = 1.0
    """Density of bushes, ferns, grass and loose leaves: 0 none, 1 a usual forest floor (1)."""
    clearance_m: Annotated[float, Field(ge=0.3)] = 1.2
    """Least distance from the camera's path to the middle of a trunk (m)."""
    relief_m: Annotated[float, Field(ge=0, le=3)] = 0.6
    """Root mean square height of the rolling land beside the path (m)."""

    wind: Wind | None = None
    """Wind that makes trees and bushes sway; null is calm."""

    @field_validator("mix")
    @classmethod
    def _check_mix(cls, mix: dict[str, float]) -> dict[str, float]:
        unknown = sorted(mix.keys() - TREES.keys())
        if unknown:
            raise ValueError(f"mix: no species {unknown}; choose from {sorted(TREES)}")
        if sum(mix.values()) <= 0:
            raise ValueError(f"mix: the shares {mix} sum to 0; give one species a positive share")
        return mix


class Layer(BaseModel, frozen=True, extra="forbid"):
    """How one kind of small plant is strewn around the path."""

    per_m2: float
    """Plants per square meter where the layer is densest (1/m²)."""
    reach_m: float
    """Farthest distance from the path (m); smaller plants cannot be made out farther away."""
    clearance_m: float
    """Least distance from the path (m)."""


LAYERS: Mapping[str, Layer] = MappingProxyType(
    {
        "hazel": Layer(per_m2=0.045, reach_m=40, clearance_m=3.0),
        "young spruce": Layer(per_m2=0.02, reach_m=40, clearance_m=3.5),
        "fern": Layer(per_m2=0.55, reach_m=19, clearance_m=0.9),
        "grass": Layer(per_m2=4.0, reach_m=11, clearance_m=0.35),
        "herb": Layer(per_m2=1.4, reach_m=13, clearance_m=0.3),
        "litter": Layer(per_m2=1.0, reach_m=9, clearance_m=0.0),
    }
)
"""The undergrowth, by kind of plant."""
WOODY: Mapping[str, Species] = MappingProxyType({**TREES, **BUSHES})
"""Kinds that have bark."""
SMALL: Mapping[str, Callable[[np.random.Generator], Surface]] = MappingProxyType(
    {"fern": grow_fern, "grass": grow_grass, "herb": grow_herbs, "litter": strew_litter}
)
"""Kinds that are leaves alone."""


def build_forest(forest: Forest, path_xy: ArrayLike) -> Scene:
    """Return the forest around a path, without light.

    Parameters
    ----------
    forest : Forest
        What grows.
    path_xy : (n, 2) array_like
        Camera positions (m). Trunks keep `clearance_m` from the line through them, and the ground
        along it is level, at height 0, but for a few centimeters.

    Returns
    -------
    Scene
        `lighting` is None; placements are named by species, "ground" is the first.

    Raises
    ------
    ValueError
        If the path is not a finite (n, 2) array, or so long that the trees cannot surround it.
    """
    path = cKDTree(_dense_path(path_xy))
    trees, edge_m = _tree_positions(forest, path)
    rim_m = (edge_m, edge_m + RIM_WIDTH_M)
    rng = generator(forest.seed, "terrain")
    terrain = make_terrain(path, forest.relief_m, rim_m, RIM_HEIGHT_M, rng)
    planting = Planting(forest, path, terrain)
    placements = (
        Placement("ground", "ground", np.eye(4)),
        *_tree_placements(planting, trees),
        *_thicket_placements(planting, edge_m),
        *_layer_placements(planting, edge_m),
    )
    plants = sorted({placement.asset for placement in placements[1:]})
    assets = {name: _plant_asset(forest.seed, name) for name in plants}
    assets["ground"] = _ground_asset(terrain, path, edge_m)
    if forest.wind:
        placements = tuple(swaying(placements, assets, WOODY, forest.wind))
    return Scene(_materials(forest.seed, assets), assets, placements)


def _dense_path(path_xy: ArrayLike) -> FloatArray:
    """Return the path with points at most half a meter apart: they stand for the line."""
    path = np.asarray(path_xy, dtype=float)
    if path.ndim != 2 or path.shape[1] != 2 or not len(path) or not np.all(np.isfinite(path)):
        raise ValueError(f"path_xy: shape {path.shape}; give finite positions of shape (n, 2)")
    gaps = np.linalg.norm(np.diff(path, axis=0), axis=1)
    place = np.concatenate([[0.0], np.cumsum(gaps)])
    every = np.union1d(place, np.arange(0, place[-1], 0.5))
    return np.stack([np.interp(every, place, path[:, i]) for i in range(2)], axis=-1)


def _tree_positions(forest: Forest, path: cKDTree) -> tuple[FloatArray, float]:
    """Return where trees stand (n, 2), nearest to the path first, and the stand's reach (m).

    The first `forest.trees` are the stand; behind them it goes on for the width of the belt.
    """
    density_per_m2 = forest.density_per_ha / 1e4
    reach = np.sqrt(forest.trees / density_per_m2 / np.pi) + forest.clearance_m + BELT_M
    rng = generator(forest.seed, "planting")
    planted = _strewn(path, (forest.clearance_m, np.inf), reach, density_per_m2, REGULARITY, rng)
    distance = distance_to(path, planted)
    order = np.argsort(distance, kind="stable")
    edge_m = float(distance[order[forest.trees - 1]])
    if edge_m < LEAST_DEPTH_M:
        raise ValueError(
            f"trees: {forest.trees} trees at {forest.density_per_ha:g} per hectare reach only "
            f"{edge_m:.1f} m from the path, less than {LEAST_DEPTH_M:g} m; "
            "plant more trees, lower density_per_ha or shorten the path"
        )
    return planted[order[distance[order] < edge_m + BELT_M]], edge_m


def _strewn(
    path: cKDTree,
    ring_m: tuple[float, float],
    margin_m: float,
    per_m2: float,
    regularity: float,
    rng: np.random.Generator,
) -> FloatArray:
    """Return Poisson-disk points in a box around the path whose distance from it lies in a ring."""
    low, high = path.mins - margin_m, path.maxes + margin_m
    count = round(per_m2 * np.prod(high - low))
    points = poisson_disk(low, high, count, regularity / np.sqrt(per_m2), rng)
    distance = distance_to(path, points)
    return points[(distance >= ring_m[0]) & (distance <= ring_m[1])]


@dataclass(frozen=True)
class Planting:
    """What every planting step needs to know.

    Attributes
    ----------
    forest : Forest
        What grows.
    path : cKDTree
        Points of the camera's path (m).
    terrain : Terrain
        The ground.
    """

    forest: Forest
    path: cKDTree
    terrain: Terrain

    def place(
        self, kinds: Sequence[str], points: FloatArray, scales: FloatArray, rng: np.random.Generator
    ) -> Iterator[Placement]:
        """Put one plant per point (n, 2) on the ground, turned at random, leaning slightly."""
        levels = np.searchsorted(DETAIL_M, distance_to(self.path, points))
        heights = self.terrain.height(points)
        for kind, point, z, scale, level in zip(
            kinds, points, heights, scales, levels, strict=True
        ):
            to_world = np.eye(4)
            to_world[:3, :3] = scale * _random_turn(rng)
            to_world[:3, 3] = (*point, z)
            individual = rng.integers(INDIVIDUALS)
            asset = f"{kind} {individual}" + (f" {LEVELS[level]}" if kind in WOODY else "")
            yield Placement(asset, kind, to_world)


def _random_turn(rng: np.random.Generator) -> FloatArray:
    """Return a rotation by any angle about the vertical, then by a degree or so out of it."""
    turn, toward = rng.uniform(0, 2 * np.pi, 2)
    lean = np.radians(1.2) * rng.standard_normal()
    upright = Rotation.from_rotvec([0, 0, turn])
    leaning = Rotation.from_rotvec([lean * np.cos(toward), lean * np.sin(toward), 0])
    return (leaning * upright).as_matrix()


def _tree_placements(planting: Planting, points: FloatArray) -> Iterator[Placement]:
    forest = planting.forest
    rng = generator(forest.seed, "trees")
    names = sorted(forest.mix)
    shares = np.array([forest.mix[name] for name in names])
    kinds = [names[i] for i in rng.choice(len(names), len(points), p=shares / shares.sum())]
    deviation = rng.standard_normal(len(points)).clip(-2, 2)
    return planting.place(kinds, points, 1 + forest.height_spread * deviation, rng)


def _thicket_placements(planting: Planting, edge_m: float) -> Iterator[Placement]:
    rng = generator(planting.forest.seed, "thicket")
    ring = (edge_m - 7, edge_m + BELT_M)
    points = _strewn(planting.path, ring, ring[1], THICKET_PER_M2, 0.6, rng)
    kinds = ["young spruce" if spruce else "hazel" for spruce in rng.random(len(points)) < 0.6]
    return planting.place(kinds, points, 0.5 + 1.9 * rng.random(len(points)) ** 1.5, rng)


def _layer_placements(planting: Planting, edge_m: float) -> Iterator[Placement]:
    for kind, layer in LAYERS.items():
        rng = generator(planting.forest.seed, "undergrowth", kind)
        ring = (layer.clearance_m, min(layer.reach_m, edge_m - 2))
        density = layer.per_m2 * planting.forest.undergrowth
        if density > 0:
            points = _clumped(_strewn(planting.path, ring, ring[1], density, 0.6, rng), rng)
            scales = rng.uniform(0.6, 1.25, len(points))
            yield from planting.place([kind] * len(points), points, scales, rng)


def _clumped(points: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Thin points out so that patches and gaps a few meters wide appear."""
    patches = plane_waves((3.0, 14.0), 1.0, 24, rng)
    return points[rng.random(len(points)) < 0.5 + 0.5 * np.tanh(1.2 * patches(points))]


def _plant_asset(seed: int, name: str) -> Asset:
    """Grow the plant that an asset's name tells: kind, individual and level of detail."""
    kind, individual, *level = name.rsplit(" ", 2 if name.endswith(LEVELS) else 1)
    rng = generator(seed, "plant", kind, int(individual))
    if kind in SMALL:
        return Asset({f"{kind} leaf": SMALL[kind](rng).to_mesh()})
    plant = grow_plant(coarsened(WOODY[kind], MERGED_LEAVES[LEVELS.index(level[0])]), rng)
    return Asset({f"{kind} bark": plant.wood.to_mesh(), f"{kind} leaf": plant.leaves.to_mesh()})


def _ground_asset(terrain: Terrain, path: cKDTree, edge_m: float) -> Asset:
    low, high = path.mins - GROUND_NEAR_M, path.maxes + GROUND_NEAR_M
    surface = ground_surface(terrain, low, high, GROUND_STEP_M, edge_m + HORIZON_M)
    return Asset({"ground": surface.to_mesh()})


def _materials(seed: int, assets: Mapping[str, Asset]) -> dict[str, Material]:
    """Return the materials of all parts of the assets."""
    parts = sorted({part for asset in assets.values() for part in asset.parts})
    textures: dict[str, NDArray[np.float32]] = {}
    materials = {}
    for part in parts:
        spectra, pattern = _surface_of(part)
        if pattern not in textures:
            textures[pattern] = TEXTURES[pattern](generator(seed, "texture", pattern))
        materials[part] = Material(spectra[0], Texture(textures[pattern], spectra[1]))
    return materials


def _surface_of(part: str) -> tuple[tuple[Spectrum, Spectrum], str]:
    """Return a part's two reflectances and the name of the texture between them."""
    if part == "ground":
        return GROUND, "litter"
    kind, organ = part.rsplit(" ", 1)
    if organ == "bark":
        return BARK[kind], WOODY[kind].bark
    return LEAF[kind], WOODY[kind].foliage.blade if kind in WOODY else "leaf"
