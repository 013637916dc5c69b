from .integrator import (
    BakedLightIntegrator as BakedLightIntegrator,
    path_tracing_reason as path_tracing_reason,
)
