"""Label maps and tracks of a rendered sequence, as other programs read them."""

import json

import cv2
import numpy as np
import pytest
import trimesh

import megalopta
from megalopta.config.model import parse
from megalopta.core.errors import UserError
from megalopta.render import read_truth
from megalopta.stages.run import run_stage


@pytest.fixture(scope="module")
def labeled(tmp_path_factory):
    folder = tmp_path_factory.mktemp("labels")
    boxes = {
        name: trimesh.creation.box((0.5, 0.5, 0.5)).apply_translation([0, y, 0.4])
        for name, y in (("hut", -0.5), ("shed", 0.5))
    }
    trimesh.Scene(boxes).export(folder / "huts.glb")
    settings = parse(
        f"""
        name: labeled
        scene:
          kind: meshes
          files: {folder / "huts.glb"}
          ground: 0.25
          reflectance: 0.75
        camera: {{width: 24, height: 18}}
        trajectory:
          {{frames: 3, position_m: [-3, 0, 1], look_at_m: [0, 0, 0.3], velocity_m_s: [0, 2, 0]}}
        render: {{samples_per_pixel: 1, bands_nm: [[450, 550], [600, 700]]}}
        labels: [classes, instances, clusters, normals, albedo]
        tracks: {{spacing_px: 6, frames: [0, 2]}}
        """,
        "test",
    )
    run_stage(folder / "data", settings, "render")
    return megalopta.open_dataset(folder / "data")[0]


def image_of(labeled, kind):
    path = labeled.dataset.frame(f"training/{kind}", 1)
    return cv2.imread(str(path), cv2.IMREAD_UNCHANGED)


def test_maps_are_those_of_the_truth(labeled):
    truth = read_truth(labeled.dataset.frame("truth", 1))
    classes = image_of(labeled, "classes")
    assert classes.dtype == np.uint16
    np.testing.assert_array_equal(classes, truth.kind_id)
    names = json.loads((labeled.dataset.root / "training/classes/labeled/names.json").read_text())
    assert names == ["sky", "ground", "hut", "shed"] == [*labeled.class_names]
    assert {names[each] for each in np.unique(classes)} == {*names}
    np.testing.assert_array_equal(labeled.class_ids[1], truth.kind_id)
    blue, green, red = np.moveaxis(image_of(labeled, "instances").astype(int), -1, 0)
    np.testing.assert_array_equal(red + 256 * green + 65536 * blue, truth.object_id)
    assert image_of(labeled, "clusters").shape == (18, 24, 3)
    assert not image_of(labeled, "clusters").any()  # of leaves, which boxes have not
    assert not labeled.leaf_clusters[1].any()
    normals = image_of(labeled, "normals")[..., ::-1] / 65535 * 2 - 1
    hit = truth.object_id > 0
    np.testing.assert_allclose(normals[hit], truth.normal[hit], atol=1.01 / 65535)
    assert (normals[~hit] == -1).all()


def test_albedo_is_that_of_each_surface(labeled):
    names = np.array(labeled.class_names)[labeled.class_ids[1]]
    expected = np.select([names == "sky", names == "ground"], [0, 0.25], 0.75)
    np.testing.assert_allclose(labeled.albedo[1], expected[..., None].repeat(2, -1), atol=1e-6)


def test_tracks_are_stored_as_tap_vid_stores_them(labeled):
    queries, points, occluded = labeled.tracks
    assert points.shape == (24, 3, 2)
    assert occluded.dtype == bool
    frame, y, x = queries.T
    assert set(frame) == {0, 2}
    np.testing.assert_array_equal(x[:4], [3.5, 9.5, 15.5, 21.5])
    for number, index in enumerate(frame.astype(int)):
        np.testing.assert_allclose(points[number, index], [x[number], y[number]], atol=1e-5)
        flow = labeled.flow(index, 1)[int(y[number]), int(x[number])]
        # Flow is float32.
        np.testing.assert_allclose(points[number, 1] - [x[number], y[number]], flow, atol=1e-5)
        hidden = labeled.occlusion(index, 1)[int(y[number]), int(x[number])]
        assert occluded[number, 1] == hidden


def test_unfit_tracks_are_refused(labeled):
    with pytest.raises(UserError, match=r"tracks\.frames 7: the sequence has frames 0 to 2"):
        parse("{tracks: {frames: [7]}, trajectory: {frames: 3}}", "test")
    with pytest.raises(UserError, match=r"tracks\.spacing_px 1: .* use a larger spacing"):
        parse("{tracks: {spacing_px: 1}, trajectory: {frames: 100000}}", "test")
    path = labeled.dataset.tracks
    path.write_bytes(path.read_bytes()[:-50])
    with pytest.raises(UserError, match=r"tracks\.npz"):
        _ = megalopta.open_dataset(labeled.dataset.root)[0].tracks
