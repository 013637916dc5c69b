from .images import (
    data_uri as data_uri,
    gray_scale as gray_scale,
    map_scale as map_scale,
)
from .page import write_report as write_report
