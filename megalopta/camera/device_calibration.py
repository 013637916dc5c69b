"""`megalopta spadcam calibrate`: recordings to a device file and its report."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from megalopta.camera.calibration_page import calibration_summary, write_calibration_report
from megalopta.camera.device_file import write_device
from megalopta.camera.recorded import Source, photons_on_pixel, read_recorded
from megalopta.core.errors import UserError
from megalopta.sensor import AnalogCounter, Sensor, preset
from megalopta.sensor.calibrate.device import calibrate_device
from megalopta.sensor.calibrate.level import Adc, Level


@dataclass(frozen=True)
class Beam:
    """Light of flat frames, where it is known as a beam's power."""

    wavelength_nm: float | None = None
    area_mm2: float | None = None
    """None: light is given as photons per second on a pixel."""

    def photons_hz(self, light: float, sensor: Sensor) -> float:
        """Photons per second on a pixel; relative where the wavelength is not known."""
        if self.area_mm2 is None or self.wavelength_nm is None:
            return light
        return photons_on_pixel(light, self.wavelength_nm, self.area_mm2, sensor.pitch_m)


def calibrate_recordings(
    sources: Sequence[Source], out: Path, *, beam: Beam, base: str = "spadcam"
) -> str:
    """Write a device file, its maps and its report; return what was found in a sentence.

    Raises
    ------
    UserError
        When a recording cannot be read, or all of them cannot support a calibration.
    """
    if out.suffix not in (".yaml", ".yml"):
        raise UserError(f"--out {out}: give the name of a .yaml file")
    if beam.area_mm2 is not None and beam.wavelength_nm is None:
        raise UserError("--beam-area-mm2: give --wavelength-nm too, to make photons of watts")
    try:
        sensor = preset(base)
        levels = [_level(source, beam, sensor) for source in sources]
        device = calibrate_device(levels, adc_of(sensor))
    except ValueError as problem:
        raise UserError(f"calibrate: {problem}") from problem
    write_device(out, device, sensor, beam.wavelength_nm, base)
    is_relative = beam.wavelength_nm is None
    write_calibration_report(out.with_suffix(".html"), device, out.stem, is_relative)
    return calibration_summary(device)


def adc_of(sensor: Sensor) -> Adc:
    """The converter behind the counters of a sensor. Raises ValueError where it has none."""
    counter = sensor.counter
    if not isinstance(counter, AnalogCounter) or counter.adc_bits is None:
        raise ValueError(f"{sensor.name}: no analog counter with an ADC; choose spadcam")
    top = counter.supply_v / counter.lsb_v
    return Adc(counter.lsb_v, top, top - counter.swing_v / counter.lsb_v)


def _level(source: Source, beam: Beam, sensor: Sensor) -> Level:
    recorded = read_recorded(source)
    if recorded.codes is None:
        raise ValueError(
            f"{source.path}: holds counts, no codes of an ADC; capture it with SPADCAM"
        )
    light = beam.photons_hz(source.light, sensor)
    return Level(recorded.codes, source.exposure_s or recorded.exposure_s, light)
