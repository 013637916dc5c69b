from .choice import (
    AT_EQUAL_ERROR as AT_EQUAL_ERROR,
    may_pay as may_pay,
    path_tracing_reason as path_tracing_reason,
)
from .integrator import BakedLightIntegrator as BakedLightIntegrator
