"""Pairs and true flow in the layouts in which datasets come."""

import cv2
import h5py
import numpy as np
import pytest

from megalopta.benchmark.clips import read_pair, sets_below, true_flows
from megalopta.benchmark.scores import score_submissions
from megalopta.core.errors import UserError
from megalopta.flow.formats import read_flow, write_flo, write_flo5, write_kitti_png

FRAME = np.random.default_rng(0).integers(0, 256, (6, 8, 3)).astype(np.uint8)
FLOW = np.random.default_rng(1).integers(-5, 5, (6, 8, 2)).astype(np.float32)


def save(root, write, *names):
    for number, name in enumerate(names):
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        write(root / name, FLOW if write is not picture else np.roll(FRAME, number))


def picture(path, codes):
    cv2.imwrite(str(path), codes)


def fine_flo5(path, flow):
    """Twice the size, in pixels of the frames, as Spring's."""
    fine = np.full((12, 16, 2), np.nan, np.float32)
    fine[::2, ::2] = flow
    with h5py.File(path, "w") as file:
        file.create_dataset("flow", data=fine)


def pairs_below(root):
    """The pairs of the only pass."""
    (pairs,) = sets_below(root).values()
    return pairs


LAYOUTS = {
    "sintel": (write_flo, ["flow/alley/frame_0001.flo"], ["clean/alley/frame_0001.png", "clean/alley/frame_0002.png"], "alley/frame_0001"),
    "sintel above": (write_flo, ["training/flow/alley/frame_0001.flo"], ["training/clean/alley/frame_0001.png", "training/clean/alley/frame_0002.png"], "alley/frame_0001"),
    "kitti": (write_kitti_png, ["training/flow_occ/000000_10.png"], ["training/image_2/000000_10.png", "training/image_2/000000_11.png"], "000000_10"),
    "kitti 2012": (write_kitti_png, ["training/flow_occ/000000_10.png"], ["training/colored_0/000000_10.png", "training/colored_0/000000_11.png"], "000000_10"),
    "middlebury": (write_flo, ["other-gt-flow/Urban/flow10.flo"], ["other-data/Urban/frame10.png", "other-data/Urban/frame11.png"], "other-gt-flow/Urban/flow10"),
    "middlebury with more frames": (write_flo, ["other-gt-flow/Urban/flow10.flo"], ["other-data/Urban/frame10.png", "other-data/Urban/frame11.png", "other-data/Urban/frame12.png"], "other-gt-flow/Urban/flow10"),
    "spring": (fine_flo5, ["0001/flow_FW_left/flow_FW_left_0001.flo5"], ["0001/frame_left/frame_left_0001.png", "0001/frame_left/frame_left_0002.png"], "0001/flow_FW_left/flow_FW_left_0001"),
    "spring above": (fine_flo5, ["train/0001/flow_FW_right/flow_FW_right_0001.flo5"], ["train/0001/frame_right/frame_right_0001.png", "train/0001/frame_right/frame_right_0002.png"], "0001/flow_FW_right/flow_FW_right_0001"),
    "spring of the frames' size": (write_flo5, ["0001/flow_FW_left/flow_FW_left_0001.flo5"], ["0001/frame_left/frame_left_0001.png", "0001/frame_left/frame_left_0002.png"], "0001/flow_FW_left/flow_FW_left_0001"),
    "chairs": (write_flo, ["00001_flow.flo"], ["00001_img1.ppm", "00001_img2.ppm"], "00001_flow"),
    "two of chairs": (write_flo, ["1_flow.flo", "10_flow.flo"], ["1_img1.ppm", "1_img2.ppm", "10_img1.ppm", "10_img2.ppm"], "1_flow"),
    "by name": (write_flo, ["data/a.flo"], ["data/a_1.png", "data/a_2.png"], "data/a"),
    "kitti, visible only": (write_kitti_png, ["flow_noc/000000_10.png"], ["image_0/000000_10.png", "image_0/000000_11.png"], "000000_10"),
    "middlebury, gray": (write_flo, ["other-gt-flow/Urban/flow10.flo"], ["other-data-gray/Urban/frame10.png", "other-data-gray/Urban/frame11.png"], "other-gt-flow/Urban/flow10"),
    "examples of chairs": (write_flo, ["0000001-gt.flo"], ["0000001-img0.ppm", "0000001-img1.ppm"], "0000001-gt"),
    "a folder each, as PNG": (write_kitti_png, ["x/flow.png"], ["x/first.png", "x/second.png"], "x/flow"),
    "a folder each": (write_flo, ["x/flow.flo"], ["x/first.jpg", "x/second.jpg"], "x/flow"),
}  # fmt: skip


@pytest.mark.parametrize("layout", LAYOUTS)
def test_pairs_are_found_with_their_flow(tmp_path, layout):
    write, flows, frames, name = LAYOUTS[layout]
    save(tmp_path, write, *flows)
    save(tmp_path, picture, *frames)
    pairs = pairs_below(tmp_path)
    assert len(pairs) == len(flows) and name in pairs
    first, second, _ = pairs[name]
    assert (first, second) == (tmp_path / frames[0], tmp_path / frames[1])
    np.testing.assert_array_equal(read_pair(name, pairs[name]).flow, FLOW)


