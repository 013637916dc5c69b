from .cloudy_sky import under_clouds as under_clouds
from .components import (
    SOURCES as SOURCES,
    Component as Component,
)
from .levels import (
    LEVELS as LEVELS,
    Level as Level,
    illuminance_of as illuminance_of,
)
from .light import Light as Light
