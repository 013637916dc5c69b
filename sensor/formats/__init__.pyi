from .event_hdf5 import (
    events_hdf5_writer as events_hdf5_writer,
    read_events_hdf5 as read_events_hdf5,
    write_events_hdf5 as write_events_hdf5,
)
from .event_npz import (
    events_npz_writer as events_npz_writer,
    read_events_npz as read_events_npz,
    write_events_npz as write_events_npz,
)
from .event_stream import (
    EventOrigin as EventOrigin,
    StoredEvents as StoredEvents,
)
from .layout import (
    PackedLayout as PackedLayout,
    pack as pack,
)
from .names import (
    PRODUCTS as PRODUCTS,
    ProductName as ProductName,
    product_path as product_path,
    product_stem as product_stem,
)
from .packed_npy import (
    binary_npy_writer as binary_npy_writer,
    read_binary_npy as read_binary_npy,
    write_binary_npy as write_binary_npy,
)
from .products import (
    check_product as check_product,
    product_writer as product_writer,
)
from .reading import (
    FrameKind as FrameKind,
    read_events as read_events,
    read_frames as read_frames,
)
from .record import RecordedFrames as RecordedFrames
from .shot import (
    Arrays as Arrays,
    Shot as Shot,
)
from .spad512 import (
    read_spad512 as read_spad512,
    spad512_writer as spad512_writer,
    write_spad512 as write_spad512,
)
from .spc3 import read_spc3 as read_spc3
from .swissspad2 import read_swissspad2 as read_swissspad2
from .tiff import (
    read_tiff as read_tiff,
    tiff_writer as tiff_writer,
    write_tiff as write_tiff,
)
