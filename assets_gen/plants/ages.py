"""Younger and older plants of a species, by the share of its height that they have reached.

Trees are not copies of each other at another scale: stems thicken faster than they rise (elastic
similarity gives radius ∝ height^1.5, McMahon 1973, Science 179:1201), and number of twigs goes with
the crown's surface. The young keep their lower branches.
"""

from megalopta.assets_gen.plants.species import BarkRelief, Colonized, Fronded, Species

FEWEST_POINTS, FEWEST_SHOOTS, FEWEST_SCAFFOLD = 30, 30, 6


def aged(species: Species, share: float) -> Species:
    """Return the species when its height is a share of that which it says."""
    if share == 1:
        return species
    crown = species.crown
    return species.model_copy(
        update={
            "height_m": share * species.height_m,
            "radius_m": share**1.5 * species.radius_m,
            "crown": crown.model_copy(
                update={
                    "radius_m": share**0.9 * crown.radius_m,
                    "base": min(crown.base * (0.5 + 0.5 * share), 0.9),
                }
            ),
            "growth": _growth(species, share),
            "relief": _relief(species, share),
        }
    )


def _relief(species: Species, share: float) -> BarkRelief | None:
    if species.relief is None:
        return None
    return species.relief.model_copy(update={"depth_m": share**1.5 * species.relief.depth_m})


def _growth(species: Species, share: float) -> object:
    growth = species.growth
    if isinstance(growth, Colonized):
        return growth.model_copy(
            update={
                "points": max(round(share**2 * growth.points), FEWEST_POINTS),
                "scaffold": max(round(share * growth.scaffold), FEWEST_SCAFFOLD),
                "shoots": max(round(share**2 * growth.shoots), FEWEST_SHOOTS),
            }
        )
    if isinstance(growth, Fronded):
        return growth.model_copy(update={"frond_m": share**0.5 * growth.frond_m})
    return growth
