from .calibrate.counts import (
    CountingDevice as CountingDevice,
    Summed as Summed,
    Switching as Switching,
    calibrate_counts as calibrate_counts,
    summed as summed,
    summed_bits as summed_bits,
)
from .calibrate.crosstalk import (
    Kernel as Kernel,
    PairCrosstalk as PairCrosstalk,
    crosstalk_of_hot_pixels as crosstalk_of_hot_pixels,
    fit_crosstalk as fit_crosstalk,
    kernel_of as kernel_of,
)
from .calibrate.device import AnalogDevice as AnalogDevice, calibrate_device as calibrate_device
from .calibrate.emva import device_emva as device_emva
from .calibrate.level import Level as Level
from .calibrate.misfit import Misfit as Misfit
from .calibrate.pixels import Estimate as Estimate
from .calibrate.recovery import DeadTimeEstimate as DeadTimeEstimate, Recovery as Recovery
from .calibrate.time_tags import (
    Autocorrelation as Autocorrelation,
    afterpulses_between as afterpulses_between,
    autocorrelation_of as autocorrelation_of,
    coincidences as coincidences,
    fit_exponential as fit_exponential,
    fit_table as fit_table,
)
from .change import changed as changed
from .compare.causes import Causes as Causes, Explanation as Explanation
from .compare.faults import Arrangement as Arrangement, Fault as Fault
from .compare.left import Left as Left
from .compare.model import level_of_codes as level_of_codes
from .compare.recordings import Comparison as Comparison, compare_recordings as compare_recordings
from .compare.two_sample import Difference as Difference, PixelTest as PixelTest
from .contrast.model import ContrastSensor as ContrastSensor
from .ctia.bias import (
    DacBias as DacBias,
    FixedBias as FixedBias,
    FloatingGateBias as FloatingGateBias,
)
from .ctia.model import (
    CTIA_PRESETS as CTIA_PRESETS,
    PHOTODIODES as PHOTODIODES,
    CtiaExposure as CtiaExposure,
    CtiaNoise as CtiaNoise,
    CtiaSensor as CtiaSensor,
    expose_photocurrent as expose_photocurrent,
    photocurrent as photocurrent,
    reading_electrons as reading_electrons,
    volt_moments as volt_moments,
)
from .ctia.photodiode import Photodiode as Photodiode
from .effects.afterpulsing import Afterpulsing as Afterpulsing
from .effects.base import Effect as Effect
from .effects.bias import (
    Bias as Bias,
    Temperature as Temperature,
    best_excess_bias as best_excess_bias,
)
from .effects.crosstalk import Crosstalk as Crosstalk
from .effects.dark_counts import (
    DarkCounts as DarkCounts,
    Telegraph as Telegraph,
    dark_count_density as dark_count_density,
)
from .effects.dead_time import DeadTime as DeadTime
from .effects.gating import Gate as Gate
from .effects.timing import Jitter as Jitter, Tcspc as Tcspc
from .expectations import (
    event_moments as event_moments,
    expectation as expectation,
    reading_moments as reading_moments,
)
from .exposure import (
    expose as expose,
    expose_adc as expose_adc,
    expose_binary as expose_binary,
    expose_events as expose_events,
    expose_rate as expose_rate,
)
from .formats.counts_store import (
    OpenedCounts as OpenedCounts,
    StoredFrames as StoredFrames,
    open_counts as open_counts,
)
from .formats.events import (
    EventOrigin as EventOrigin,
    read_events as read_events,
    write_events_hdf5 as write_events_hdf5,
)
from .formats.reading import read_frames as read_frames
from .formats.time_tags import read_time_tags as read_time_tags
from .frame.model import FRAME_PRESETS as FRAME_PRESETS, FrameSensor as FrameSensor
from .histograms import expose_histograms as expose_histograms, mean_histograms as mean_histograms
from .image_sensors import (
    IMAGE_SENSORS as IMAGE_SENSORS,
    ImageSensor as ImageSensor,
    check_sensor as check_sensor,
    detected_photons as detected_photons,
    load_sensor as load_sensor,
)
from .optics import (
    ColorFilters as ColorFilters,
    Efficiency as Efficiency,
    Lens as Lens,
    band_means as band_means,
    demosaiced as demosaiced,
    photon_rate as photon_rate,
)
from .quantities import Events as Events, Expectation as Expectation, Exposure as Exposure
from .sampling.streams import generator as generator
from .spad.array import detection_rate as detection_rate
from .spad.counters import AnalogCounter as AnalogCounter, DigitalCounter as DigitalCounter
from .spad.measured import MapFile as MapFile, MeasuredMaps as MeasuredMaps
from .spad.model import ORDER_OF_EFFECTS as ORDER_OF_EFFECTS, Sensor as Sensor, without as without
from .spad.presets import PRESETS as PRESETS, preset as preset
