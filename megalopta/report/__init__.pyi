from .images import data_uri, gray_scale
from .page import write_report
from .text import level_name, lux, number

__all__ = [
    "data_uri",
    "gray_scale",
    "level_name",
    "lux",
    "number",
    "write_report",
]
