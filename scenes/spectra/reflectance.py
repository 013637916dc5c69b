"""Reflectance of the forest's surfaces, and transmittance of leaves, by name."""

from functools import cache
from pathlib import Path
from typing import NamedTuple

from megalopta.core import strict_yaml
from megalopta.scenes.spectra.spectrum import Spectrum

TABLE = Path(__file__).with_name("leaves.yaml")
_ENTRIES = strict_yaml.load(TABLE.read_text("utf-8"))
LEAVES = tuple(_ENTRIES)
"""Names of all leaves."""


class Leaf(NamedTuple):
    """Diffuse reflectance and transmittance of a blade, equal on both sides."""

    reflectance: Spectrum
    transmittance: Spectrum

    def scaled(self, factor: float) -> "Leaf":
        """Return a leaf darkened by a factor on both sides."""
        return Leaf(self.reflectance.scaled(factor), self.transmittance.scaled(factor))


@cache
def leaf_of(description: str) -> Leaf:
    """Leaf by name, optionally darkened: "needle", "needle * 0.6"."""
    name, _, factor = description.partition(" * ")
    if factor:
        return leaf_of(name).scaled(float(factor))
    entry = _ENTRIES[name]
    wavelengths = tuple(entry["wavelengths_nm"])
    return Leaf(*(Spectrum(wavelengths, tuple(entry[part])) for part in Leaf._fields))


_TABLES = strict_yaml.load(Path(__file__).with_name("reflectance.yaml").read_text("utf-8"))
REFLECTANCES = {name: table for table in _TABLES for name in table if name != "wavelengths_nm"}
"""Table that holds each opaque surface's name."""


@cache
def reflectance_of(description: str) -> Spectrum:
    """Reflectance by name, optionally scaled: "soil", "soil * 1.6"."""
    name, _, factor = description.partition(" * ")
    if factor:
        return reflectance_of(name).scaled(float(factor))
    if name in LEAVES:
        return leaf_of(name).reflectance
    table = REFLECTANCES[name]
    return Spectrum(tuple(table["wavelengths_nm"]), tuple(table[name]))
