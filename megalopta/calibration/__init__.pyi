from .charts import color_limits as color_limits, map_chart as map_chart
from .device_file import (
    Light as Light,
    nominal_efficiency as nominal_efficiency,
    write_device as write_device,
)
from .page import (
    summary as summary,
    write_calibration_report as write_calibration_report,
)
from .recorded import (
    Recorded as Recorded,
    Source as Source,
    photons_on_pixel as photons_on_pixel,
    read_recorded as read_recorded,
)
from .run import (
    Beam as Beam,
    adc_of as adc_of,
    calibrate_recordings as calibrate_recordings,
)
