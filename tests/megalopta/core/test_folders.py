"""A folder is refused if a link leads out of it, whatever way the link takes."""

import os
from pathlib import Path

import pytest

from megalopta.core.errors import UserError
from megalopta.core.folders import check_enclosed

TARGETS = {
    "file": True,
    "../inside/file": True,
    "../inside/./file": True,
    "../inside/../inside/file": True,
    "missing": True,
    "hop": True,
    "{root}/inside/file": True,
    "..": True,
    "../inside/": True,
    ".": True,
    "loop": True,
    "../..": False,
    "../../data-2/file": False,
    "../../secret": False,
    "../inside/../..": False,
    "../inside/../../secret": False,
    "hop/../../../secret": False,
    "{root}/../secret": False,
    "/etc/passwd": False,
    "/": False,
}


@pytest.mark.parametrize(("target", "is_inside"), TARGETS.items())
def test_links_are_followed_as_the_system_follows_them(tmp_path, target, is_inside):
    root = tmp_path / "data"
    for folder in ("inside", "other/deep"):
        (root / folder).mkdir(parents=True)
    (root / "inside/file").touch()
    (root / "inside/hop").symlink_to("../other/deep")
    (tmp_path / "secret").touch()
    (link := root / "inside/loop").symlink_to(target.format(root=root))
    real = Path(os.path.realpath(link))
    assert real.is_relative_to(os.path.realpath(root)) == is_inside
    if is_inside:
        check_enclosed(root)
    else:
        with pytest.raises(UserError, match=r"a link that leads out of .*, to .*; remove it"):
            check_enclosed(root)


def test_a_link_to_a_link_out_of_the_folder_is_refused(tmp_path):
    (tmp_path / "data").mkdir()
    (tmp_path / "data/first").symlink_to("second")
    (tmp_path / "data/second").symlink_to("../secret")
    with pytest.raises(UserError, match="leads out of"):
        check_enclosed(tmp_path / "data")
