from .choice import path_tracing_reason as path_tracing_reason
from .integrator import BakedLightIntegrator as BakedLightIntegrator
