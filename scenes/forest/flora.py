"""The trees and bushes that grow in our forests, from the table `flora.yaml`."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from megalopta.assets_gen.plants.species import Species
from megalopta.core import strict_yaml
from megalopta.scenes.forest.plants import Layer, Woody, by_name
from megalopta.scenes.spectra.leaves import leaf_of
from megalopta.scenes.spectra.reflectance import reflectance_of


def _woody(name: str, entry: Mapping[str, Any]) -> Woody:
    leaf = dict(entry["shape"]["foliage"])
    scale = leaf.pop("scale", 1.0)
    leaf |= {length: scale * leaf[length] for length in ("length_m", "width_m")}
    shape = Species.model_validate({**entry["shape"], "foliage": leaf})
    light, dark = map(reflectance_of, entry["bark"])
    shade, sun = map(leaf_of, entry["leaf"])
    layer = Layer(**entry["layer"]) if "layer" in entry else None
    return Woody(name, shape, (light, dark), (shade, sun), layer)


_TABLE = strict_yaml.load(Path(__file__).with_name("flora.yaml").read_text("utf-8"))
_ALL = [_woody(name, entry) for name, entry in _TABLE.items()]

TREES = by_name(*(plant for plant in _ALL if plant.layer is None))
"""Species that a stand can be mixed from, by name."""

BUSHES = by_name(*(plant for plant in _ALL if plant.layer))
"""Bushes and saplings, by name."""
