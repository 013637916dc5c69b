from .bark import furrowed_bark, papery_bark, scaly_bark, smooth_bark
from .branching import GOLDEN_ANGLE, UP, outward
from .detail import Detail, coarsened, merged_leaves
from .foliage import ATLAS_TILES
from .growth import grow_plant
from .logs import grow_log
from .species import Colonized, Crown, Foliage, Species, Whorled
from .tube import tube_faces
from .undergrowth import (
    grow_bilberry,
    grow_fern,
    grow_flowers,
    grow_grass,
    grow_herbs,
    strew_litter,
)

__all__ = [
    "ATLAS_TILES",
    "GOLDEN_ANGLE",
    "UP",
    "Colonized",
    "Crown",
    "Detail",
    "Foliage",
    "Species",
    "Whorled",
    "coarsened",
    "furrowed_bark",
    "grow_bilberry",
    "grow_fern",
    "grow_flowers",
    "grow_grass",
    "grow_herbs",
    "grow_log",
    "grow_plant",
    "merged_leaves",
    "outward",
    "papery_bark",
    "scaly_bark",
    "smooth_bark",
    "strew_litter",
    "tube_faces",
]
