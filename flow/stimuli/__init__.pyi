from .log_statistics import (
    PASSES as PASSES,
    LogStatistics as LogStatistics,
    log_statistics as log_statistics,
    unlit_share as unlit_share,
)
from .moving_layers import (
    Layer as Layer,
    MovingLayers as MovingLayers,
)
from .moving_template import (
    MovingTemplate as MovingTemplate,
    blurred as blurred,
    summed as summed,
)
from .panning_view import PanningView as PanningView
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
    ImageStatistics as ImageStatistics,
    image_statistics as image_statistics,
    power_spectrum as power_spectrum,
)
