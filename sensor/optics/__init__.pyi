from .efficiency import Efficiency, band_efficiency
from .efficiency_file import with_curve
from .lens import Lens, check_bands, falloff, image_irradiance, photon_flux

__all__ = [
    "Efficiency",
    "Lens",
    "band_efficiency",
    "check_bands",
    "falloff",
    "image_irradiance",
    "photon_flux",
    "with_curve",
]
