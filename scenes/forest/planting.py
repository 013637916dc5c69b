"""Places of plants: a stand, a belt behind it that closes the horizon, undergrowth in patches.

Level of detail depends on the distance from the whole path, so that no shape changes with time.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from megalopta.assets_gen import generator
from megalopta.assets_gen.plants.foliage import TONES
from megalopta.assets_gen.scatter import distance_to, poisson_disk
from megalopta.assets_gen.tileable_noise import plane_waves
from megalopta.assets_gen.trail import Trail
from megalopta.core.arrays import Floats
from megalopta.scenes.forest import flora
from megalopta.scenes.forest.specimens import INDIVIDUALS
from megalopta.scenes.scene import Placement

REGULARITY = 0.72
"""Smallest distance between trees in units of 1/√density; 0.83 is the largest possible."""
LEAST_DEPTH_M = 8.0
"""Smallest extent of the stand beyond the clearance, on all sides."""
BELT_M = 24.0
"""Width of the belt of trees, bushes and saplings around the stand (m)."""
TRUNK_M, SMALL_M = 0.35, 0.1
"""Smallest distance of a trunk's middle, and of a small plant, from the edge of a trodden path."""
THICKET_PER_M2 = 0.2
"""Bushes and saplings of the belt (1/m²)."""
THICKET: Mapping[str, float] = {"young spruce": 0.45, "hazel": 0.35, "young beech": 0.2}
"""Kinds and shares of these if there is no bush in the undergrowth."""
EYE_M = 1.5
"""Approximate height from which the camera sees leaves (m)."""
SLOPE_STEP_M = 1.5
"""Distance between points in front and behind from which litter gets its slope (m)."""


def dense_path(path_xy: Floats) -> Floats:
    """Return the path with points at most half a meter apart."""
    gaps = np.linalg.norm(np.diff(path_xy, axis=0), axis=1)
    place = np.concatenate([[0.0], np.cumsum(gaps)])
    every = np.union1d(place, np.arange(0, place[-1], 0.5))
    return np.stack([np.interp(every, place, path_xy[:, i]) for i in range(2)], axis=-1)


def planted_reach(trees: int, density_per_ha: float, clearance_m: float) -> float:
    """Return a distance from the path beyond which no tree is planted (m)."""
    return float(np.sqrt(trees / (density_per_ha / 1e4) / np.pi) + clearance_m + BELT_M)


def tree_positions(
    seed: int,
    trees: int,
    density_per_ha: float,
    clearance_m: float,
    path: cKDTree,
    trail: Trail | None = None,
) -> tuple[Floats, float]:
    """Return tree positions (n, 2), nearest to the path first, and the extent of the stand (m).

    The first `trees` are the stand; the rest fill the belt behind it. None is on a trodden path.
    """
    density_per_m2 = density_per_ha / 1e4
    reach = planted_reach(trees, density_per_ha, clearance_m)
    rng = generator(seed, "planting")
    planted = _strewn(path, (clearance_m, np.inf), reach, density_per_m2, REGULARITY, rng)
    if trail:
        planted = planted[trail.clear_of(planted, 0.0, TRUNK_M)]
    distance = distance_to(path, planted)
    order = np.argsort(distance, kind="stable")
    edge_m = float(distance[order[trees - 1]])
    if edge_m < clearance_m + LEAST_DEPTH_M:
        raise ValueError(
            f"trees: {trees} trees at {density_per_ha:g} per hectare reach only {edge_m:.1f} m "
            f"from the path, less than {clearance_m + LEAST_DEPTH_M:g} m; "
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
) -> Floats:
    """Return Poisson-disk points around the path whose distance from it is within a ring."""
    low, high = path.mins - margin_m, path.maxes + margin_m
    count = int(per_m2 * np.prod(high - low))
    points = poisson_disk(low, high, count, regularity / np.sqrt(per_m2), rng)
    distance = distance_to(path, points)
    return points[(distance >= ring_m[0]) & (distance <= ring_m[1])]


