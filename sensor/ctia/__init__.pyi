from .array import (
    electron_moments as electron_moments,
    expose_ctia as expose_ctia,
    expose_photocurrent as expose_photocurrent,
    photocurrent as photocurrent,
    reading_electrons as reading_electrons,
    volt_moments as volt_moments,
)
from .bias import (
    DacBias as DacBias,
    FixedBias as FixedBias,
    FloatingGateBias as FloatingGateBias,
    trimmed_bias as trimmed_bias,
)
from .calibration import (
    Measurement as Measurement,
    calibrate as calibrate,
    leak_floor as leak_floor,
)
from .integration import (
    Pixel as Pixel,
    discharge as discharge,
    discharge_time as discharge_time,
    estimate_current as estimate_current,
    gain_from_db as gain_from_db,
)
from .model import (
    CtiaSensor as CtiaSensor,
    pixels as pixels,
)
from .noise import CtiaNoise as CtiaNoise
from .photodiode import (
    Photodiode as Photodiode,
    noise_current as noise_current,
    reverse_current as reverse_current,
)
from .presets import (
    CTIA_PRESETS as CTIA_PRESETS,
    PHOTODIODES as PHOTODIODES,
    TYPICAL_OFFSET_V as TYPICAL_OFFSET_V,
    ctia_preset as ctia_preset,
)
