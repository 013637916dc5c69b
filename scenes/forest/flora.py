"""The trees and bushes that grow in our forests, as data: shape, spectra, where bushes stand.

Sizes describe a young mixed stand (trees of 10 to 16 m). Leaves are polygons larger than life: one
polygon of the beech, for instance, stands for the six or so leaves of its short shoot, so that a
crown of a few thousand triangles carries a plausible leaf area.
"""

from megalopta.assets_gen.plants import Colonized, Crown, Foliage, Species, Whorled
from megalopta.scenes.forest.plants import Layer, Woody, by_name
from megalopta.scenes.spectra import reflectance as spectra

BEECH = Woody(
    "beech",
    Species(
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
    ),
    bark=(spectra.BEECH_BARK_LIGHT, spectra.BEECH_BARK_DARK),
    leaf=(spectra.LEAF_DARK, spectra.LEAF_LIGHT),
)

BIRCH = Woody(
    "birch",
    Species(
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
    ),
    bark=(spectra.BIRCH_BARK_LIGHT, spectra.BIRCH_BARK_DARK),
    leaf=(spectra.LEAF_DARK.scaled(1.1), spectra.LEAF_LIGHT.scaled(1.1)),
)

SPRUCE = Woody(
    "spruce",
    Species(
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
    ),
    bark=(spectra.SPRUCE_BARK_LIGHT, spectra.SPRUCE_BARK_DARK),
    leaf=(spectra.NEEDLE_DARK, spectra.NEEDLE_LIGHT),
)

OAK = Woody(
    "oak",
    Species(
        height_m=12.5,
        radius_m=0.19,
        disused_share=0.45,
        wander=0.05,
        flare=0.7,
        bark="furrowed",
        chord_m=0.06,
        crown=Crown(base=0.24, radius_m=3.9, profile=(0.5, 0.85, 1.0, 1.0, 0.9, 0.65, 0.25)),
        growth=Colonized(
            points=280,
            scaffold=11,
            insertion_deg=68,
            step_m=0.42,
            tropism=0.05,
            shoots=300,
            shoot_m=0.7,
            shoot_droop=0.05,
        ),
        foliage=Foliage(
            length_m=0.24,
            width_m=0.17,
            widest=0.62,
            per_m=12,
            bare=0.15,
            divergence_deg=137.5,
            angle_deg=50,
            droop=0.1,
            tilt=0.8,
            fold_deg=12,
            shrink=1.0,
            blade="leaf",
        ),
    ),
    bark=(spectra.BEECH_BARK_LIGHT.scaled(0.75), spectra.BEECH_BARK_DARK.scaled(0.6)),
    leaf=(spectra.LEAF_DARK.scaled(0.85), spectra.LEAF_LIGHT.scaled(0.85)),
)

ASPEN = Woody(
    "aspen",
    Species(
        height_m=15.0,
        radius_m=0.12,
        disused_share=0.4,
        wander=0.012,
        flare=0.3,
        bark="smooth",
        chord_m=0.08,
        crown=Crown(base=0.42, radius_m=2.1, profile=(0.55, 0.9, 1.0, 0.9, 0.7, 0.4, 0.1)),
        growth=Colonized(
            points=200,
            scaffold=18,
            insertion_deg=48,
            step_m=0.38,
            tropism=0.3,
            shoots=230,
            shoot_m=0.75,
            shoot_droop=0.15,
        ),
        foliage=Foliage(
            length_m=0.17,
            width_m=0.17,
            widest=0.4,
            per_m=14,
            bare=0.2,
            divergence_deg=137.5,
            angle_deg=65,
            droop=0.7,
            tilt=1.5,
            fold_deg=6,
            shrink=0.9,
            blade="leaf",
        ),
    ),
    bark=(spectra.BEECH_BARK_LIGHT.scaled(1.15), spectra.BEECH_BARK_DARK),
    leaf=(spectra.LEAF_DARK.scaled(1.05), spectra.LEAF_LIGHT.scaled(1.05)),
)

