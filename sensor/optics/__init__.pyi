from .efficiency import (
    Efficiency as Efficiency,
    band_efficiency as band_efficiency,
    band_transmission as band_transmission,
)
from .efficiency_file import (
    with_curve as with_curve,
    with_transmission as with_transmission,
)
from .lens import (
    Lens as Lens,
    blurred as blurred,
    check_bands as check_bands,
    falloff as falloff,
    image_irradiance as image_irradiance,
    photon_flux as photon_flux,
)
from .pixels import (
    PixelOptics as PixelOptics,
    check_brightness as check_brightness,
    detected_rate as detected_rate,
    photon_rate as photon_rate,
)
from .transmission import Transmission as Transmission
