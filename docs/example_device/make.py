"""Make the files of the example device anew: python docs/example_device/make.py.

No measurement: one device drawn from the figures of the preset `spadcam`, written down as a
measured one would be, at the preset's reference bias and temperature.
"""

from pathlib import Path

import numpy as np

from megalopta.sensor import changed, preset
from megalopta.sensor.effects.bias import breakdown_offset
from megalopta.sensor.spad.device import draw_fixed_pattern

FOLDER = Path(__file__).parent
SHAPE = (128, 128)
SENSOR = changed(preset("spadcam"), device_seed=7)


def main() -> None:
    """Write maps and efficiency curve."""
    dark_hz = draw_fixed_pattern(SENSOR, SHAPE).dark_counts_hz
    above_nominal_v = breakdown_offset(SENSOR.bias, SHAPE, SENSOR.device_seed)
    np.save(FOLDER / "dark_counts_hz.npy", dark_hz.astype(np.float32))
    np.save(FOLDER / "breakdown_v.npy", above_nominal_v.astype(np.float32))
    curve = zip(SENSOR.efficiency.wavelengths_nm, SENSOR.efficiency.values, strict=True)
    lines = ["wavelength_nm,efficiency", *(f"{nm:g},{value:g}" for nm, value in curve)]
    (FOLDER / "pde.csv").write_text("\n".join(lines) + "\n", "utf-8")


if __name__ == "__main__":
    main()
