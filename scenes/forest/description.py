"""Forest around a camera's path, as scene data, and its size."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, model_validator
from scipy.spatial import cKDTree

from megalopta.scenes.base import SceneDescription
from megalopta.scenes.cameras.base import Camera
from megalopta.scenes.forest import planting, specimens
from megalopta.scenes.forest.floor import even_ground, kept_floor, laid, make_land, trail_of
from megalopta.scenes.forest.flora import BUSHES, LAYERS, LODS, PRESETS, TREES
from megalopta.scenes.forest.sway import Wind, swaying
from megalopta.scenes.light import Light
from megalopta.scenes.scene import Asset, Haze, Placement, Scene
from megalopta.scenes.trajectories.base import Path

SMALL_TRIANGLES = 80
"""Approximate triangles of an average plant of the undergrowth."""
TREE_LEAF_M2, LEAF_M2 = 45.0, 0.004
"""Approximate leaf area of a tree without a given leaf-area index, and of one leaf (m²)."""
CROWN_M = 5.0
"""Approximate height of the lowest leaves above the camera (m)."""
CLUMPED = 0.5
"""Share of the undergrowth that remains between its gaps."""
MOST_TRIANGLES = 40e6
"""Limit for the memory of an ordinary machine (some 300 bytes per triangle)."""


def check_stand(forest: "Forest", path_m: float) -> None:
    """Reject a forest around a path of the given length that would not fit into memory."""
    plants, triangles = foreseen(forest, path_m)
    if triangles > MOST_TRIANGLES:
        raise ValueError(
            f"trees {forest.trees}, density_per_ha {forest.density_per_ha:g}, undergrowth "
            f"{forest.undergrowth:g} and detail {forest.detail:g} make about {plants:.2g} plants "
            f"of {triangles:.2g} triangles, more than {MOST_TRIANGLES:.2g}; lower one of them"
        )


def foreseen(forest: "Forest", path_m: float) -> tuple[float, float]:
    """Return the approximate numbers of plants and triangles around a straight path."""

    def area(reach: float) -> float:
        return float(np.pi * reach**2 + 2 * reach * path_m)

    per_m2, clearance_m = forest.density_per_ha / 1e4, forest.clearance_m
    # The stand reaches to the R where area(R) − area(clearance) holds its trees.
    half = path_m / np.pi
    edge = float(np.sqrt(half**2 + (forest.trees / per_m2 + area(clearance_m)) / np.pi) - half)
    end = edge + planting.BELT_M
    beyond_m2 = np.square([level.beyond_m for level in LODS])
    begins = np.sqrt(np.maximum(0, forest.detail**2 * beyond_m2 - CROWN_M**2))
    limits = [*np.minimum(begins, end).tolist(), end]
    planted = [area(far) - area(clearance_m) if far > clearance_m else 0.0 for far in limits]
    counts = per_m2 * np.diff(planted)
    leaf_m2 = (forest.leaf_area_index or TREE_LEAF_M2 * per_m2) / per_m2
    merged = np.array([max(level.detail.leaf_m2, LEAF_M2) for level in LODS])
    leaves = leaf_m2 / merged * np.where(np.arange(len(LODS)) > 0, 1, 2)
    triangles = np.array([level.wood_triangles for level in LODS]) + leaves
    bushes = planting.THICKET_PER_M2 * (area(end) - area(edge - 7))
    bush = triangles[np.searchsorted(limits[1:-1], edge)] / 8
    small = CLUMPED * sum(
        density * area(min(LAYERS[kind].reach_m, edge))
        for kind, density in forest.densities_per_m2.items()
    )
    total = counts @ triangles + bushes * bush + small * SMALL_TRIANGLES
    return float(counts.sum() + bushes + small), float(total)


PIXEL_RAD = 0.0065
"""Pixel size for which the levels of detail are made (rad)."""
NARROWEST_M = 0.2
"""Smallest width of a trodden path (m)."""

NotNegative = Annotated[float, Field(ge=0)]


class Forest(SceneDescription, frozen=True):
    """Mixed stand of trees with undergrowth on gently rolling ground."""

    kind: Literal["forest"] = "forest"
    preset: Literal["open", "dense", "understorey", "clearing", "rainforest", "trail"] | None = None
    """Named forest, open, dense, understorey, clearing, rainforest or trail: sets every field that
    is not given."""
    seed: Annotated[int, Field(ge=0)] = 1
    """Random seed of the forest."""
    trees: Annotated[int, Field(gt=0, le=1_000_000)] = 150
    """Trees of the stand, without those of the surrounding belt (count)."""
    density_per_ha: Annotated[float, Field(ge=10, le=10_000)] = 550.0
    """Trees per hectare; with the number of trees it sets the extent of the stand (1/ha)."""
    mix: dict[str, NotNegative] = Field(
        default={"beech": 0.45, "birch": 0.25, "spruce": 0.3},
        description=f"Share of each species, relative to their sum (1): {', '.join(TREES)}.",
    )
    leaf_area_index: Annotated[float, Field(gt=0, le=12)] | None = None
    """One-sided leaf area of trees, bushes and climbers over the ground area, within 20 m of the
    clearance around the path; null: as grown (m²/m²)."""
    age_spread: Annotated[float, Field(ge=0, le=1)] = 0.25
    """Standard deviation of tree heights due to age, relative to the species' mean, in classes from
    0.35 to 1.25 of it (1)."""
    height_spread: Annotated[float, Field(ge=0, le=0.3)] = 0.1
    """Standard deviation of tree height relative to its class; truncated at twice this (1)."""
    undergrowth: Annotated[float, Field(ge=0, le=4)] = 1.0
    """Factor on all densities of undergrowth_per_m2 (1)."""
    undergrowth_per_m2: dict[str, NotNegative] = Field(
        default={kind: layer.per_m2 for kind, layer in LAYERS.items()}
    )
    """Density of each kind of undergrowth where it is densest; unnamed kinds are absent (1/m²)."""
    clearance_m: Annotated[float, Field(ge=0.3, le=100)] = 1.2
    """Smallest distance from the camera's path to the middle of a trunk (m)."""
    ground: Literal["litter", "meadow", "moss"] = "litter"
    """Ground cover between the plants: litter, meadow or moss."""
    relief_m: Annotated[float, Field(ge=0, le=3)] = 0.6
    """Root mean square height of the rolling land along the path (m)."""
    floor_relief_m: Annotated[float, Field(ge=0, le=0.2)] = 0.0
    """Root mean square height of bumps and hollows of the floor, 0.1 to 1.3 m wide; 0: smooth
    (m)."""
    moss_share: Annotated[float, Field(ge=0, le=0.95)] = 0.0
    """Share of the ground covered by moss patches, within 10 m of the camera's path and off a
    trodden path (1)."""
    path_width_m: Annotated[float, Field(ge=0, le=5)] = 0.0
    """Mean width of a trodden path of bare soil along and beyond the camera's path; 0: none (m)."""
    bark_relief: Annotated[float, Field(ge=0, le=3)] = 0.0
    """Depth of furrows in the bark of near stems, relative to the species' typical depth; 0: smooth
    (1)."""
    detail: Annotated[float, Field(gt=0, le=1000)] = 1.0
    """Factor on the distances beyond which plants are drawn coarser, which depend on the camera's
    pixels; 1000 draws all in full."""

    @model_validator(mode="before")
    @classmethod
    def _take_preset(cls, fields: Any) -> Any:
        name = fields.get("preset") if isinstance(fields, Mapping) else None
        return {**PRESETS[name], **fields} if isinstance(name, str) and name in PRESETS else fields

    wind: Wind | None = None
    """Wind that makes trees and bushes sway; null: calm."""
    haze: Haze | None = None
    """Mist or fog between and just above the trees, by its visibility_m; null: clear air."""

    @model_validator(mode="after")
    def _check_plants(self) -> "Forest":
        for name, known in ("mix", TREES), ("undergrowth_per_m2", LAYERS):
            if unknown := sorted(getattr(self, name).keys() - known.keys()):
                raise ValueError(f"{name}: unknown kind {unknown}; choose from {sorted(known)}")
        if sum(self.mix.values()) <= 0:
            raise ValueError(f"mix: the shares {self.mix} sum to 0; give one a positive share")
        check_stand(self, 0.0)
        return self

    @model_validator(mode="after")
    def _check_floor(self) -> "Forest":
        if self.moss_share and self.ground == "moss":
            raise ValueError(
                f"moss_share {self.moss_share:g} adds patches to a ground that is all moss; set "
                "ground to litter or meadow, or moss_share to 0"
            )
        if 0 < self.path_width_m < NARROWEST_M:
            raise ValueError(
                f"path_width_m {self.path_width_m:g} is no path; give {NARROWEST_M:g} or more, or "
                "0 for none"
            )
        if self.path_width_m > 2 * self.clearance_m:
            raise ValueError(
                f"path_width_m {self.path_width_m:g} is wider than the {2 * self.clearance_m:g} m "
                "between trunks along it; narrow it, or raise clearance_m to half of it"
            )
        return self

    @property
    def densities_per_m2(self) -> dict[str, float]:
        """Densities of the undergrowth with the common factor applied (1/m²)."""
        return {kind: self.undergrowth * d for kind, d in self.undergrowth_per_m2.items()}

    @property
    def is_hazy(self) -> bool:
        """True if there is mist or fog."""
        return self.haze is not None

    def build(self, light: Light, camera: Camera, trajectory: Path) -> Scene:
        """Return the forest in the light, with trunks clear of the camera's path."""
        finer = float(np.clip(PIXEL_RAD * camera.focal_length_px, 0.7, 1.25))
        detail = min(self.detail * finer, 1000.0)
        drawn = self.model_copy(update={"detail": detail})
        poses = trajectory.poses()
        stand = build_forest(drawn, poses[:, :2, 3], poses[0, :2, 2])
        return replace(stand, lighting=light.lighting(), haze=self.haze)

    def describe(self) -> str:
        """Sentence for the report."""
        *names, last = [name for name, share in self.mix.items() if share > 0]
        species = f"{', '.join(names)} and {last}" if names else last
        haze = f", in haze with a visibility of {self.haze.visibility_m:g} m" if self.haze else ""
        stand = f"A forest of {self.trees:,} trees ({species}), {self.density_per_ha:g} per hectare"
        return f"{stand}{haze}."


