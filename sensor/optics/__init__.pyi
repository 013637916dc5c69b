from .efficiency import Efficiency, band_efficiency, band_transmission
from .efficiency_file import with_curve, with_transmission
from .lens import Lens, check_bands, falloff, image_irradiance, photon_flux
from .pixels import PixelOptics, check_brightness, detected_rate, photon_rate
from .transmission import Transmission

__all__ = [
    "Efficiency",
    "Lens",
    "PixelOptics",
    "Transmission",
    "band_efficiency",
    "band_transmission",
    "check_bands",
    "check_brightness",
    "detected_rate",
    "falloff",
    "image_irradiance",
    "photon_flux",
    "photon_rate",
    "with_curve",
    "with_transmission",
]
