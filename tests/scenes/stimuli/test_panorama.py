import numpy as np
import pytest
from pydantic import ValidationError

from megalopta.scenes import Light, Panorama
from megalopta.scenes.hashed_file import HashedFile


def test_a_file_is_known_by_its_content(tmp_path):
    path = tmp_path / "a.hdr"
    path.write_bytes(b"one")
    file = HashedFile.model_validate(str(path))
    assert file.read() == b"one"
    assert HashedFile.model_validate(file.model_dump()) == file
    path.write_bytes(b"two")
    with pytest.raises(ValueError, match=r"a\.hdr has changed"):
        file.read()
    assert HashedFile.model_validate(str(path)) != file


def test_a_file_on_record_need_not_be_there_and_a_new_one_must(tmp_path):
    gone = str(tmp_path / "gone.hdr")
    on_record = Panorama.model_validate({"file": {"path": gone, "sha256": "0" * 64}})
    assert on_record.file.path == gone
    with pytest.raises(ValidationError, match=r"gone\.hdr cannot be read \(no such file"):
        Panorama.model_validate({"file": gone})


def test_other_kinds_of_files_are_refused_by_name(tmp_path):
    path = tmp_path / "a.jpg"
    path.write_bytes(b"")
    with pytest.raises(ValidationError, match="is not an HDR, EXR or PNG file"):
        Panorama.model_validate({"file": str(path)})


def test_sun_points_lie_on_the_disc_and_have_its_center_as_their_mean():
    sun = Light(level="daylight").lighting().sun
    points = sun.points(64)
    angle = np.degrees(np.arccos(np.clip(points @ sun.direction, -1, 1)))
    assert angle.max() <= 0.265
    # Half of an even disc lies within 1/√2 of its radius.
    assert (angle < 0.265 / np.sqrt(2)).mean() == pytest.approx(0.5, abs=1 / 64)
    np.testing.assert_allclose(points.mean(axis=0), sun.direction, atol=2e-4)
