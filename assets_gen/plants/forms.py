"""The axes of any plant, by the form of its growth."""

import numpy as np

from megalopta.assets_gen.plants.branching import Branching, grow_colonized, grow_whorled
from megalopta.assets_gen.plants.fronds import grow_fronded
from megalopta.assets_gen.plants.lianas import grow_climbing
from megalopta.assets_gen.plants.species import Climbing, Colonized, Fronded, Species


def grow_axes(species: Species, rng: np.random.Generator) -> Branching:
    """Return the axes of one plant; the stem's foot is at the origin."""
    growth = species.growth
    if isinstance(growth, Colonized):
        return grow_colonized(species, growth, rng)
    if isinstance(growth, Fronded):
        return grow_fronded(species, growth, rng)
    if isinstance(growth, Climbing):
        return grow_climbing(species, growth, rng)
    return grow_whorled(species, growth, rng)
