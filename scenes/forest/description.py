"""A forest around a camera's path, as scene data."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, field_validator, model_validator
from scipy.spatial import cKDTree

from megalopta.assets_gen import generator
from megalopta.assets_gen.ground import Terrain, ground_surface, make_terrain
from megalopta.scenes.base import SceneDescription
from megalopta.scenes.cameras import Camera
from megalopta.scenes.forest.flora import BUSHES, TREES
from megalopta.scenes.forest.leaf_area import RING_M, in_leaf
from megalopta.scenes.forest.planting import FloatArray, Planting, dense_path, tree_positions
from megalopta.scenes.forest.size import check_size
from megalopta.scenes.forest.specimens import grow_specimens, materials, plant_assets
from megalopta.scenes.forest.stand import PRESETS
from megalopta.scenes.forest.sway import Wind, swaying
from megalopta.scenes.forest.undergrowth import LAYERS
from megalopta.scenes.lighting import Light
from megalopta.scenes.trajectories import Path
from megalopta.scenes.world import Asset, Haze, Placement, Scene

RIM_WIDTH_M, RIM_HEIGHT_M = 22.0, 7.0
"""Behind the stand the land rises over this width by this height (m)."""
HORIZON_M = 160.0
"""The ground reaches this far beyond the stand (m)."""
GROUND_STEP_M, GROUND_NEAR_M = 0.4, 10.0
"""Grid of the ground's mesh up to a distance from the path (m)."""
PIXEL_RAD = 0.0065
"""Pixels for which the levels of detail are made (rad)."""
FINER = 0.7, 1.25
"""Least and largest factor on the distances of levels of detail for a camera's own pixels."""

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]


class Forest(SceneDescription, frozen=True):
    """A mixed stand of trees with undergrowth on gently rolling ground."""

    kind: Literal["forest"] = "forest"
    """Which scene this is."""
    preset: Literal["open", "dense", "understorey", "clearing", "rainforest"] | None = None
    """Named forest, open, dense, understorey, clearing or rainforest: sets every field that is not
    given."""
    seed: Annotated[int, Field(ge=0)] = 1
    """Which forest: every seed grows another one."""
    trees: Annotated[int, Field(gt=0, le=1_000_000)] = 150
    """Trees of the stand, without those of the belt around it (count)."""
    density_per_ha: Annotated[float, Field(ge=10, le=10_000)] = 550.0
    """Trees per hectare; with the number of trees it sets how far the stand reaches (1/ha)."""
    mix: dict[str, NotNegative] = Field(
        default={"beech": 0.45, "birch": 0.25, "spruce": 0.3},
        description=f"Share of each species, of {', '.join(TREES)}; relative to the sum (1).",
    )
    leaf_area_index: Annotated[float, Field(gt=0, le=12)] | None = None
    """One-sided area of the leaves of trees, bushes and climbers over the ground's, within 20 m of
    where trunks may stand beside the path; null is what grows (m²/m²)."""
    age_spread: Annotated[float, Field(ge=0, le=1)] = 0.25
    """Standard deviation of the heights that trees have reached at their age, over the species'
    mean, in classes from 0.35 to 1.25 of it (1)."""
    height_spread: Annotated[float, Field(ge=0, le=0.3)] = 0.1
    """Standard deviation of tree height over the mean of its class; cut at twice this (1)."""
    undergrowth: Annotated[float, Field(ge=0, le=4)] = 1.0
    """Factor on all densities of undergrowth_per_m2 (1)."""
    undergrowth_per_m2: dict[str, NotNegative] = Field(
        default={kind: layer.per_m2 for kind, layer in LAYERS.items()}
    )
    """Density of each kind of undergrowth where it is densest; kinds not named are absent
    (1/m²)."""
    clearance_m: Annotated[float, Field(ge=0.3, le=100)] = 1.2
    """Least distance from the camera's path to the middle of a trunk (m)."""
    ground: Literal["litter", "meadow", "moss"] = "litter"
    """What covers the ground between the plants: litter, meadow or moss."""
    relief_m: Annotated[float, Field(ge=0, le=3)] = 0.6
    """Root mean square height of the rolling land beside the path (m)."""
    detail: Annotated[float, Field(gt=0, le=1000)] = 1.0
    """Factor on the distances beyond which plants are drawn coarser, which follow the camera's
    pixels; 1000 draws all in full."""

    @model_validator(mode="before")
    @classmethod
    def _take_preset(cls, given: Any) -> Any:
        name = given.get("preset") if isinstance(given, Mapping) else None
        return {**PRESETS[name], **given} if isinstance(name, str) and name in PRESETS else given

    wind: Wind | None = None
    """Wind that makes trees and bushes sway; null is calm."""
    haze: Haze | None = None
    """Mist or fog between the trees and just above them, by its visibility_m; null is clear air."""

    @field_validator("mix")
    @classmethod
    def _check_mix(cls, mix: dict[str, float]) -> dict[str, float]:
        unknown = sorted(mix.keys() - TREES.keys())
        if unknown:
            raise ValueError(f"no species {unknown}; choose from {sorted(TREES)}")
        if sum(mix.values()) <= 0:
            raise ValueError(f"the shares {mix} sum to 0; give one species a positive share")
        return mix

    @field_validator("undergrowth_per_m2")
    @classmethod
    def _check_undergrowth(cls, densities: dict[str, float]) -> dict[str, float]:
        unknown = sorted(densities.keys() - LAYERS.keys())
        if unknown:
            raise ValueError(f"no kind {unknown}; choose from {sorted(LAYERS)}")
        return densities

    @model_validator(mode="after")
    def _check_size(self) -> "Forest":
        check_size(self, 0.0)
        return self

    @property
    def densities_per_m2(self) -> dict[str, float]:
        """Densities of the undergrowth with the common factor applied (1/m²)."""
        return {kind: self.undergrowth * d for kind, d in self.undergrowth_per_m2.items()}

    @property
    def is_moving(self) -> bool:
        """Whether it sways in the wind."""
        return self.wind is not None

    @property
    def is_hazy(self) -> bool:
        """Whether there is mist or fog."""
        return self.haze is not None

    @property
    def counts(self) -> dict[str, int]:
        """Its trees, without those of the belt."""
        return {"trees": self.trees}

    @property
    def canopy_ring_m(self) -> tuple[float, float]:
        """Where its leaf-area index is met and measured: distances from the camera's path (m)."""
        return self.clearance_m, self.clearance_m + RING_M

    def build(self, light: Light, camera: Camera, trajectory: Path) -> Scene:
        """The forest around a camera's path, from which trunks keep clear, in the light."""
        detail = min(self.detail * _finer(camera), 1000.0)
        drawn = self.model_copy(update={"detail": detail})
        stand = build_forest(drawn, trajectory.poses()[:, :2, 3])
        return replace(stand, lighting=light.lighting(), haze=self.haze)

    def describe(self) -> str:
        """A sentence for the report."""
        *others, last = [name for name, share in self.mix.items() if share > 0]
        species = f"{', '.join(others)} and {last}" if others else last
        haze = f", in haze with a visibility of {self.haze.visibility_m:g} m" if self.haze else ""
        stand = f"A forest of {self.trees:,} trees ({species}), {self.density_per_ha:g} per hectare"
        return f"{stand}{haze}."


