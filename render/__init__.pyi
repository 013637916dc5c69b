from .environment import read_picture as read_picture
from .exr import (
    read_attributes as read_attributes,
    read_radiance as read_radiance,
    read_truth as read_truth,
    write_radiance as write_radiance,
    write_truth as write_truth,
)
from .footage.frames import Footage as Footage
from .footage.pictures import (
    SUFFIXES as SUFFIXES,
    is_footage as is_footage,
    open_footage as open_footage,
)
from .mitsuba_loader import activate as activate, dr as dr, mi as mi
from .noise import (
    MEASURED_EVERY as MEASURED_EVERY,
    MeasuredPass as MeasuredPass,
    RegionNoise as RegionNoise,
    RenderNoise as RenderNoise,
    RunningMean as RunningMean,
    neighbor_differences as neighbor_differences,
    render_once as render_once,
    render_until as render_until,
)
from .scene_renderer import SceneRenderer as SceneRenderer
from .settings import Bands as Bands, RenderSettings as RenderSettings, frame_seed as frame_seed
from .truth.tracer import Flow as Flow, Tracks as Tracks, Truth as Truth, out_of_view as out_of_view
from .variant import (
    CUDA_NOTE as CUDA_NOTE,
    Variant as Variant,
    choose_variant as choose_variant,
    has_cuda_device as has_cuda_device,
    llvm_in_use as llvm_in_use,
)
