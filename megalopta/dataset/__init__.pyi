from . import sintel
from .flow_record import BlockErrors, FlowRecord, ResponseErrors, RotationErrors, TruthErrors
from .frames import (
    FRAMES_AT_ONCE,
    read_radiance_frame,
    read_radiance_frames,
    read_truth_frame,
    read_truth_frames,
    write_frames,
)
from .rendering_noise import ATTRIBUTE, noise_record
from .store import (
    LICENSE,
    REDO_FOLDER,
    Dataset,
    existing,
    exposure_name,
    file_hash,
    files_in,
    open_dataset,
    whole_of,
    write_configuration,
)

__all__ = [
    "ATTRIBUTE",
    "FRAMES_AT_ONCE",
    "LICENSE",
    "REDO_FOLDER",
    "BlockErrors",
    "Dataset",
    "FlowRecord",
    "ResponseErrors",
    "RotationErrors",
    "TruthErrors",
    "existing",
    "exposure_name",
    "file_hash",
    "files_in",
    "noise_record",
    "open_dataset",
    "read_radiance_frame",
    "read_radiance_frames",
    "read_truth_frame",
    "read_truth_frames",
    "sintel",
    "whole_of",
    "write_configuration",
    "write_frames",
]
