"""Plants of a forest, from `flora.yaml` and from here; stones, logs and fallen leaves are some."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from megalopta.assets_gen import Surface
from megalopta.assets_gen.bodies import grow_rock
from megalopta.assets_gen.plants import undergrowth
from megalopta.assets_gen.plants.detail import Detail, merged_leaves
from megalopta.assets_gen.plants.species import Species
from megalopta.core import strict_yaml
from megalopta.scenes.spectra.reflectance import Leaf, leaf_of, reflectance_of
from megalopta.scenes.spectra.spectrum import Spectrum

PRESETS: Mapping[str, Mapping[str, Any]] = strict_yaml.load(
    Path(__file__).with_name("presets.yaml").read_text("utf-8")
)
"""Fields of a forest by preset name; others have their defaults."""


@dataclass(frozen=True)
class LodLevel:
    """Level of detail."""

    name: str
    """Part of the assets' names."""
    beyond_m: float
    """Distance from the path at which it begins (m)."""
    detail: Detail
    wood_triangles: int
    """Approximate triangles of a tree's wood; bushes have a fourth."""
    sides: int
    """Sides of rocks; logs have half as many."""
    merged_small: int
    """Number of small plants' leaves merged into one."""
    moss_m: float = 0.0
    """Steps of the moss on stems (m); 0: none is drawn."""


LODS = (
    LodLevel("near", 0.0, Detail(0.0, 1, 0.0, 0.0), 4000, 28, 1, 0.04),
    LodLevel("close", 8.0, Detail(0.009, 3, 0.006, 0.04), 1600, 20, 1, 0.06),
    LodLevel("middle", 16.0, Detail(0.026, 5, 0.015, 0.07), 600, 14, 2, 0.12),
    LodLevel("far", 32.0, Detail(0.07, 8, 0.03, 0.12), 250, 10, 4),
    LodLevel("horizon", 60.0, Detail(0.16, 16, 0.05, 0.25), 90, 8, 8),
)
"""Levels from fine to coarse, for pixels of 0.0065 rad: a leaf is about a pixel wide."""

HEIGHTS = (0.35, 0.55, 0.75, 0.9, 1.0, 1.0, 1.12, 1.25)
"""Heights of a tree's individuals, relative to the species' height."""


Spectra = tuple[Spectrum, Spectrum]
"""Reflectances, or transmittances, where a texture is 0 and where it is 1."""
Organs = Mapping[str, Surface]


@dataclass(frozen=True)
class Coat:
    """Look of a surface: two reflectances and the name of the texture between them."""

    spectra: Spectra
    texture: str
    transmittances: Spectra | None = None
    """Transmittances; None: opaque."""
    gloss: float | None = None
    """RMS slope of the interface's facets; None: dull."""

    @classmethod
    def of_leaves(cls, dark: Leaf, light: Leaf, texture: str) -> "Coat":
        """Return the coat of leaves, which transmit light."""
        through = dark.transmittance, light.transmittance
        return cls((dark.reflectance, light.reflectance), texture, through, gloss=0.35)


@dataclass(frozen=True)
class Layer:
    """Distribution of one kind of undergrowth around the path."""

    per_m2: float
    """Plants per square meter where the layer is densest, unless set by the forest."""
    reach_m: float
    """Largest distance from the path (m); smaller plants are not visible farther away."""
    clearance_m: float
    """Smallest distance from the path (m)."""
    scale: tuple[float, float] = (0.6, 1.25)
    """Smallest and largest size, as a factor on the grown plant."""


@dataclass(frozen=True)
class Plant:
    """Kind of plant or litter in a forest."""

    name: str
    """Name for readers and for the seeds of its individuals."""
    coats: Mapping[str, Coat]
    """Look of each organ."""

    detail_distance: ClassVar[float] = 1.0
    """Factor on the distances at which it gets coarser."""
    leaves_from_m = 0.0
    """Height of the lowest leaves above the ground (m)."""
    lies = False
    """True if it follows the slope of the ground instead of standing upright."""

    def part(self, organ: str) -> str:
        """Name of an organ's material, such as "beech bark"."""
        return f"{self.name} {organ}".strip()


@dataclass(frozen=True)
class Woody(Plant):
    """Tree or bush."""

    shape: Species
    """Species from which it grows."""
    layer: Layer | None = None
    """Its layer in the undergrowth."""

    @property
    def leaves_from_m(self) -> float:  # type: ignore[override]
        """Height of the lowest branches (m)."""
        return self.shape.crown.base * self.shape.height_m


@dataclass(frozen=True)
class Small(Plant):
    """Plant of the forest floor, or litter."""

    layer: Layer
    drawn: Callable[[LodLevel, np.random.Generator], Organs]
    """Organs of an individual at a level of detail; the same individual for the same generator."""
    lies: bool = False

    detail_distance = 0.4


_MOSS = Coat((reflectance_of("moss * 0.15"), reflectance_of("moss * 0.75")), "moss")


