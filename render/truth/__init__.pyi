from . import rays
from .footprint import FlowSpread, Footprint
from .geometry import Geometry
from .tracer import Flow, Truth, TruthTracer, out_of_view
from .views import Instant, Rolling

__all__ = [
    "Flow",
    "FlowSpread",
    "Footprint",
    "Geometry",
    "Instant",
    "Rolling",
    "Truth",
    "TruthTracer",
    "out_of_view",
    "rays",
]