@dataclass(frozen=True)
class Planting:
    """Data that every planting step needs."""

    seed: int
    path: cKDTree
    """Points of the camera's path (m)."""
    height: Callable[[Floats], Floats]
    """Height of the ground (m) at points (n, 2) (m)."""
    detail: float
    """Factor on the distances at which plants get coarser."""
    trail: Trail | None = None
    """Trodden path, with only litter on it."""

    def trees(
        self, mix: Mapping[str, float], age_spread: float, height_spread: float, points: Floats
    ) -> Iterator[Placement]:
        """Place a tree on every point (n, 2), with random species of the mix and random age."""
        rng = generator(self.seed, "trees")
        names = sorted(mix)
        shares = np.array([mix[name] for name in names])
        plants = [
            flora.TREES[names[i]]
            for i in rng.choice(len(names), len(points), p=shares / shares.sum())
        ]
        deviation = rng.standard_normal(len(points)).clip(-2, 2)
        away = (np.array(flora.HEIGHTS) - 1) / max(age_spread, 1e-3)
        ages = np.exp(-(away**2) / 2)  # a normal distribution around the mean
        heights = 1 + height_spread * deviation
        return self._place(plants, points, heights, rng, ages / ages.sum())

    def thicket(self, per_m2: Mapping[str, float], edge_m: float) -> Iterator[Placement]:
        """Close the view between the trunks around a stand that reaches to `edge_m`.

        Bushes have the same shares as in the undergrowth, without lianas and others above 6 m.
        """
        rng = generator(self.seed, "thicket")
        ring = (edge_m - 7, edge_m + BELT_M)
        points = _strewn(self.path, ring, ring[1], THICKET_PER_M2, 0.6, rng)
        points = self._beside_trail(points, 0.0)
        low = {name for name, bush in flora.BUSHES.items() if bush.shape.height_m < 6.0}
        low_shares = {kind: share for kind, share in per_m2.items() if kind in low and share > 0}
        shares = low_shares or THICKET
        weights = np.array(list(shares.values()))
        kinds = rng.choice(list(shares), len(points), p=weights / weights.sum()).tolist()
        plants = [flora.PLANTS[kind] for kind in kinds]
        return self._place(plants, points, 0.5 + 1.9 * rng.random(len(points)) ** 1.5, rng)

    def undergrowth(self, per_m2: Mapping[str, float], edge_m: float) -> Iterator[Placement]:
        """Scatter every kind at its density."""
        for kind, density in per_m2.items():
            layer, rng = flora.LAYERS[kind], generator(self.seed, "undergrowth", kind)
            ring = (layer.clearance_m, min(layer.reach_m, edge_m - 2))
            if density > 0:
                points = _strewn(self.path, ring, ring[1], density, 0.6, rng)
                # Patches and gaps are a few meters wide.
                patches = plane_waves((3.0, 14.0), 1.0, 24, rng)
                kept = rng.random(len(points)) < 0.5 + 0.5 * np.tanh(1.2 * patches(points))
                points = points[kept]
                if kind != flora.LITTER:
                    points = self._beside_trail(points, layer.clearance_m)
                scales = rng.uniform(*layer.scale, len(points))
                plants = [flora.PLANTS[kind]] * len(points)
                yield from self._place(plants, points, scales, rng)

    def _beside_trail(self, points: Floats, from_middle_m: float) -> Floats:
        """Return those of some points (n, 2) that are not on the trodden path."""
        if self.trail is None:
            return points
        return np.asarray(points[self.trail.clear_of(points, from_middle_m, SMALL_M)])

    def _place(
        self,
        plants: Sequence[flora.Plant],
        points: Floats,
        scales: Floats,
        rng: np.random.Generator,
        shares: Floats | None = None,
    ) -> Iterator[Placement]:
        """Place a plant per point (n, 2), with random turn and lean; shares are of individuals."""
        finer = np.array([plant.detail_distance for plant in plants])
        lowest = np.array([plant.leaves_from_m for plant in plants]) * scales - EYE_M
        away = np.hypot(distance_to(self.path, points), np.maximum(lowest, 0))
        limits = [level.beyond_m * self.detail for level in flora.LODS[1:]]
        levels = np.searchsorted(limits, away / finer)
        kinds = INDIVIDUALS if shares is None else len(shares)
        numbers = rng.choice(kinds, len(points), p=shares).tolist()
        heights, slopes = self.height(points), self._slopes(points)
        # By any angle about the vertical, and by about a degree out of it.
        angle, toward = rng.uniform(0, 2 * np.pi, (2, len(points)))
        lean, none = np.radians(1.2) * rng.standard_normal(len(points)), np.zeros(len(points))
        upright = Rotation.from_rotvec(np.column_stack([none, none, angle]))
        axes = np.column_stack([lean * np.cos(toward), lean * np.sin(toward), none])
        turns = (Rotation.from_rotvec(axes) * upright).as_matrix()
        lying = np.flatnonzero([plant.lies for plant in plants])
        turns[lying] = slopes[lying] @ turns[lying]
        to_world = np.tile(np.eye(4), (len(points), 1, 1))
        to_world[:, :3, :3] = scales[:, None, None] * turns
        to_world[:, :3, 3] = np.column_stack([points, heights])
        tones = (rng.integers(TONES, size=len(points)) / TONES).tolist()
        for index, plant in enumerate(plants):
            asset = f"{plant.name} {numbers[index]} {flora.LODS[levels[index]].name}"
            yield Placement(asset, plant.name, to_world[index], leaf_shift=tones[index])

    def _slopes(self, points: Floats) -> Floats:
        """Return rotations (n, 3, 3) that tilt the vertical to the ground's normal."""
        steps = SLOPE_STEP_M * np.eye(2)
        rise = np.stack(
            [self.height(points + s) - self.height(points - s) for s in steps], axis=-1
        ) / (2 * SLOPE_STEP_M)
        steep = np.linalg.norm(rise, axis=-1, keepdims=True)
        across = np.column_stack([rise[:, 1:], -rise[:, :1], np.zeros(len(points))])
        angle = -np.arctan(steep) / np.maximum(steep, 1e-12)
        return Rotation.from_rotvec(-angle * across).as_matrix()
