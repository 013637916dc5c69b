from .benchmark.data_sheet import data_sheet as data_sheet
from .benchmark.design import design as design
from .dataset.opened import open_dataset as open_dataset
from .dataset.photons import photons_from_images as photons_from_images

__version__: str
