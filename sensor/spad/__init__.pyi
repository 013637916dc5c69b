from .exposure import (
    expose as expose,
    expose_adc as expose_adc,
    expose_rate as expose_rate,
)
from .fixed_pattern import draw_fixed_pattern as draw_fixed_pattern
from .frames import over_frames as over_frames
from .measured import (
    MapFile as MapFile,
    MeasuredMaps as MeasuredMaps,
)
from .model import Sensor as Sensor
from .moments import (
    PARTS_ERROR as PARTS_ERROR,
    event_moments as event_moments,
    reading_moments as reading_moments,
    spad_expectation as spad_expectation,
)
from .order import (
    ORDER_OF_EFFECTS as ORDER_OF_EFFECTS,
    active_effects as active_effects,
    without as without,
)
from .presets import (
    PRESETS as PRESETS,
    TABLE_2_1 as TABLE_2_1,
    load_sensor as load_sensor,
    preset as preset,
    with_files as with_files,
)
from .rates import (
    checked_rate as checked_rate,
    detection_rate as detection_rate,
)
from .running import (
    RUNNING_ERROR as RUNNING_ERROR,
    running_counts as running_counts,
    running_frame as running_frame,
    settled as settled,
)
