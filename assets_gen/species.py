"""What distinguishes one species from another, as data.

Sizes describe a young mixed stand (trees of 10 to 16 m). Leaves are polygons larger than life: one
polygon of the beech, for instance, stands for the six or so leaves of its short shoot, so that a
crown of a few thousand triangles carries a plausible leaf area.
"""

from types import MappingProxyType
from typing import Annotated, Literal

from pydantic import BaseModel, Field

Positive = Annotated[float, Field(gt=0)]
Fraction = Annotated[float, Field(ge=0, le=1)]
Angle = Annotated[float, Field(ge=0, le=180)]


class Data(BaseModel, frozen=True, extra="forbid", allow_inf_nan=False):
    """Frozen parameters; unknown keys are refused."""


class Crown(Data):
    """The space that the branches may fill: a solid of revolution with irregular sides."""

    base: Fraction
    """Height of the lowest branches as a share of the tree's height."""
    radius_m: Positive
    """Largest radius (m)."""
    profile: tuple[Fraction, ...]
    """Radius at equal steps from crown base to top, as a share of the largest."""


class Colonized(Data):
    """Branches that grow toward attraction points in free space: broad-leaved trees and bushes."""

    kind: Literal["colonized"] = "colonized"
    """Growth by space colonization."""
    points: Annotated[int, Field(gt=0)]
    """Attraction points strewn into the crown (count)."""
    scaffold: Annotated[int, Field(gt=0)]
    """First-order branches that the trunk starts with (count)."""
    insertion_deg: Angle
    """Angle between trunk and first-order branch (degrees)."""
    step_m: Positive
    """Length of an internode (m)."""
    tropism: float
    """Weight of the upward pull against the pull of the attraction points (1)."""
    shoots: Annotated[int, Field(gt=0)]
    """Leafy twigs put on the thinnest branches (count)."""
    shoot_m: Positive
    """Length of a leafy twig (m)."""
    shoot_droop: float
    """How far twigs bend down: 0 straight on, 1 halfway to hanging (1)."""


class Whorled(Data):
    """Tiers of branches around a straight leader (spruces and firs)."""

    kind: Literal["whorled"] = "whorled"
    """Growth by whorls."""
    spacing_m: Positive
    """Height between tiers (m)."""
    branches: Annotated[int, Field(gt=0)]
    """Branches of one tier (count)."""
    insertion_deg: tuple[Angle, Angle]
    """Angle between trunk and branch in the lowest and in the topmost tier (degrees)."""
    droop: float
    """How far a branch sags at its middle, as a share of its length."""


class Foliage(Data):
    """Leaves, or sprays of needles, along the twigs that bear them."""

    length_m: Positive
    """Length of one leaf polygon (m)."""
    width_m: Positive
    """Width of one leaf polygon (m)."""
    widest: Fraction
    """Where along its length the leaf is widest."""
    per_m: Positive
    """Leaves per meter of bearing twig (1/m)."""
    bare: Fraction
    """Share of the twig, from its base, that bears nothing."""
    divergence_deg: Angle
    """Phyllotaxis: angle around the twig from one leaf to the next (degrees)."""
    angle_deg: Angle
    """Angle between twig and leaf (degrees)."""
    droop: float
    """Downward pull on the leaf's direction (1)."""
    tilt: Annotated[float, Field(ge=0)]
    """Random tilt of the blade against lying flat: 0 none, 1 about 45 degrees (1)."""
    fold_deg: Angle
    """How far each half of the blade is folded up along the midrib (degrees)."""
    shrink: Fraction
    """Size of the leaf at the twig's end relative to that at its base."""
    blade: Literal["leaf", "needles"]
    """Texture drawn on the polygon."""


class Species(Data):
    """Everything that is needed to grow one kind of tree or bush."""

    height_m: Positive
    """Height (m)."""
    stems: Annotated[int, Field(gt=0)] = 1
    """Stems that rise from the ground together (count)."""
    radius_m: Positive
    """Radius of the stem at 1.3 m, or at a third of the height of smaller plants (m)."""
    disused_share: Annotated[float, Field(ge=0)]
    """Old wood per meter of axis, in pipes of one living tip (1/m)."""
    wander: Fraction
    """Sideways drift of the stem as a share of its height."""
    flare: Annotated[float, Field(ge=0)]
    """Widening of the stem at the ground as a share of its radius."""
    bark: Literal["smooth", "papery", "scaly"]
    """Pattern of the bark."""
    chord_m: Positive = 0.05
    """Branches that bend and taper less than this are drawn straight (m)."""
    crown: Crown
    """Shape of the crown."""
    growth: Annotated[Colonized | Whorled, Field(discriminator="kind")]
    """How the crown is filled with branches."""
    foliage: Foliage
    """Leaves or needles."""


