from .images import data_uri, gray_scale
from .text import level_name, lux, number
from .write import write_report

__all__ = [
    "data_uri",
    "gray_scale",
    "level_name",
    "lux",
    "number",
    "write_report",
]
