from .choice import path_tracing_reason
from .integrator import BakedLightIntegrator

__all__ = [
    "BakedLightIntegrator",
    "path_tracing_reason",
]
