from .integrator import BakedLightIntegrator, path_tracing_reason

__all__ = [
    "BakedLightIntegrator",
    "path_tracing_reason",
]
