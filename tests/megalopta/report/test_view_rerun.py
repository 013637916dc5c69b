"""What is seen of a sequence, read back as Rerun's own library reads it."""

import re
import textwrap
from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest

from megalopta.dataset.frames import read_truth_frame
from megalopta.dataset.opened import open_dataset
from megalopta.report.panels import sequence_view
from megalopta.report.readings import Treatment
from megalopta.report.view import write_rrd

chunk = pytest.importorskip("rerun.chunk", reason="no Rerun SDK that reads its files")


@pytest.fixture(scope="module")
def logged(whole, tmp_path_factory):
    path = tmp_path_factory.mktemp("rrd") / "view.rrd"
    return columns(write_rrd(path, sequence_view(whole, Treatment())))


def columns(path):
    """Columns by place and component, a row for each frame."""
    found = defaultdict(dict)
    for each in chunk.RrdReader(path).stream().to_chunks():
        batch = each.to_record_batch()
        for name, column in zip(batch.schema.names, batch.columns, strict=True):
            if name != "log_time":
                found[each.entity_path].setdefault(name, []).extend(column.to_pylist())
    return found


def test_pictures_and_points_stand_in_the_frames_that_they_are_of(logged, whole):
    names = {"/readings/spadcam/starlight", "/true_flow", "/world/camera/light", "/world/points"}
    assert names < set(logged)
    times = open_dataset(whole)[0].times_s[:3]
    for name in names:
        assert logged[name]["frame"] == [0, 1, 2]
        seconds = [each.total_seconds() for each in logged[name]["time"]]
        np.testing.assert_allclose(seconds, times, atol=1e-6)


def test_points_are_seen_by_the_camera_in_the_middle_of_their_pixels(logged):
    camera = logged["/world/camera"]
    for frame in range(3):
        rotation = np.reshape(camera["Transform3D:mat3x3"][frame], (3, 3)).T  # columns first
        matrix = np.reshape(camera["Pinhole:image_from_camera"][frame], (3, 3)).T
        points = np.array(logged["/world/points"]["Points3D:positions"][frame])
        inside = (points - camera["Transform3D:translation"][frame][0]) @ rotation @ matrix.T
        image = inside[:, :2] / inside[:, 2:]
        assert len(image) > 500 and (inside[:, 2] > 0).all()
        np.testing.assert_allclose(image % 1, 0.5, atol=2e-3)
        assert image.min() > 0 and (image < camera["Pinhole:resolution"][frame][0]).all()


def test_the_lines_of_the_documentation_log_depth_at_the_points_that_the_truth_states(
    whole, tmp_path, monkeypatch
):
    page = (Path(__file__).parents[3] / "docs/how-to/view.md").read_text("utf-8")
    (lines,) = re.findall(r"^    import rerun\n.*", page, re.DOTALL | re.MULTILINE)
    monkeypatch.chdir(tmp_path)
    Path("seen").symlink_to(whole)
    exec(textwrap.dedent(lines), names := {})
    names["rerun"].disconnect()
    rows = columns("seen.rrd")
    camera, images = rows["/world/camera"], rows["/world/camera/depth"]
    matrix = np.reshape(camera["Pinhole:image_from_camera"][0], (3, 3)).T  # columns first
    truth = read_truth_frame(names["sequence"].dataset, 1)
    height, width = truth.depth.shape
    depth = np.frombuffer(bytes(images["DepthImage:buffer"][1][0]), "<f4").reshape(height, width)
    centers = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5, [1])
    rays = np.stack(centers, axis=-1)[:, :, 0] @ np.linalg.inv(matrix).T  # right, down, forward
    rotation = np.reshape(camera["Transform3D:mat3x3"][1], (3, 3)).T
    points = depth[..., None] * rays @ rotation.T + camera["Transform3D:translation"][1][0]
    known = np.isfinite(truth.position).all(axis=-1)
    np.testing.assert_allclose(points[known], truth.position[known], atol=2e-4)  # m
    assert {"/counts", "/flow"} < set(rows)
