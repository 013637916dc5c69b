from .event_hdf5 import events_hdf5_writer, read_events_hdf5, write_events_hdf5
from .event_npz import events_npz_writer, read_events_npz, write_events_npz
from .event_stream import EventOrigin, StoredEvents
from .layout import PackedLayout, pack
from .names import PRODUCTS, ProductName, product_path
from .packed_npy import binary_npy_writer, read_binary_npy, write_binary_npy
from .products import check_product, product_writer
from .reading import FrameKind, read_events, read_frames
from .record import RecordedFrames
from .shot import Shot
from .spad512 import read_spad512, spad512_writer, write_spad512
from .spc3 import read_spc3
from .swissspad2 import read_swissspad2
from .tiff import read_tiff, tiff_writer, write_tiff

__all__ = [
    "PRODUCTS",
    "EventOrigin",
    "FrameKind",
    "PackedLayout",
    "ProductName",
    "RecordedFrames",
    "Shot",
    "StoredEvents",
    "binary_npy_writer",
    "check_product",
    "events_hdf5_writer",
    "events_npz_writer",
    "pack",
    "product_path",
    "product_writer",
    "read_binary_npy",
    "read_events",
    "read_events_hdf5",
    "read_events_npz",
    "read_frames",
    "read_spad512",
    "read_spc3",
    "read_swissspad2",
    "read_tiff",
    "spad512_writer",
    "tiff_writer",
    "write_binary_npy",
    "write_events_hdf5",
    "write_events_npz",
    "write_spad512",
    "write_tiff",
]
