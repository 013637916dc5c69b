"""Diffuse reflectance of the forest's surfaces, from `reflectance.yaml` and `leaves.yaml`."""

from functools import cache
from pathlib import Path

from megalopta.core import strict_yaml
from megalopta.scenes.spectra.leaves import LEAVES, leaf_of
from megalopta.scenes.spectra.spectrum import Spectrum

_TABLES = strict_yaml.load(Path(__file__).with_name("reflectance.yaml").read_text("utf-8"))
REFLECTANCES = {name: table for table in _TABLES for name in table if name != "wavelengths_nm"}
"""The table that the name of each opaque surface stands in."""


@cache
def reflectance_of(description: str) -> Spectrum:
    """Reflectance by name, as it is or scaled: "soil", "soil * 1.6"."""
    name, _, factor = description.partition(" * ")
    if factor:
        return reflectance_of(name).scaled(float(factor))
    if name in LEAVES:
        return leaf_of(name).reflectance
    table = REFLECTANCES[name]
    return Spectrum(tuple(table["wavelengths_nm"]), tuple(table[name]))
