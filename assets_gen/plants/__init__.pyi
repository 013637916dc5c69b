from .ages import aged as aged
from .bark import (
    furrowed_bark as furrowed_bark,
    papery_bark as papery_bark,
    plated_bark as plated_bark,
    ridged_bark as ridged_bark,
    scaly_bark as scaly_bark,
    smooth_bark as smooth_bark,
)
from .branching import (
    GOLDEN_ANGLE as GOLDEN_ANGLE,
    UP as UP,
    outward as outward,
)
from .detail import (
    Detail as Detail,
    coarsened as coarsened,
    merged_leaves as merged_leaves,
    some_leaves as some_leaves,
)
from .foliage import ATLAS_TILES as ATLAS_TILES
from .furrows import Furrows as Furrows
from .growth import grow_plant as grow_plant
from .logs import grow_log as grow_log
from .species import (
    BarkRelief as BarkRelief,
    Colonized as Colonized,
    Crown as Crown,
    Foliage as Foliage,
    Species as Species,
    Whorled as Whorled,
)
from .tube import tube_faces as tube_faces
from .undergrowth import (
    grow_bilberry as grow_bilberry,
    grow_fern as grow_fern,
    grow_flowers as grow_flowers,
    grow_grass as grow_grass,
    grow_herbs as grow_herbs,
    strew_litter as strew_litter,
)
