"""Everything that describes one image sensor, as plain frozen data."""

from typing import Annotated

from pydantic import BaseModel, Field

from megalopta.sensor.counter import LARGEST_CAPACITY
from megalopta.sensor.dark_counts import DarkCounts
from megalopta.sensor.dead_time import DeadTime
from megalopta.sensor.efficiency import Efficiency
from megalopta.sensor.optics import Lens


class Sensor(
    BaseModel, frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True
):
    """A single-photon image sensor behind a lens; the number of pixels is that of the image."""

    name: Annotated[str, Field(min_length=1)]
    """What the sensor is called in files and reports."""
    source: str = ""
    """Where its figures come from."""
    pitch_m: Annotated[float, Field(gt=0)]
    """Distance between the centers of neighboring pixels (m); a pixel is pitch × pitch."""
    fill_factor: Annotated[float, Field(gt=0, le=1)]
    """Light-sensitive fraction of the pixel's area (0 to 1)."""
    exposure_s: Annotated[float, Field(gt=0)]
    """Time during which events are counted for one frame (s)."""
    lens: Lens = Lens()
    """The lens in front of it."""
    efficiency: Efficiency
    """Photon detection efficiency of the light-sensitive area over wavelength."""
    dark_counts: DarkCounts = DarkCounts()
    """Events without light; off by default."""
    dead_time: DeadTime = DeadTime()
    """Recovery after an event; none by default."""
    counter_capacity: Annotated[int, Field(ge=1, le=LARGEST_CAPACITY)] = LARGEST_CAPACITY
    """Largest count a pixel can hold (counts); a pixel that reaches it is flagged as saturated."""
    device_seed: int = 0
    """Which device of this kind: fixes the pattern of dark counts (any integer, 0 included)."""

    @property
    def pixel_area_m2(self) -> float:
        """Area of a whole pixel, m²."""
        return self.pitch_m**2

    @property
    def active_area_m2(self) -> float:
        """Light-sensitive area of a pixel, m²."""
        return self.pixel_area_m2 * self.fill_factor