def _woody(name: str, entry: Mapping[str, Any]) -> Woody:
    """Return a tree or bush of the table, with the scale of its leaves applied."""
    leaf = dict(entry["shape"]["foliage"])
    scale = leaf.pop("scale", 1.0)
    leaf |= {length: scale * leaf[length] for length in ("length_m", "width_m")}
    shape = Species.model_validate({**entry["shape"], "foliage": leaf})
    light, dark = map(reflectance_of, entry["bark"])
    shade, sun = map(leaf_of, entry["leaf"])
    layer = Layer(**entry["layer"]) if entry.get("layer") else None
    blade = Coat.of_leaves(shade, sun, shape.foliage.blade)
    coats = {"bark": Coat((light, dark), shape.bark), "leaf": blade, "moss": _MOSS}
    return Woody(name, coats, shape, layer)


_TABLE = strict_yaml.load(Path(__file__).with_name("flora.yaml").read_text("utf-8"))
_WOODY = [_woody(name, entry) for name, entry in _TABLE.items()]
TREES = {plant.name: plant for plant in _WOODY if plant.layer is None}
"""Species for the mix of a stand, by name."""
BUSHES = {plant.name: plant for plant in _WOODY if plant.layer}
"""Bushes and saplings, by name."""


LITTER = "litter"
"""Small plant that stands for loose fallen leaves."""

Draw = Callable[[LodLevel, np.random.Generator], Organs]


def _merged(parts: Organs, lod: LodLevel, rng: np.random.Generator) -> Organs:
    if lod.merged_small == 1:
        return parts
    return {organ: merged_leaves(part, lod.merged_small, rng) for organ, part in parts.items()}


def _leaves(grow: Callable[[np.random.Generator], Surface]) -> Draw:
    return lambda lod, rng: _merged({"leaf": grow(rng)}, lod, rng)


def _grass(lod: LodLevel, rng: np.random.Generator) -> Organs:
    return {"leaf": undergrowth.grow_grass(rng, lod.merged_small)}


def _flower(lod: LodLevel, rng: np.random.Generator) -> Organs:
    leaves, petals = undergrowth.grow_flowers(rng)
    return _merged({"leaf": leaves, "petal": petals}, lod, rng)


def _log(lod: LodLevel, rng: np.random.Generator) -> Organs:
    bark, ends = undergrowth.grow_log(rng, lod.sides // 2)
    return {"bark": bark, "wood": ends}


def _rock(lod: LodLevel, rng: np.random.Generator) -> Organs:
    return {"": grow_rock(rng, lod.sides)}


def _coat(first: str, second: str, texture: str = "leaf") -> Coat:
    return Coat((reflectance_of(first), reflectance_of(second)), texture)


def _leaf(dark: str, light: str) -> Coat:
    return Coat.of_leaves(leaf_of(dark), leaf_of(light), "leaf")


_HERB = _leaf("leaf dark", "young leaf dark")
_FERN = _leaf("young leaf dark * 0.9", "young leaf light")
_BILBERRY = _leaf("leaf dark * 0.9", "leaf light")
_GRASS = _leaf("grass dark", "grass light")
_MOSSY_BARK = _coat("spruce bark dark * 1.5", "moss * 0.8", "mossy")
_PETAL = _coat("violet petal * 0.6", "violet petal")
_LITTER = _coat("soil * 1.6", "litter * 0.8")
_LOG = {"bark": _MOSSY_BARK, "wood": _coat("fresh wood", "fresh wood * 0.5", "smooth")}
_STONE = _coat("stone dark * 0.9", "moss * 0.8", "stone")

_SMALL = (
    Small("fern", {"leaf": _FERN}, Layer(0.55, 30, 0.9), _leaves(undergrowth.grow_fern)),
    Small("bilberry", {"leaf": _BILBERRY}, Layer(0.3, 22, 0.6), _leaves(undergrowth.grow_bilberry)),
    Small("grass", {"leaf": _GRASS}, Layer(4.0, 30, 0.35), _grass),
    Small("herb", {"leaf": _HERB}, Layer(1.4, 18, 0.3), _leaves(undergrowth.grow_herbs)),
    Small("flower", {"leaf": _HERB, "petal": _PETAL}, Layer(0.15, 18, 0.3), _flower),
    Small(
        LITTER, {"leaf": _LITTER}, Layer(1.0, 9, 0.0), _leaves(undergrowth.strew_litter), lies=True
    ),
    Small("log", _LOG, Layer(0.008, 40, 2.2, (0.7, 1.1)), _log, lies=True),
    Small("rock", {"": _STONE}, Layer(0.012, 40, 1.6, (0.25, 1.6)), _rock, lies=True),
)
SMALL = {plant.name: plant for plant in _SMALL}
"""Small plants and litter, by name."""


PLANTS: Mapping[str, Woody | Small] = {**TREES, **BUSHES, **SMALL}
"""Everything that a forest may contain, by name."""
LAYERS = {name: plant.layer for name, plant in PLANTS.items() if plant.layer}
"""Places of the undergrowth, by kind."""

COVERS: Mapping[str, Coat] = {
    "litter": _coat("soil * 0.8", "litter * 0.7", "litter"),
    "meadow": _coat("soil", "grass dark * 0.6", "turf"),
    "moss": _coat("soil * 0.5", "moss * 0.7", "turf"),
    "moss patch": _coat("soil * 0.6", "moss * 0.75", "moss"),
    "trodden": _coat("soil * 0.8", "litter * 0.6", "trodden"),
}
"""Ground covers: for all of the ground, or patches and a path."""
