"""Card and contact sheet say what is there, and link to nothing outside."""

import base64
import io
import re
import shutil

import pytest
from PIL import Image

from megalopta.cli import main
from megalopta.report.dataset_card import plain_text


@pytest.fixture(scope="module")
def root(small_dataset, tmp_path_factory):
    folder = tmp_path_factory.mktemp("shown") / "data"
    shutil.copytree(small_dataset, folder, symlinks=True)
    main.main(["report", str(folder)])
    return folder


def test_the_card_tells_sizes_splits_and_statistics(root):
    text = (root / "README.md").read_text("utf-8")
    assert "3 sequences, 9 frames of 32 × 24 px" in text
    for words in (
        "| scene: plane |",
        "| 0.1 |",
        "SNR of a pixel",
        "`train`",
        "CC0-1.0",
        "median depth, m",
    ):
        assert words in text
    assert not re.search(r"[{}]", text)
    for picture in re.findall(r"\]\((\S+)\)", text):
        with Image.open(root / picture) as image:
            assert image.width > 300


def test_the_contact_sheet_has_four_clips_of_every_sequence(root):
    text = (root / "index.html").read_text("utf-8")
    gifs = re.findall(r'src="data:image/gif;base64,([^"]+)"', text)
    assert len(gifs) == 3 * 4
    frames = [Image.open(io.BytesIO(base64.b64decode(each))).n_frames for each in gifs[:4]]
    assert frames[0] == 2  # the third has no successor, and so no motion
    assert set(frames) <= {1, 2}  # equal pictures, as of the depth of a plane, are one
    assert "http" not in text


def test_names_of_strangers_are_shown_as_they_stand():
    text = plain_text("a | b\n# <script>x</script> ![i](http://x) `c` *d* _e_ \x1b[31m & more")
    assert "\n" not in text and "\x1b" not in text and "<" not in text
    assert not re.search(r"(?<!\\)[|#*_`\[\]!]", text)
    assert text.startswith(r"a \| b \# &lt;script&gt;x")
