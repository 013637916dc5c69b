"""Nothing in a folder leads out of it."""

import os
import socket

import pytest

from megalopta.core.bounded import TEXT_BYTES
from megalopta.core.enclosure import check_enclosed, check_no_links
from megalopta.core.errors import UserError


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "data" / "a").mkdir(parents=True)
    (tmp_path / "data" / "a" / "b").write_text("")
    return tmp_path / "data"


def test_links_to_what_is_inside_are_let_in(folder):
    (folder / "up").symlink_to("a/b")
    (folder / "a" / "absolute").symlink_to(folder / "a", target_is_directory=True)
    (folder / "a" / "nowhere").symlink_to("gone")
    check_enclosed(folder)


@pytest.mark.parametrize("target", ["../..", "../../other", "/dev/zero", "/nowhere", "b/../../.."])
def test_a_link_that_leads_out_is_named(folder, target):
    (folder / "a" / "link").symlink_to(target)
    with pytest.raises(UserError, match="link: a link that leads out of .*; remove it, or put"):
        check_enclosed(folder)


def test_pipes_and_sockets_are_named(folder):
    os.mkfifo(folder / "a" / "pipe")
    with pytest.raises(UserError, match="pipe: neither a file nor a folder; remove it"):
        check_enclosed(folder)
    (folder / "a" / "pipe").unlink()
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(str(folder / "s"))
        with pytest.raises(UserError, match="s: neither a file nor a folder"):
            check_enclosed(folder)


def test_metadata_that_zarr_would_read_whole_is_bounded(folder):
    with (folder / "zarr.json").open("wb") as file:
        file.truncate(TEXT_BYTES + 1)
    with pytest.raises(UserError, match=r"zarr\.json: larger than 67 MB"):
        check_enclosed(folder)


def test_links_are_named_where_there_may_be_none(folder):
    check_no_links(folder)
    check_no_links(folder / "a" / "b")
    (folder / "a" / "c").symlink_to("b")
    for path in (folder, folder / "a" / "c"):
        with pytest.raises(UserError, match="c: a link in the place of a file; remove it"):
            check_no_links(path)
