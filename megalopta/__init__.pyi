from .benchmark.cameras import compare_cameras as compare_cameras
from .benchmark.data_sheet import DataSheet as DataSheet, data_sheet as data_sheet
from .benchmark.design import Design as Design, design as design
from .benchmark.trial import load_sweep as load_sweep
from .camera.measurements import read_measurement as read_measurement
from .camera.recording import Recording as Recording, open_recording as open_recording
from .core.errors import UserError as UserError
from .dataset.opened import (
    FlowPairs as FlowPairs,
    OpenedDataset as OpenedDataset,
    open_dataset as open_dataset,
)
from .dataset.photons import photons_from_images as photons_from_images
from .dataset.sequence import LazyFrames as LazyFrames, Sequence as Sequence
from .report.view import ViewOptions as ViewOptions, view as view

__version__: str
