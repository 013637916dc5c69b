"""What a kind of plant carries: how it grows, looks and stands; presets and levels of detail.

Stones, logs and fallen leaves are plants here too.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from megalopta.assets_gen import Surface
from megalopta.assets_gen.plants.detail import Detail, coarsened
from megalopta.assets_gen.plants.furrows import Furrows
from megalopta.assets_gen.plants.growth import grow_plant
from megalopta.assets_gen.plants.species import Species, aged
from megalopta.core import strict_yaml
from megalopta.scenes.spectra.reflectance import Leaf
from megalopta.scenes.spectra.spectrum import Spectrum

PRESETS: Mapping[str, Mapping[str, Any]] = MappingProxyType(
    strict_yaml.load(Path(__file__).with_name("presets.yaml").read_text("utf-8"))
)
"""Fields of a forest by name of the preset; what is not given has its default."""


@dataclass(frozen=True)
class LodLevel:
    """A level of detail."""

    name: str
    """Part of the names of the assets."""
    beyond_m: float
    """Distance from the path where it begins (m)."""
    detail: Detail
    wood_triangles: int
    """Of a tree's wood, roughly; bushes have a fourth."""
    sides: int
    """Of rocks; logs have half as many."""
    merged_small: int
    """Leaves of small plants that are drawn as one."""


LODS = (
    LodLevel("near", 0.0, Detail(0.0, 1, 0.0, 0.0), 4000, 28, 1),
    LodLevel("close", 8.0, Detail(0.009, 3, 0.006, 0.04), 1600, 20, 1),
    LodLevel("middle", 16.0, Detail(0.026, 5, 0.015, 0.07), 600, 14, 2),
    LodLevel("far", 32.0, Detail(0.07, 8, 0.03, 0.12), 250, 10, 4),
    LodLevel("horizon", 60.0, Detail(0.16, 16, 0.05, 0.25), 90, 8, 8),
)
"""From fine to coarse, for pixels of 0.0065 rad: a leaf is about a pixel wide."""

HEIGHTS = (0.35, 0.55, 0.75, 0.9, 1.0, 1.0, 1.12, 1.25)
"""What share of its species' height each individual of a tree has reached."""


Spectra = tuple[Spectrum, Spectrum]
"""Reflectances, or transmittances, where a texture is 0 and where it is 1."""
Organs = Mapping[str, Surface]


@dataclass(frozen=True)
class Coat:
    """How a surface looks: two reflectances and the name of the texture between them."""

    spectra: Spectra
    texture: str
    transmittances: Spectra | None = None
    """None is opaque."""

    @classmethod
    def of_leaves(cls, dark: Leaf, light: Leaf, texture: str) -> "Coat":
        """Leaves, which let light through."""
        through = dark.transmittance, light.transmittance
        return cls((dark.reflectance, light.reflectance), texture, through)


@dataclass(frozen=True)
class Layer:
    """How one kind of undergrowth is strewn around the path."""

    per_m2: float
    """Plants per square meter where the layer is densest, unless the forest says otherwise."""
    reach_m: float
    """Farthest distance from the path (m); smaller plants cannot be made out farther away."""
    clearance_m: float
    """Least distance from the path (m)."""
    scale: tuple[float, float] = (0.6, 1.25)
    """Smallest and largest size, as a factor on the grown plant."""


@dataclass(frozen=True)
class Plant(ABC):
    """One kind of what stands or lies in a forest."""

    name: str
    """For people, and for the seeds of its individuals."""
    coats: Mapping[str, Coat]
    """How each organ looks."""

    detail_distance: ClassVar[float] = 1.0
    """Factor on the distances from which it is drawn coarser."""
    lies = False
    """Whether it follows the slope of the ground instead of standing upright."""

    @abstractmethod
    def grow(self, lods: Sequence[LodLevel], rng: np.random.Generator) -> Iterator[Organs]:
        """One individual's organs at each of some levels of detail."""

    def individual(self, number: int) -> "Plant":
        """What an individual is grown as: trees are of several ages."""
        return self

    @property
    def leaves_from_m(self) -> float:
        """Height of the lowest leaves above the ground (m)."""
        return 0.0

    def part(self, organ: str) -> str:
        """Name of an organ's material, such as "beech bark"."""
        return f"{self.name} {organ}".strip()


@dataclass(frozen=True)
class Woody(Plant):
    """A tree or bush."""

    shape: Species
    """What it is grown from."""
    layer: Layer | None = None
    """Where it stands in the undergrowth."""
    fullness: int = 1
    """How many times its species' leaves it bears."""
    furrows: Furrows | None = None
    """Relief of its bark, drawn in full detail only; None is smooth."""

    @property
    def carved_bark(self) -> Coat | None:
        """How bark with furrows looks; None where it has none."""
        relief = self.shape.relief
        return replace(self.coats["bark"], texture=relief.pattern) if relief else None

    def carved(self, depth: float, pattern: NDArray[np.float32]) -> "Woody":
        """The same with furrows where the pattern (H, W) of its relief is dark.

        They are `depth` times as deep as its species' are.
        """
        relief = self.shape.relief
        return replace(self, furrows=Furrows(pattern, depth * relief.depth_m)) if relief else self

    def individual(self, number: int) -> "Woody":
        """A tree of the height that individuals of this number have reached."""
        return self if self.layer else replace(self, shape=aged(self.shape, HEIGHTS[number]))

    @property
    def leaves_from_m(self) -> float:
        """Height of the lowest branches (m)."""
        return self.shape.crown.base * self.shape.height_m

    def grow(self, lods: Sequence[LodLevel], rng: np.random.Generator) -> Iterator[Organs]:
        """One individual at each of some levels, all coarsened from one plant."""
        plant = grow_plant(self.shape, rng, self.fullness, self.furrows)
        for lod in lods:
            is_full = lod.detail.leaf_m2 == 0
            wood, leaves = (
                (plant.wood, plant.leaves) if is_full else coarsened(plant, lod.detail, rng)
            )
            yield {"bark": wood, "leaf": leaves}


@dataclass(frozen=True)
class Small(Plant):
    """A plant of the forest's floor, or what lies on it."""

    layer: Layer
    drawn: Callable[[LodLevel, np.random.Generator], Organs]
    """Organs of an individual at a level of detail, the same individual for the same generator."""
    lies: bool = False

    detail_distance = 0.4

    def grow(self, lods: Sequence[LodLevel], rng: np.random.Generator) -> Iterator[Organs]:
        """One individual at each of some levels."""
        key = int(rng.integers(2**63))
        for lod in lods:
            yield self.drawn(lod, np.random.default_rng(key))


AnyPlant = TypeVar("AnyPlant", bound=Plant)


def by_name(*plants: AnyPlant) -> Mapping[str, AnyPlant]:
    """Plants by their names."""
    return MappingProxyType({plant.name: plant for plant in plants})
