from .airglow import AIRGLOW as AIRGLOW
from .blackbody import planckian as planckian
from .color import (
    Bands as Bands,
    decode_srgb as decode_srgb,
    encode_srgb as encode_srgb,
    linear_srgb as linear_srgb,
)
from .leaves import (
    Leaf as Leaf,
    leaf_of as leaf_of,
)
from .moonlight import MOONLIGHT as MOONLIGHT
from .photometry import (
    MAXIMUM_EFFICACY_LM_W as MAXIMUM_EFFICACY_LM_W,
    luminous as luminous,
    luminous_efficiency as luminous_efficiency,
)
from .reflectance import reflectance_of as reflectance_of
from .spectrum import (
    Spectrum as Spectrum,
    flat as flat,
)
