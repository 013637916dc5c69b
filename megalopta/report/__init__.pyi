from .images import data_uri as data_uri, gray_scale as gray_scale
from .page import write_report as write_report
