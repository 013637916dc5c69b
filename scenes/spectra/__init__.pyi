from .airglow import AIRGLOW
from .blackbody import planckian
from .color import Bands, encode_srgb, linear_srgb
from .moonlight import MOONLIGHT
from .photometry import MAXIMUM_EFFICACY_LM_W, luminous, luminous_efficiency
from .reflectance import reflectance_of
from .spectrum import Spectrum, flat

__all__ = [
    "AIRGLOW",
    "MAXIMUM_EFFICACY_LM_W",
    "MOONLIGHT",
    "Bands",
    "Spectrum",
    "encode_srgb",
    "flat",
    "linear_srgb",
    "luminous",
    "luminous_efficiency",
    "planckian",
    "reflectance_of",
]
