"""Networks in ONNX files."""

import numpy as np
import pytest

from megalopta.flow.detectors.registry import method


def gray(shape=(48, 64)):
    """Two smooth frames from 0 to 1."""
    rows, columns = np.mgrid[0 : shape[0], 0 : shape[1]]
    first = np.sin(np.pi * rows / (shape[0] - 1)) * columns / (shape[1] - 1)
    return first / first.max(), 1 - first / first.max()


@pytest.fixture
def network(tmp_path):
    """Writes a network whose flow is the pictures' own red values, first one before second one."""
    onnx = pytest.importorskip("onnx")
    pytest.importorskip("onnxruntime")
    helper, kind = onnx.helper, onnx.TensorProto.FLOAT

    def write(name, height, width, channels=3):
        shape = [1, channels, height, width]
        pictures = [helper.make_tensor_value_info(each, kind, shape) for each in "ab"]
        outputs = [
            helper.make_tensor_value_info(each, kind, [1, 2, None, None])
            for each in ("coarse", "flow")
        ]
        one = [
            helper.make_tensor(n, onnx.TensorProto.INT64, [1], [v])
            for n, v in zip("012", (0, 1, 1), strict=True)
        ]
        nodes = [
            helper.make_node("Slice", ["a", "0", "1", "2"], ["x"]),
            helper.make_node("Slice", ["b", "0", "1", "2"], ["y"]),
            helper.make_node("Concat", ["x", "y"], ["flow"], axis=1),
            helper.make_node(
                "AveragePool", ["flow"], ["coarse"], kernel_shape=[8, 8], strides=[8, 8]
            ),
        ]
        graph = helper.make_graph(nodes, "reds", pictures, outputs, one)
        model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8)
        onnx.checker.check_model(model)
        onnx.save(model, tmp_path / name)
        return tmp_path / name

    return write


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("shape", [(48, 64), (45, 51), (130, 141)])
def test_a_network_of_any_size_sees_both_frames_as_they_are(network, shape, channels):
    first, second = gray(shape)
    flow = method(str(network("any.onnx", "h", "w", channels))).dense(first, second)
    # the network counts in float32, from 0 to 255
    np.testing.assert_allclose(flow, 255 * np.dstack([first, second]), rtol=0, atol=1e-4)


def test_a_network_of_one_size_gives_flow_of_the_frames_size(network):
    """Frames of half its height and width: flow in their own px is half of what it says."""
    first, second = gray((48, 64))
    flow = method(str(network("fixed.onnx", 96, 128))).dense(first, second)
    # bilinear there and back, of frames whose curvature is at most (π/47)²
    expected = 255 * np.dstack([first, second]) / 2
    np.testing.assert_allclose(flow[2:-2, 2:-2], expected[2:-2, 2:-2], atol=255 * 2e-3)


def test_what_is_no_flow_network_is_told(tmp_path):
    pytest.importorskip("onnxruntime")
    path = tmp_path / "text.onnx"
    with pytest.raises(ValueError, match="No such file"):
        method(str(path))
    path.write_text("no network")
    with pytest.raises(ValueError, match="give an ONNX file that maps two pictures to flow"):
        method(str(path))
