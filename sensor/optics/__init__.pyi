from .efficiency import Efficiency, band_efficiency
from .efficiency_file import with_curve
from .lens import Lens, check_bands, falloff, image_irradiance, photon_flux
from .pixels import PixelOptics, check_brightness, detected_rate, photon_rate

__all__ = [
    "Efficiency",
    "Lens",
    "PixelOptics",
    "band_efficiency",
    "check_bands",
    "check_brightness",
    "detected_rate",
    "falloff",
    "image_irradiance",
    "photon_flux",
    "photon_rate",
    "with_curve",
]
