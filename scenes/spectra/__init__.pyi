from .airglow import (
    AIRGLOW as AIRGLOW,
    FAINT_STARLIGHT as FAINT_STARLIGHT,
    MOONLESS_ZENITH as MOONLESS_ZENITH,
)
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
from .moonlight import (
    FULL_MOON as FULL_MOON,
    QUARTER_MOON as QUARTER_MOON,
    moonlit as moonlit,
)
from .overcast import (
    OVERCAST as OVERCAST,
    overcast_share as overcast_share,
)
from .photometry import (
    MAXIMUM_EFFICACY_LM_W as MAXIMUM_EFFICACY_LM_W,
    luminous as luminous,
    luminous_efficiency as luminous_efficiency,
)
from .primaries import (
    LUMINANCE_SHARES as LUMINANCE_SHARES,
    primaries as primaries,
)
from .reflectance import reflectance_of as reflectance_of
from .spectrum import (
    Spectrum as Spectrum,
    flat as flat,
    total as total,
)
from .starlight import STARLIGHT as STARLIGHT
from .sunlight import (
    ABOVE_ATMOSPHERE as ABOVE_ATMOSPHERE,
    CLEAR_SKY as CLEAR_SKY,
    SUN as SUN,
)
from .twilight import TWILIGHT as TWILIGHT
