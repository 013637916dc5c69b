from .cloudy_sky import under_clouds as under_clouds
from .levels import (
    LEVELS as LEVELS,
    Level as Level,
    Light as Light,
    illuminance_of as illuminance_of,
)
