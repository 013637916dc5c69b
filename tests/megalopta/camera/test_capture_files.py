"""Tables of rates, crosstalk and afterpulses: what is none is refused."""

import pytest

from megalopta.camera.capture_files import read_measurement
from megalopta.core.errors import UserError


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "empty"),
        ("1,2\n3,four", "could not convert"),
        ("1,2\n3,4", "4 rates, of which 24 are needed"),
        ("pix1,pix2,distance,crosstalk,error\n0,1,1,1e-3,1e-5", "1 pairs"),
        ("events,duration_s,1-2\n5,1,3", "1 pixels with events"),
    ],
)
def test_other_files_are_refused_in_a_sentence(tmp_path, text, message):
    path = tmp_path / "other.csv"
    path.write_text(text)
    with pytest.raises(UserError, match=message):
        read_measurement(path)
