from . import rays
from .geometry import Geometry
from .tracer import Flow, Truth, TruthTracer, out_of_view
from .views import Instant, Rolling

__all__ = [
    "Flow",
    "Geometry",
    "Instant",
    "Rolling",
    "Truth",
    "TruthTracer",
    "out_of_view",
    "rays",
]