def build_forest(forest: Forest, path_xy: ArrayLike) -> Scene:
    """Return the forest around a path of camera positions (n, 2) (m), without light.

    Trunks keep `clearance_m` from the line through them, and the ground along it is level, at
    height 0, but for a few centimeters. Placements are named by species, "ground" is the first.

    Raises
    ------
    ValueError
        If the path is not a finite (n, 2) array, or so long that the trees cannot surround it.
    """
    path_points = _checked_path(path_xy)
    check_size(forest, float(np.linalg.norm(np.diff(path_points, axis=0), axis=1).sum()))
    path = cKDTree(dense_path(path_points))
    trees, edge_m = tree_positions(
        forest.seed, forest.trees, forest.density_per_ha, forest.clearance_m, path
    )
    rim_m = (edge_m, edge_m + RIM_WIDTH_M)
    rng = generator(forest.seed, "terrain")
    terrain = make_terrain(path, forest.relief_m, rim_m, RIM_HEIGHT_M, rng)
    planting = Planting(forest.seed, path, terrain, forest.detail)
    placements = (
        Placement("ground", "ground", np.eye(4)),
        *planting.trees(forest.mix, forest.age_spread, forest.height_spread, trees),
        *planting.thicket(forest.densities_per_m2, edge_m),
        *planting.undergrowth(forest.densities_per_m2, edge_m),
    )
    assets = _grown(forest, placements, path)
    assets["ground"] = _ground_asset(forest.ground, terrain, path, edge_m)
    if forest.wind:
        placements = tuple(swaying(placements, assets, {*TREES, *BUSHES}, forest.wind))
    return Scene(materials(forest.seed, assets), assets, placements)


def _grown(forest: Forest, placements: Sequence[Placement], path: cKDTree) -> dict[str, Asset]:
    """Return the plants' assets, which carry the leaves that the forest asks for."""
    grow = partial(grow_specimens, forest.seed, {placement.asset for placement in placements[1:]})
    if forest.leaf_area_index is None:
        return plant_assets(forest.seed, grow())
    wanted = forest.leaf_area_index
    specimens, share = in_leaf(wanted, grow, placements, path, forest.canopy_ring_m)
    return plant_assets(forest.seed, specimens, share)


def _checked_path(path_xy: ArrayLike) -> FloatArray:
    path = np.asarray(path_xy, dtype=float)
    if path.ndim != 2 or path.shape[1] != 2 or not len(path) or not np.all(np.isfinite(path)):
        raise ValueError(f"path_xy: shape {path.shape}; give finite positions of shape (n, 2)")
    return path


def _finer(camera: Camera) -> float:
    """Return how much farther than with `PIXEL_RAD` a camera tells leaves apart, within limits."""
    return float(np.clip(PIXEL_RAD * camera.focal_length_px, *FINER))


def _ground_asset(cover: str, terrain: Terrain, path: cKDTree, edge_m: float) -> Asset:
    low, high = path.mins - GROUND_NEAR_M, path.maxes + GROUND_NEAR_M
    surface = ground_surface(terrain, low, high, GROUND_STEP_M, edge_m + HORIZON_M)
    return Asset({f"{cover} ground": surface.to_mesh()})