@pytest.mark.parametrize("layout", ["middlebury", "spring", "chairs", "kitti"])
def test_flow_is_scored_in_the_layout_of_the_truth(tmp_path, layout):
    write, flows, frames, _ = LAYOUTS[layout]
    save(tmp_path / "truth", write, *flows)
    save(tmp_path / "truth", picture, *frames)
    (frame,) = true_flows(tmp_path / "truth")
    write_flo(tmp_path / "mine" / frame.sequence / f"{frame.name}.flo", FLOW + np.array([3, 4]))
    scores = score_submissions([tmp_path / "mine"], tmp_path / "truth")
    for entry in scores.entries:
        assert entry.sequence != "" and entry.errors["all"]["epe_px"] == pytest.approx(5)


@pytest.mark.parametrize("folder", ["clean", "final", "", "other-data", "other-data-gray"])
def test_pictures_beside_their_flow_are_a_set_and_so_is_each_pass(tmp_path, folder):
    if folder.startswith("other"):
        passes = {"other-data": "", "other-data-gray": "gray"}
        flow = "other-gt-flow/Urban/flow10.flo"
        names = "{}/Urban/frame10.png", "{}/Urban/frame11.png"
    else:
        passes, flow = {"clean": "clean", "final": "final"}, "flow/alley/frame_0001.flo"
        names = "{}/alley/frame_0001.png", "{}/alley/frame_0002.png"
    save(tmp_path, write_flo, flow)
    save(tmp_path, picture, *(name.format(place) for place in passes for name in names))
    expected = {passes[folder]} if folder else set(passes.values())
    found = sets_below(tmp_path / folder)
    assert set(found) == expected
    for pairs in found.values():
        ((first, *_),) = pairs.values()
        assert first.is_relative_to(tmp_path / folder)


def test_moving_objects_of_kitti_are_the_foreground(tmp_path):
    write, flows, frames, name = LAYOUTS["kitti"]
    save(tmp_path, write, *flows)
    save(tmp_path, picture, *frames)
    numbers = np.arange(48, dtype=np.uint8).reshape(6, 8) % 3
    (tmp_path / "training/obj_map").mkdir()
    picture(tmp_path / "training/obj_map/000000_10.png", numbers)
    clip = read_pair(name, pairs_below(tmp_path)[name])
    np.testing.assert_array_equal(clip.foreground, numbers > 0)


def test_masks_beside_flow_are_used(tmp_path):
    """Of a folder for each pair: what is hidden, or visible, and what does not count."""
    save(tmp_path, write_flo, "a/flow.flo")
    save(tmp_path, write_kitti_png, "b/flow.png")
    save(
        tmp_path,
        picture,
        *(f"{name}/{order}.png" for name in "ab" for order in ("first", "second")),
    )
    mask = np.zeros((6, 8), np.uint8)
    mask[:2] = 255
    picture(tmp_path / "a/occlusions.png", mask)
    picture(tmp_path / "a/invalid.png", mask[::-1])
    write_kitti_png(tmp_path / "b/flow_noc.png", np.where(mask[..., np.newaxis], np.nan, FLOW))
    pairs = pairs_below(tmp_path)
    assert list(pairs) == ["a/flow", "b/flow"]
    for name, files in pairs.items():
        clip = read_pair(name, files)
        np.testing.assert_array_equal(clip.hidden, mask > 0)
        unknown = np.isnan(clip.flow[..., 0])
        np.testing.assert_array_equal(unknown, mask[::-1] > 0 if name == "a/flow" else False)


def test_flow_of_spring_backward_leads_to_the_frame_before(tmp_path):
    save(tmp_path, fine_flo5, "0001/flow_BW_left/flow_BW_left_0002.flo5")
    frames = (f"0001/frame_left/frame_left_000{number}.png" for number in (2, 1))
    save(tmp_path, picture, *frames)
    ((first, second, _),) = pairs_below(tmp_path).values()
    assert (first.stem, second.stem) == ("frame_left_0002", "frame_left_0001")


def test_what_lacks_its_pictures_is_named_with_the_known_layouts(tmp_path):
    save(tmp_path, write_flo, "a.flo", "b.flo")
    save(tmp_path, picture, "a_1.png", "a_2.png", "b_1.png")
    with pytest.raises(UserError, match=r"b\.flo: its two pictures.*Spring.*FlyingChairs"):
        pairs_below(tmp_path)
    (tmp_path / "empty").mkdir()
    with pytest.raises(UserError, match=r"no true flow.*Middlebury.*Spring"):
        pairs_below(tmp_path / "empty")


@pytest.mark.parametrize("scale", [64, 128, 100.5])
def test_codes_of_a_pixel_in_flow_as_png(tmp_path, scale):
    codes = np.ones((6, 8, 3), np.uint16)
    codes[..., 2], codes[..., 1] = np.moveaxis(np.rint(FLOW * scale) + 2**15, -1, 0)
    cv2.imwrite(str(tmp_path / "a.png"), codes)
    np.testing.assert_allclose(
        read_flow(tmp_path / "a.png", png_scale=scale), FLOW, atol=0.5 / scale
    )
    (tmp_path / "flow_occ").mkdir()
    (tmp_path / "a.png").rename(tmp_path / "flow_occ" / "0_10.png")
    write_flo(tmp_path / "mine" / "0_10.flo", FLOW)
    *_, overall = score_submissions([tmp_path / "mine"], tmp_path, png_scale=scale).entries
    assert overall.errors["all"]["epe_px"] <= 0.71 / scale


def test_scale_and_order_of_bytes_of_pfm(tmp_path):
    values = np.dstack([FLOW, FLOW[..., 0]])[::-1] / 2
    (tmp_path / "a.pfm").write_bytes(b"PF\n8 6\n2.0\n" + values.astype(">f4").tobytes())
    np.testing.assert_array_equal(read_flow(tmp_path / "a.pfm"), FLOW)
