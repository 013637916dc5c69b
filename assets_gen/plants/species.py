"""Parameters of species, and of younger and older plants.

Plants of different ages have a share of their species' height. Trees are not scaled copies of each
other: stems thicken faster than they rise (elastic similarity gives radius ∝ height^1.5, McMahon
1973, Science 179:1201), and the number of twigs is proportional to the crown's surface. Young trees
keep their lower branches.
"""

from typing import Annotated, Literal

from pydantic import Field

from megalopta.core.record import Record

Positive = Annotated[float, Field(gt=0)]
Fraction = Annotated[float, Field(ge=0, le=1)]
Angle = Annotated[float, Field(ge=0, le=180)]


class Crown(Record, frozen=True):
    """Space that the branches may fill: a solid of revolution with irregular sides."""

    base: Fraction
    """Height of the lowest branches, relative to the tree's height."""
    radius_m: Positive
    """Largest radius (m)."""
    profile: tuple[Fraction, ...]
    """Radius at equal steps from crown base to top, relative to the largest."""


class Colonized(Record, frozen=True):
    """Branches that grow toward attraction points in free space: broad-leaved trees and bushes."""

    kind: Literal["colonized"] = "colonized"
    points: Annotated[int, Field(gt=0)]
    """Attraction points scattered in the crown (count)."""
    scaffold: Annotated[int, Field(gt=0)]
    """First-order branches of the initial trunk (count)."""
    insertion_deg: Angle
    """Angle between trunk and first-order branch (degrees)."""
    step_m: Positive
    """Length of an internode (m)."""
    tropism: float
    """Weight of the upward pull relative to the pull of the attraction points (1)."""
    shoots: Annotated[int, Field(gt=0)]
    """Leafy twigs added to the thinnest branches (count)."""
    shoot_m: Positive
    """Length of a leafy twig (m)."""
    shoot_droop: float
    """Downward bend of twigs: 0 straight, 1 halfway to hanging (1)."""


class Whorled(Record, frozen=True):
    """Tiers of branches around a straight leader (spruces and firs)."""

    kind: Literal["whorled"] = "whorled"
    spacing_m: Positive
    """Height between tiers (m)."""
    branches: Annotated[int, Field(gt=0)]
    """Branches of one tier (count)."""
    insertion_deg: tuple[Angle, Angle]
    """Angle between trunk and branch in the lowest and in the topmost tier (degrees)."""
    droop: float
    """Sag of a branch at its middle, relative to its length."""


class Fronded(Record, frozen=True):
    """Tuft of fronds at the end of each stem: palms and tree ferns."""

    kind: Literal["fronded"] = "fronded"
    fronds: Annotated[int, Field(gt=0)]
    """Fronds of one stem (count)."""
    frond_m: Positive
    """Length of the longest frond (m)."""
    raised_deg: tuple[Annotated[float, Field(ge=-90, le=90)], Angle]
    """Elevations at which the oldest and the youngest frond leave the stem (degrees)."""
    bend: float
    """Downward bend of a frond toward its tip: 1 is about a right angle (1)."""


class Climbing(Record, frozen=True):
    """Ropes that hang and climb between the ground and the crowns: lianas."""

    kind: Literal["climbing"] = "climbing"
    reach_m: Positive
    """Largest sideways distance of a rope (m)."""
    shoots: Annotated[int, Field(gt=0)]
    """Leafy twigs of one rope (count)."""
    shoot_m: Positive
    """Length of a leafy twig (m)."""


class Buttresses(Record, frozen=True):
    """Thin walls of wood that extend from the stem along its roots."""

    count: Annotated[int, Field(ge=2, le=8)]
    """Walls around the stem (count)."""
    height_m: Positive
    """Height at which their reach has fallen to 1/e (m)."""
    reach: Positive
    """Reach at the ground, relative to the stem's radius there."""


class Twigs(Record, frozen=True):
    """Side twigs, too thin to be drawn, that carry the leaves in clumps."""

    per_m: Positive
    """Twigs per meter of the axis that bears them (1/m)."""
    length_m: Positive
    """Length of one twig (m)."""
    angle_deg: Angle
    """Angle between axis and twig (degrees)."""
    droop: float
    """Downward pull on the twig's direction (1)."""


