from .known_flow import (
    Layer as Layer,
    MovingLayers as MovingLayers,
    PanningView as PanningView,
)
from .moving_template import (
    MovingTemplate as MovingTemplate,
    blurred as blurred,
    summed as summed,
)
from .photons import (
    BlackFrameError as BlackFrameError,
    Counts as Counts,
    Empty as Empty,
    Normalization as Normalization,
    divisors as divisors,
    draw_counts as draw_counts,
    draw_in_one as draw_in_one,
    frame_light as frame_light,
    narrowest as narrowest,
)
from .resizing import (
    ResizeKind as ResizeKind,
    resize as resize,
    resized_shape as resized_shape,
)
from .statistics import (
    PASSES as PASSES,
    ImageStatistics as ImageStatistics,
    LogStatistics as LogStatistics,
    image_statistics as image_statistics,
    log_statistics as log_statistics,
    power_spectrum as power_spectrum,
    unlit_share as unlit_share,
)
