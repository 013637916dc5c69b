from .flow import responses_path
from .noise_warning import variances
from .pipeline import STAGES, run_all, run_stage
from .render import build
from .sense import exposures, light_scale, read_exposure

__all__ = [
    "STAGES",
    "build",
    "exposures",
    "light_scale",
    "read_exposure",
    "responses_path",
    "run_all",
    "run_stage",
    "variances",
]