PINE = Woody(
    "pine",
    Species(
        height_m=15.0,
        radius_m=0.15,
        disused_share=0.5,
        wander=0.02,
        flare=0.3,
        bark="scaly",
        chord_m=0.06,
        crown=Crown(base=0.55, radius_m=2.5, profile=(0.55, 0.9, 1.0, 0.95, 0.8, 0.45)),
        growth=Colonized(
            points=130,
            scaffold=14,
            insertion_deg=72,
            step_m=0.42,
            tropism=0.15,
            shoots=190,
            shoot_m=0.5,
            shoot_droop=-0.3,
        ),
        foliage=Foliage(
            length_m=0.3,
            width_m=0.1,
            widest=0.55,
            per_m=34,
            bare=0.35,
            divergence_deg=137.5,
            angle_deg=42,
            droop=0.0,
            tilt=1.2,
            fold_deg=15,
            shrink=0.85,
            blade="needles",
        ),
    ),
    bark=(spectra.PINE_BARK_LIGHT, spectra.SPRUCE_BARK_DARK.scaled(1.4)),
    leaf=(spectra.NEEDLE_DARK.scaled(1.1), spectra.NEEDLE_LIGHT.scaled(1.1)),
)

HAZEL = Woody(
    "hazel",
    Species(
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
    ),
    bark=(spectra.BEECH_BARK_LIGHT.scaled(0.7), spectra.BEECH_BARK_DARK),
    leaf=(spectra.LEAF_DARK, spectra.LEAF_LIGHT),
    layer=Layer(0.04, 40, 3.0),
)

YOUNG_SPRUCE = Woody(
    "young spruce",
    SPRUCE.shape.model_copy(
        update={
            "height_m": 4.5,
            "radius_m": 0.05,
            "crown": Crown(base=0.04, radius_m=1.3, profile=(1.0, 0.85, 0.65, 0.42, 0.1)),
            "growth": Whorled(spacing_m=0.36, branches=5, insertion_deg=(88, 45), droop=0.1),
            "foliage": SPRUCE.shape.foliage.model_copy(
                update={"length_m": 0.36, "width_m": 0.13, "per_m": 10}
            ),
        }
    ),
    bark=(spectra.SPRUCE_BARK_LIGHT, spectra.SPRUCE_BARK_DARK),
    leaf=(spectra.NEEDLE_DARK, spectra.NEEDLE_LIGHT.scaled(1.15)),
    layer=Layer(0.02, 40, 3.5),
)


def _sapling(
    tree: Species, height_m: float, radius_m: float, crown: Crown, growth: Colonized
) -> Species:
    """Return a tree in its first years, with the leaves of a grown one but a little smaller."""
    leaf = {"length_m": 0.75 * tree.foliage.length_m, "width_m": 0.75 * tree.foliage.width_m}
    return tree.model_copy(
        update={
            "height_m": height_m,
            "radius_m": radius_m,
            "wander": 0.03,
            "flare": 0.1,
            "chord_m": 0.03,
            "crown": crown,
            "growth": growth,
            "foliage": tree.foliage.model_copy(update=leaf),
        }
    )


YOUNG_BEECH = Woody(
    "young beech",
    _sapling(
        BEECH.shape,
        3.2,
        0.018,
        Crown(base=0.22, radius_m=1.2, profile=(0.5, 0.9, 1.0, 0.75, 0.3)),
        Colonized(
            points=45,
            scaffold=10,
            insertion_deg=65,
            step_m=0.22,
            tropism=0.05,
            shoots=70,
            shoot_m=0.42,
            shoot_droop=0.1,
        ),
    ),
    bark=(spectra.BEECH_BARK_LIGHT.scaled(0.8), spectra.BEECH_BARK_DARK),
    leaf=(spectra.LEAF_DARK.scaled(1.1), spectra.LEAF_LIGHT.scaled(1.15)),
    layer=Layer(0.02, 40, 2.5),
)

YOUNG_BIRCH = Woody(
    "young birch",
    _sapling(
        BIRCH.shape,
        3.8,
        0.02,
        Crown(base=0.2, radius_m=0.8, profile=(0.6, 1.0, 0.9, 0.6, 0.2)),
        Colonized(
            points=40,
            scaffold=12,
            insertion_deg=42,
            step_m=0.24,
            tropism=0.35,
            shoots=60,
            shoot_m=0.45,
            shoot_droop=0.3,
        ),
    ),
    bark=(spectra.BEECH_BARK_LIGHT.scaled(0.6), spectra.BEECH_BARK_DARK.scaled(0.7)),
    leaf=(spectra.LEAF_DARK.scaled(1.1), spectra.LEAF_LIGHT.scaled(1.15)),
    layer=Layer(0.01, 40, 2.5),
)

TREES = by_name(ASPEN, BEECH, BIRCH, OAK, PINE, SPRUCE)
"""Species that a stand can be mixed from, by name."""

BUSHES = by_name(HAZEL, YOUNG_BEECH, YOUNG_BIRCH, YOUNG_SPRUCE)
"""Bushes and saplings, by name."""
