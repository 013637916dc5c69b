from . import sintel
from .flow_record import FlowRecord, ResponseErrors, RotationErrors, TruthErrors
from .frames import read_radiance_frame, read_radiance_frames, read_truth_frame, read_truth_frames
from .redo import begin_redo, complete_redo, discard, open_dataset_whole, publish
from .rendering_noise import ATTRIBUTE, noise_record
from .store import (
    STAGES,
    Dataset,
    begin_stages,
    existing,
    exposure_name,
    file_hash,
    files_in,
    whole_of,
    write_configuration,
)

__all__ = [
    "ATTRIBUTE",
    "STAGES",
    "Dataset",
    "FlowRecord",
    "ResponseErrors",
    "RotationErrors",
    "TruthErrors",
    "begin_redo",
    "begin_stages",
    "complete_redo",
    "discard",
    "existing",
    "exposure_name",
    "file_hash",
    "files_in",
    "noise_record",
    "open_dataset_whole",
    "publish",
    "read_radiance_frame",
    "read_radiance_frames",
    "read_truth_frame",
    "read_truth_frames",
    "sintel",
    "whole_of",
    "write_configuration",
]