def build_forest(forest: Forest, path_xy: ArrayLike, heading: ArrayLike = (1.0, 0.0)) -> Scene:
    """Return the forest around a path of camera positions (n, 2) (m), without light.

    Trunks keep `clearance_m` from the line through them, and the ground along it is level, at
    height 0, to a few centimeters. Placements are named by species, "ground" is the first. A
    trodden path follows the camera, or the heading (2,) if the camera stays in place.

    Raises ValueError if the path is not a finite (n, 2) array, or so long that the trees cannot
    surround it.
    """
    points = np.asarray(path_xy, dtype=float)
    if points.ndim != 2 or points.shape[1] != 2 or not len(points) or not np.isfinite(points).all():
        raise ValueError(f"path_xy: shape {points.shape}; give finite positions of shape (n, 2)")
    check_stand(forest, float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum()))
    way = planting.dense_path(points)
    path = cKDTree(way)
    stand = forest.trees, forest.density_per_ha, forest.clearance_m
    trail = trail_of(forest, way, np.asarray(heading, dtype=float))
    trees, edge_m = planting.tree_positions(forest.seed, *stand, path, trail)
    land = make_land(forest.seed, path, forest.relief_m, edge_m)
    is_even = not (forest.floor_relief_m or forest.moss_share or forest.path_width_m)
    floor = None if is_even else kept_floor(forest, land, trail, trees, edge_m)
    height = floor.height if floor else land.height
    planted = planting.Planting(forest.seed, path, height, forest.detail, trail)
    placements: tuple[Placement, ...] = (
        Placement("ground", "ground", np.eye(4)),
        *planted.trees(forest.mix, forest.age_spread, forest.height_spread, trees),
        *planted.thicket(forest.densities_per_m2, edge_m),
        *planted.undergrowth(forest.densities_per_m2, edge_m),
    )
    litter: dict[str, Asset] = {}
    if floor:
        placements, litter = laid(forest.seed, placements, floor)
    names = {placement.asset for placement in placements} - litter.keys() - {"ground"}
    grow = partial(specimens.grow_specimens, forest.seed, names, bark_relief=forest.bark_relief)
    if forest.leaf_area_index:
        ring_m = forest.clearance_m, forest.clearance_m + specimens.RING_M
        indices = forest.leaf_area_index, TREE_LEAF_M2 * forest.density_per_ha / 1e4
        grown, share = specimens.in_leaf(*indices, grow, placements, path, ring_m)
    else:
        grown, share = grow(), 1.0
    assets = specimens.plant_assets(forest.seed, grown, share) | litter
    assets["ground"] = floor.asset() if floor else even_ground(forest.ground, land, edge_m)
    if forest.wind:
        placements = tuple(swaying(placements, assets, {*TREES, *BUSHES}, forest.wind))
    surfaces = specimens.materials(forest.seed, assets, forest.bark_relief > 0)
    return Scene(surfaces, assets, placements)
