"""Sensors by name, as plain data.

`ideal` has the pixel, lens and exposure of `spadcam`, so that what differs is the device alone: all
the light on the pixel is counted, nothing else is.

`spadcam` follows the device sheet of dissertation §2.4 at 13.58 V anode voltage (about 1.2 V excess
bias). Measured there: pitch, active area, dark counts of one row of 16 pixels, "peak efficiency
below 1 % at 450 nm", quenching, counter step. Chosen here, because it is not given:

- the spectral shape: absorption of silicon in 0.4 µm under a dead surface of 0.1 µm. Only the
  height at 450 nm rests on a measurement, and that is an upper limit. The motion bench of §2.4.8
  (93 nW at 700 nm, 65 counts in 0.1 s), if its beam covered 100 mm², allows 0.055 % at 700 nm where
  this curve has 0.13 %; how much light reached the chip there is not known;
- dead time 1 µs: §2.4.1 says that recovery exceeds this;
- the lens: the thesis lights the bare die;
- dark counts: five numbers of the row (mean 1.77, median 0.93, σ 1.77 Hz/µm², 11 of 16 pixels
  below 1.5, σ 0.32 among these) fix the mixture. Its bulk mean of 0.735 is within the standard
  error of the 0.71 of those 11 pixels.
"""

from megalopta.sensor.counter import LARGEST_CAPACITY
from megalopta.sensor.dark_counts import DarkCounts
from megalopta.sensor.dead_time import DeadTime
from megalopta.sensor.efficiency import Efficiency
from megalopta.sensor.model import Sensor
from megalopta.sensor.optics import Lens

_LENS = Lens(f_number=1.4, transmission=0.9)

PRESETS: dict[str, Sensor] = {
    "ideal": Sensor(
        name="ideal",
        source="definition",
        pitch_m=60e-6,
        fill_factor=1.0,
        exposure_s=0.1,
        lens=_LENS,
        efficiency=Efficiency(wavelengths_nm=(200.0, 2000.0), values=(1.0, 1.0)),
        counter_capacity=LARGEST_CAPACITY,
    ),
    "spadcam": Sensor(
        name="spadcam",
        source="Berkovich, dissertation (2017), §2.4; spectral shape, lens and dead time assumed",
        pitch_m=60e-6,
        fill_factor=0.1,
        exposure_s=0.1,
        lens=_LENS,
        efficiency=Efficiency(
            wavelengths_nm=(
                *(200, 350, 375, 400, 450, 500, 550),
                *(600, 650, 700, 800, 900, 1000, 1100),
            ),
            values=(
                *(0.0, 0.0001, 0.0009, 0.0068, 0.0090, 0.0058, 0.0038),
                *(0.0026, 0.0019, 0.0013, 0.0006, 0.0002, 0.00005, 0.0),
            ),
        ),
        dark_counts=DarkCounts(
            bulk_mean_hz_um2=0.735,
            bulk_sigma_hz_um2=0.32,
            hot_fraction=0.31,
            hot_mean_hz_um2=4.06,
            hot_sigma_hz_um2=1.5,
        ),
        dead_time=DeadTime(kind="paralyzable", dead_time_s=1e-6),
        counter_capacity=320,
    ),
}


def preset(name: str) -> Sensor:
    """Return a sensor by name.

    Raises
    ------
    ValueError
        When there is none of this name.
    """
    if name not in PRESETS:
        raise ValueError(f"sensor {name!r}: no such preset; choose from {', '.join(PRESETS)}")
    return PRESETS[name]
