from .bands import Bands
from .environment import read_picture
from .exr import (
    read_attributes,
    read_radiance,
    read_size,
    read_truth,
    write_radiance,
    write_truth,
)
from .mitsuba_loader import activate, dr, mi
from .noise import MeasuredPass, RegionNoise, RenderNoise, RunningMean, neighbor_differences
from .repeats import MEASURED_EVERY, render_once, render_until
from .scene_renderer import SceneRenderer
from .settings import RenderSettings, frame_seed
from .truth.tracer import Flow, Truth, out_of_view
from .variant import CUDA_NOTE, Variant, choose_variant, has_cuda_device, llvm_in_use

__all__ = [
    "CUDA_NOTE",
    "MEASURED_EVERY",
    "Bands",
    "Flow",
    "MeasuredPass",
    "RegionNoise",
    "RenderNoise",
    "RenderSettings",
    "RunningMean",
    "SceneRenderer",
    "Truth",
    "Variant",
    "activate",
    "choose_variant",
    "dr",
    "frame_seed",
    "has_cuda_device",
    "llvm_in_use",
    "mi",
    "neighbor_differences",
    "out_of_view",
    "read_attributes",
    "read_picture",
    "read_radiance",
    "read_size",
    "read_truth",
    "render_once",
    "render_until",
    "write_radiance",
    "write_truth",
]
