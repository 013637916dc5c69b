from .images import (
    data_uri as data_uri,
    gray_scale as gray_scale,
)
from .page import write_report as write_report
from .svg import (
    in_style as in_style,
    new_axes as new_axes,
    to_svg as to_svg,
)
from .text import (
    level_name as level_name,
    lux as lux,
    number as number,
)
