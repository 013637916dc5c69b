from .charts import map_chart
from .device_file import Light, nominal_efficiency, write_device
from .page import summary, write_calibration_report
from .recorded import Recorded, Source, photons_on_pixel, read_recorded
from .run import Beam, adc_of, calibrate_recordings
from .sections import Section, write_sections

__all__ = [
    "Beam",
    "Light",
    "Recorded",
    "Section",
    "Source",
    "adc_of",
    "calibrate_recordings",
    "map_chart",
    "nominal_efficiency",
    "photons_on_pixel",
    "read_recorded",
    "summary",
    "write_calibration_report",
    "write_device",
    "write_sections",
]