BEECH = Species(
    height_m=13.0,
    radius_m=0.14,
    disused_share=0.35,
    wander=0.015,
    flare=0.6,
    bark="smooth",
    chord_m=0.07,
    crown=Crown(base=0.22, radius_m=3.0, profile=(0.5, 0.9, 1.0, 0.97, 0.8, 0.5, 0.1)),
    growth=Colonized(
        points=260,
        scaffold=18,
        insertion_deg=60,
        step_m=0.36,
        tropism=0.15,
        shoots=290,
        shoot_m=0.8,
        shoot_droop=0.15,
    ),
    foliage=Foliage(
        length_m=0.22,
        width_m=0.15,
        widest=0.45,
        per_m=12,
        bare=0.12,
        divergence_deg=180,
        angle_deg=55,
        droop=0.2,
        tilt=0.45,
        fold_deg=14,
        shrink=0.8,
        blade="leaf",
    ),
)

BIRCH = Species(
    height_m=14.0,
    radius_m=0.10,
    disused_share=0.4,
    wander=0.025,
    flare=0.35,
    bark="papery",
    chord_m=0.09,
    crown=Crown(base=0.3, radius_m=2.2, profile=(0.4, 0.85, 1.0, 0.9, 0.7, 0.45, 0.1)),
    growth=Colonized(
        points=210,
        scaffold=22,
        insertion_deg=42,
        step_m=0.36,
        tropism=0.3,
        shoots=260,
        shoot_m=0.95,
        shoot_droop=0.9,
    ),
    foliage=Foliage(
        length_m=0.17,
        width_m=0.14,
        widest=0.35,
        per_m=12,
        bare=0.15,
        divergence_deg=137.5,
        angle_deg=60,
        droop=0.9,
        tilt=1.0,
        fold_deg=8,
        shrink=0.9,
        blade="leaf",
    ),
)

SPRUCE = Species(
    height_m=15.0,
    radius_m=0.13,
    disused_share=0.25,
    wander=0.006,
    flare=0.5,
    bark="scaly",
    crown=Crown(base=0.2, radius_m=2.5, profile=(0.75, 1.0, 0.95, 0.8, 0.6, 0.38, 0.12)),
    growth=Whorled(spacing_m=0.45, branches=5, insertion_deg=(102, 45), droop=0.12),
    foliage=Foliage(
        length_m=0.38,
        width_m=0.10,
        widest=0.35,
        per_m=16,
        bare=0.12,
        divergence_deg=180,
        angle_deg=58,
        droop=0.35,
        tilt=0.5,
        fold_deg=20,
        shrink=0.35,
        blade="needles",
    ),
)

HAZEL = Species(
    height_m=2.6,
    stems=6,
    radius_m=0.016,
    disused_share=0.2,
    wander=0.08,
    flare=0.1,
    bark="smooth",
    crown=Crown(base=0.15, radius_m=1.3, profile=(0.5, 0.85, 1.0, 0.9, 0.5)),
    growth=Colonized(
        points=60,
        scaffold=2,
        insertion_deg=35,
        step_m=0.22,
        tropism=0.3,
        shoots=95,
        shoot_m=0.4,
        shoot_droop=0.2,
    ),
    foliage=Foliage(
        length_m=0.15,
        width_m=0.12,
        widest=0.5,
        per_m=14,
        bare=0.1,
        divergence_deg=180,
        angle_deg=55,
        droop=0.3,
        tilt=0.6,
        fold_deg=12,
        shrink=0.8,
        blade="leaf",
    ),
)

YOUNG_SPRUCE = SPRUCE.model_copy(
    update={
        "height_m": 4.5,
        "radius_m": 0.05,
        "crown": Crown(base=0.04, radius_m=1.3, profile=(1.0, 0.85, 0.65, 0.42, 0.1)),
        "growth": Whorled(spacing_m=0.36, branches=5, insertion_deg=(88, 45), droop=0.1),
        "foliage": SPRUCE.foliage.model_copy(
            update={"length_m": 0.36, "width_m": 0.13, "per_m": 10}
        ),
    }
)

TREES = MappingProxyType({"beech": BEECH, "birch": BIRCH, "spruce": SPRUCE})
"""Species that a stand can be mixed from, by name."""

BUSHES = MappingProxyType({"hazel": HAZEL, "young spruce": YOUNG_SPRUCE})
"""Woody undergrowth, by name."""


def coarsened(species: Species, factor: float) -> Species:
    """Return the species with `factor` leaves merged into one, on fewer twigs.

    Leaf area, height and crown stay; for plants that are seen from afar.
    """
    growth, foliage = species.growth, species.foliage
    size = factor**0.5
    leaf = {"length_m": foliage.length_m * size, "width_m": foliage.width_m * size}
    if isinstance(growth, Whorled):
        growth = growth.model_copy(update={"spacing_m": growth.spacing_m * size})
        leaf = {
            "per_m": foliage.per_m / size,
            "length_m": foliage.length_m * factor**0.15,
            "width_m": foliage.width_m * factor**0.85,
        }
    else:
        fewer = {
            "points": max(round(growth.points / factor), 4),
            "shoots": max(round(growth.shoots / factor), 6),
            "step_m": growth.step_m * factor**0.2,
        }
        growth = growth.model_copy(update=fewer)
    return species.model_copy(
        update={
            "growth": growth,
            "foliage": foliage.model_copy(update=leaf),
            "chord_m": species.chord_m * size,
            "stems": max(round(species.stems / size), 1),
        }
    )
