"""Plants and litter of a forest, from the table `flora.yaml` and from here."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from megalopta.assets_gen import Surface
from megalopta.assets_gen.bodies import grow_rock
from megalopta.assets_gen.plants import undergrowth
from megalopta.assets_gen.plants.detail import merged_leaves
from megalopta.assets_gen.plants.species import Species
from megalopta.core import strict_yaml
from megalopta.scenes.forest.plants import (
    Coat,
    Layer,
    LodLevel,
    Organs,
    Plant,
    Small,
    Woody,
    by_name,
)
from megalopta.scenes.spectra.reflectance import leaf_of, reflectance_of


def _scaled(entry: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return an entry with the scale of its leaves applied."""
    leaf = dict(entry["shape"]["foliage"])
    scale = leaf.pop("scale", 1.0)
    leaf |= {length: scale * leaf[length] for length in ("length_m", "width_m")}
    return {**entry, "shape": {**entry["shape"], "foliage": leaf}}


def woody(name: str, entry: Mapping[str, Any]) -> Woody:
    """Return a tree or bush of an entry, as of `ENTRIES`."""
    shape = Species.model_validate(entry["shape"])
    light, dark = map(reflectance_of, entry["bark"])
    shade, sun = map(leaf_of, entry["leaf"])
    layer = Layer(**entry["layer"]) if entry.get("layer") else None
    blade = Coat.of_leaves(shade, sun, shape.foliage.blade)
    return Woody(name, {"bark": Coat((light, dark), shape.bark), "leaf": blade}, shape, layer)


_TABLE = strict_yaml.load(Path(__file__).with_name("flora.yaml").read_text("utf-8"))
ENTRIES: Mapping[str, Mapping[str, Any]] = {name: _scaled(each) for name, each in _TABLE.items()}
"""Fields of each tree and bush by name."""


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
_PETAL = _coat("white petal * 0.75", "white petal")
_LITTER = _coat("soil * 1.6", "litter")
_LOG = {"bark": _MOSSY_BARK, "wood": _coat("fresh wood", "fresh wood * 0.5", "smooth")}
_STONE = _coat("stone dark", "stone light", "stone")

SMALL: Mapping[str, Small] = by_name(
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
"""Small plants and litter, by name."""


@dataclass(frozen=True, eq=False)
class Flora:
    """Kinds of plants that a forest may contain, by name."""

    trees: Mapping[str, Woody]
    """Species for the mix of a stand."""
    bushes: Mapping[str, Woody]
    """Bushes and saplings."""

    @classmethod
    def of(cls, plants: Iterable[Woody]) -> "Flora":
        """Return the flora of some trees and bushes, with all small plants."""
        given = list(plants)
        trees = by_name(*(plant for plant in given if plant.layer is None))
        return cls(trees, by_name(*(plant for plant in given if plant.layer)))

    @cached_property
    def layers(self) -> Mapping[str, Layer]:
        """Places of the undergrowth, by kind."""
        bushes = {name: bush.layer for name, bush in self.bushes.items() if bush.layer}
        return MappingProxyType(bushes | {name: each.layer for name, each in SMALL.items()})

    @cached_property
    def plants(self) -> Mapping[str, Plant]:
        """Everything that a forest may contain."""
        return MappingProxyType({**self.trees, **self.bushes, **SMALL})


FLORA = Flora.of(woody(name, entry) for name, entry in ENTRIES.items())
"""Plants of this program."""
TREES, BUSHES, LAYERS, PLANTS = FLORA.trees, FLORA.bushes, FLORA.layers, FLORA.plants

COVERS: Mapping[str, Coat] = MappingProxyType(
    {
        "litter": _coat("soil", "litter", "litter"),
        "meadow": _coat("grass dark * 0.8", "grass light * 0.85", "turf"),
        "moss": _coat("soil * 0.5", "moss", "turf"),
        "moss patch": _coat("moss * 0.2", "moss * 0.9", "moss"),
        "trodden": _coat("soil * 0.9", "litter * 0.7", "trodden"),
    }
)
"""Ground covers: for all of the ground, or patches and a path."""
