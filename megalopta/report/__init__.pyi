from .images import data_uri, gray_scale, map_scale
from .page import write_report
from .svg import in_style, new_axes, to_svg
from .text import level_name, lux, number

__all__ = [
    "data_uri",
    "gray_scale",
    "in_style",
    "level_name",
    "lux",
    "map_scale",
    "new_axes",
    "number",
    "to_svg",
    "write_report",
]
