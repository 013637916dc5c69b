from . import rays as rays
from .footprint import (
    FlowSpread as FlowSpread,
    Footprint as Footprint,
)
from .geometry import Geometry as Geometry
from .tracer import (
    Flow as Flow,
    Truth as Truth,
    TruthTracer as TruthTracer,
    out_of_view as out_of_view,
)
from .views import (
    Instant as Instant,
    Rolling as Rolling,
)
