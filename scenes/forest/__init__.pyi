from .canopy import (
    PlantArea as PlantArea,
    floor_points as floor_points,
    plant_area as plant_area,
)
from .description import (
    Forest as Forest,
    build_forest as build_forest,
)
from .stand import PRESETS as PRESETS
from .sway import Sway as Sway