class Foliage(Record, frozen=True):
    """Leaves, or sprays of needles, along the twigs that bear them."""

    length_m: Positive
    """Length of one leaf polygon (m)."""
    width_m: Positive
    """Width of one leaf polygon (m)."""
    widest: Fraction
    """Position of the widest part along the leaf's length."""
    per_m: Positive
    """Leaves per meter of bearing twig (1/m)."""
    bare: Fraction
    """Share of the twig, from its base, without leaves."""
    divergence_deg: Angle
    """Phyllotaxis: angle around the twig between successive leaves (degrees)."""
    angle_deg: Angle
    """Angle between twig and leaf (degrees)."""
    droop: float
    """Downward pull on the leaf's direction (1)."""
    tilt: Annotated[float, Field(ge=0)]
    """Random tilt of the blade from horizontal: 0 none, 1 about 45 degrees (1)."""
    fold_deg: Angle
    """Angle by which each half of the blade is folded up along the midrib (degrees)."""
    shrink: Fraction
    """Size of the leaf at the twig's end, relative to that at its base."""
    blade: Literal["leaf", "needles"]
    """Texture drawn on the polygon."""
    twigs: Twigs | None = None
    """Side twigs that bear the leaves; null: the axes bear them."""


class BarkRelief(Record, frozen=True):
    """Furrows in the bark of a stem."""

    pattern: Literal["papery", "plated", "ridged", "scaly"]
    """Pattern of the carved bark."""
    depth_m: Annotated[float, Field(gt=0, le=0.1)]
    """Typical depth of the furrows of a grown stem (m)."""


class Species(Record, frozen=True):
    """Parameters of one kind of tree or bush."""

    height_m: Positive
    """Height (m)."""
    stems: Annotated[int, Field(gt=0)] = 1
    """Number of stems from the ground (count)."""
    radius_m: Positive
    """Radius of the stem at 1.3 m, or at a third of the height of smaller plants (m)."""
    disused_share: Annotated[float, Field(ge=0)]
    """Old wood per meter of axis, in pipes of one living tip (1/m)."""
    wander: Fraction
    """Sideways drift of the stem, relative to its height."""
    flare: Annotated[float, Field(ge=0)]
    """Widening of the stem at the ground, relative to its radius."""
    bark: Literal["furrowed", "papery", "scaly", "smooth"]
    """Pattern of the bark."""
    relief: BarkRelief | None = None
    """Relief carved into the bark of a stem; null: smooth."""
    chord_m: Positive = 0.05
    """Bend and taper below which branches are drawn straight (m)."""
    crown: Crown
    """Shape of the crown."""
    buttresses: Buttresses | None = None
    """Walls at the foot of the stem; null: none."""
    growth: Annotated[Colonized | Whorled | Fronded | Climbing, Field(discriminator="kind")]
    """Growth form that fills the crown with branches."""
    foliage: Foliage
    """Leaves or needles."""


def aged(species: Species, share: float) -> Species:
    """Return the species at a share of its full height."""
    if share == 1:
        return species
    crown, growth, relief = species.crown, species.growth, species.relief
    base = min(crown.base * (0.5 + 0.5 * share), 0.9)
    if isinstance(growth, Colonized):
        numbers = {
            "points": max(round(share**2 * growth.points), 30),
            "scaffold": max(round(share * growth.scaffold), 6),
            "shoots": max(round(share**2 * growth.shoots), 30),
        }
        growth = growth.model_copy(update=numbers)
    elif isinstance(growth, Fronded):
        growth = growth.model_copy(update={"frond_m": share**0.5 * growth.frond_m})
    wide = {"radius_m": share**0.9 * crown.radius_m, "base": base}
    changes = {
        "height_m": share * species.height_m,
        "radius_m": share**1.5 * species.radius_m,
        "crown": crown.model_copy(update=wide),
        "growth": growth,
    }
    if relief:
        changes["relief"] = relief.model_copy(update={"depth_m": share**1.5 * relief.depth_m})
    return species.model_copy(update=changes)
