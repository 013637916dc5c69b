from . import sintel as sintel
from .flow_record import (
    BlockErrors as BlockErrors,
    FlowRecord as FlowRecord,
    MixtureErrors as MixtureErrors,
    ResponseErrors as ResponseErrors,
    RotationErrors as RotationErrors,
    TruthErrors as TruthErrors,
)
from .frames import (
    FRAMES_AT_ONCE as FRAMES_AT_ONCE,
    read_radiance_frame as read_radiance_frame,
    read_radiance_frames as read_radiance_frames,
    read_truth_frame as read_truth_frame,
    read_truth_frames as read_truth_frames,
    write_frames as write_frames,
)
from .rendering_noise import (
    ATTRIBUTE as ATTRIBUTE,
    noise_record as noise_record,
)
from .reprojection import (
    View as View,
    carried_points as carried_points,
    motions_of as motions_of,
    rederived_flow as rederived_flow,
)
from .store import (
    LICENSE as LICENSE,
    REDO_FOLDER as REDO_FOLDER,
    Dataset as Dataset,
    existing as existing,
    exposure_name as exposure_name,
    file_hash as file_hash,
    files_in as files_in,
    is_as_written as is_as_written,
    moving_plan as moving_plan,
    open_dataset as open_dataset,
    read_dataset as read_dataset,
    whole_of as whole_of,
    write_configuration as write_configuration,
)
