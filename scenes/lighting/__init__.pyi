from .cloudy_sky import under_clouds
from .levels import LEVELS, Level, Light, illuminance_of

__all__ = [
    "LEVELS",
    "Level",
    "Light",
    "illuminance_of",
    "under_clouds",
]
