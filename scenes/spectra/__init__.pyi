from .airglow import AIRGLOW
from .blackbody import planckian
from .color import Bands, encode_srgb, linear_srgb
from .moonlight import MOONLIGHT
from .photometry import MAXIMUM_EFFICACY_LM_W, luminous, luminous_efficiency
from .reflectance import BARK, GROUND, LEAF, LOG, PETAL, ROCK, WOOD
from .spectrum import Spectrum, flat

__all__ = [
    "AIRGLOW",
    "BARK",
    "GROUND",
    "LEAF",
    "LOG",
    "MAXIMUM_EFFICACY_LM_W",
    "MOONLIGHT",
    "PETAL",
    "ROCK",
    "WOOD",
    "Bands",
    "Spectrum",
    "encode_srgb",
    "flat",
    "linear_srgb",
    "luminous",
    "luminous_efficiency",
    "planckian",
]
