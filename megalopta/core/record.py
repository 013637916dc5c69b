"""Base class of all configuration records. Every folder may import this module."""

from pydantic import BaseModel


class Record(
    BaseModel, frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True
):
    """Frozen fields, each explained by the docstring below it; unknown keys are refused."""
