"""A dataset in Python: arrays agree with the files, and with each other."""

import pickle

import cv2
import numpy as np
import pytest

import megalopta
from megalopta.core.errors import UserError
from megalopta.dataset.opened import FlowPairs
from megalopta.render import read_truth

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def opened(small_dataset):
    return megalopta.open_dataset(small_dataset)


def test_sequences_are_found_by_place_name_and_split(opened, small_plan):
    assert [each.name for each in opened] == ["000000", "000001", "000002"]
    assert opened["000001"] is opened[1]
    assert sum(len(names) for split, names in opened.splits.items() if split != "sample") == 3
    assert opened.splits["sample"] == ("000000", "000001")
    with pytest.raises(UserError, match="no sequence 'x'; there are 000000"):
        opened["x"]
    with pytest.raises(UserError, match="no split"):
        opened.of_split("tests")


def test_arrays_are_lazy_and_have_units(opened):
    sequence = opened[0]
    assert sequence.radiance.shape == (3, 24, 32, 2)
    assert sequence.radiance.unit == "W·m⁻²·sr⁻¹·nm⁻¹"
    np.testing.assert_array_equal(np.asarray(sequence.radiance)[1:], sequence.radiance[1:])
    np.testing.assert_array_equal(sequence.radiance[-1, 3], sequence.radiance[2][3])
    spad, ctia = sequence.exposures
    assert sequence.counts(spad).unit == "counts per exposure"
    assert sequence.counts(ctia).unit == "electrons per exposure"
    assert sequence.poses.shape == (3, 4, 4)
    assert sequence.depth[0].shape == (24, 32)
    np.testing.assert_array_equal(sequence.object_ids[0] == 0, np.isinf(sequence.depth[0]))
    with pytest.raises(IndexError):
        sequence.radiance[3]
    with pytest.raises(UserError, match="no exposure 'eye'; there are spadcam"):
        sequence.counts("eye")
    with pytest.raises(UserError, match="holds no photon; give one of counts, saturated, photons"):
        sequence.counts(quantity="photon")
    assert repr(sequence.depth).startswith("LazyFrames(shape=(3, 24, 32), dtype=dtype('float32')")


def test_flow_between_neighbors_is_the_stored_one(opened):
    for sequence in opened:
        files = sequence.dataset
        flow = cv2.readOpticalFlow(str(files.frame("training/flow", 1)))
        known = np.abs(flow) < 1e9
        np.testing.assert_array_equal(sequence.flow(1)[known], flow[known])
        backward = read_truth(files.frame("truth", 1)).flow_backward
        np.testing.assert_array_equal(sequence.flow(1, 0), backward)
        mask = cv2.imread(str(files.frame("training/occlusions", 1)), 0)
        np.testing.assert_array_equal(sequence.occlusion(1), mask > 0)


def test_flow_between_distant_frames_is_the_sum_of_its_steps(opened):
    # every board and cylinder here is smooth: what bilinear interpolation leaves is below 0.05 px
    for sequence in opened:
        first, second, both = sequence.flow(0, 1), sequence.flow(1, 2), sequence.flow(0, 2)
        x, y = np.meshgrid(np.arange(32), np.arange(24))
        there = cv2.remap(
            second, (x + first[..., 0]).astype("f4"), (y + first[..., 1]).astype("f4"),
            cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=(np.nan, np.nan),
        )  # fmt: skip
        apart = np.abs(first + there - both)
        assert np.nanmax(apart) < 0.05
        assert np.isfinite(apart).mean() > 0.5


def test_new_light_has_independent_noise_and_the_same_mean(opened):
    sequence = opened[0]
    first, again, other = (
        sequence.expose("spadcam", 5.0, exposure_s=0.01, repeat=repeat) for repeat in (0, 0, 1)
    )
    np.testing.assert_array_equal(first[1], again[1])
    one, two = first[1].astype(float), other[1].astype(float)
    assert (one != two).any()
    # the difference of two independent counts has the variance of their sum: below 6 sigma
    assert abs(one.sum() - two.sum()) < 6 * np.sqrt(one.sum() + two.sum() + 1)
    brighter = (
        sequence.expose("ideal", 5.0, gain=4.0)[:].sum() / sequence.expose("ideal", 5.0)[:].sum()
    )
    assert brighter == pytest.approx(4, rel=0.05)
    with pytest.raises(UserError, match="sensor 'eye' is unknown"):
        sequence.expose("eye")
    with pytest.raises(UserError, match="exposure_s 9 is longer than a frame"):
        sequence.expose("ideal", exposure_s=9)


def test_the_stored_exposure_is_drawn_again(opened):
    sequence = opened[0]
    sensor, level = sequence.configuration.sensors[0], sequence.configuration.light_levels[0]
    np.testing.assert_array_equal(sequence.expose(sensor, level)[:], sequence.counts()[:])


def test_pairs_of_all_sequences(opened):
    pairs = opened.pairs()
    assert len(pairs) == 3 * 2
    last = pickle.loads(pickle.dumps(pairs))[-1]
    assert (last["sequence"], last["frame"]) == ("000002", 1)
    assert last["first"].shape == (1, 24, 32)
    assert last["flow"].shape == (2, 24, 32)
    np.testing.assert_array_equal(last["second"][0], opened[2].counts()[2])
    light = opened.pairs(exposure="radiance", step=2)
    assert len(light) == 3
    assert light[0]["first"].shape == (2, 24, 32)
    assert repr(light).startswith("FlowPairs(3 pairs of (2, 24, 32), W")
    with pytest.raises(IndexError):
        pairs[6]
    first = opened[0].exposures[0]
    both = FlowPairs([opened[0]], [first, "radiance"], 1)
    assert [both[place]["exposure"] for place in range(4)] == [first] * 2 + ["radiance"] * 2
    assert len(opened.pairs(exposure="all")) == 2 * len(pairs)
    with pytest.raises(UserError, match="step 3: the longest sequence has 3 frames; give 1 to 2"):
        opened.pairs(step=3)
    with pytest.raises(UserError, match="no sequence, and so no pairs"):
        FlowPairs([], None, 1)
    with pytest.raises(UserError, match="no exposure 'eye'; there are spadcam"):
        opened.pairs(exposure="eye")


def test_a_folder_without_a_dataset_is_told_so_whatever_its_links(tmp_path):
    (tmp_path / "python").symlink_to("/usr")
    with pytest.raises(UserError, match="no dataset here"):
        megalopta.open_dataset(tmp_path)
    (tmp_path / "dataset.yaml").write_text("{}")
    with pytest.raises(UserError, match="a link that leads out"):
        megalopta.open_dataset(tmp_path)


def test_a_torch_loader_gives_batches(opened):
    torch = pytest.importorskip("torch")
    pairs = opened.to_torch()
    assert isinstance(pairs, torch.utils.data.Dataset)
    loader = torch.utils.data.DataLoader(
        pairs, batch_size=2, num_workers=2, multiprocessing_context="spawn"
    )
    batches = list(loader)
    assert sum(len(batch["frame"]) for batch in batches) == 6
    assert batches[0]["flow"].shape == (2, 2, 24, 32)
    kinds = {name: value.dtype for name, value in pairs[0].items() if torch.is_tensor(value)}
    assert kinds == {
        **dict.fromkeys(("first", "second", "flow"), torch.float32),
        **dict.fromkeys(("valid", "occluded"), torch.bool),
    }


def test_without_pytorch_it_says_what_to_install(opened, monkeypatch):
    monkeypatch.setattr("megalopta.dataset.opened.find_spec", lambda name: None)
    with pytest.raises(UserError, match="pip install torch"):
        opened.to_torch()
