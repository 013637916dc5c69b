import csv
import json
import os
import subprocess
import sys
import time
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from megalopta.core.errors import UserError
from megalopta.plotting.picture import Figure
from megalopta.reproduction.drawing import GROUPS, names, reproduce, side_by_side, write_figure

from ..process_group import in_a_group, members, wait_for


def draw(canvas):
    axes = canvas.subplots()
    axes.plot([0, 1], [0, 2], label="line")
    axes.set_xlabel("Time (s)")
    axes.legend()


EXAMPLE = Figure(
    name="example",
    title="An example",
    caption="What it shows. " * 20,
    draw=draw,
    numbers={"time_s": (0.0, 1.0), "name": ("a, b", "c"), "output_v": np.array([1 / 3, np.nan])},
)


def test_each_figure_becomes_a_picture_a_drawing_and_its_numbers(tmp_path):
    paths = write_figure(EXAMPLE, tmp_path / "new")
    assert [path.suffix for path in paths] == [".png", ".svg", ".csv", ".json"]
    assert {path.stem for path in paths} == {"example"}
    assert paths[0].read_bytes().startswith(b"\x89PNG")
    assert "<svg" in paths[1].read_text(encoding="utf-8")
    assert sorted(path.name for path in (tmp_path / "new").iterdir()) == sorted(
        path.name for path in paths
    )


def test_numbers_survive_both_files(tmp_path):
    *_, path, record = write_figure(EXAMPLE, tmp_path)
    assert json.loads(record.read_text("utf-8"))["rows"] == [[0.0, "a, b", 1 / 3], [1.0, "c", None]]
    with path.open(newline="", encoding="utf-8") as file:
        head, *rows = csv.reader(file)
    assert tuple(head) == EXAMPLE.columns
    assert rows[0][1] == "a, b"
    assert float(rows[0][2]) == pytest.approx(1 / 3, rel=1e-8)
    assert np.isnan(float(rows[1][2]))


def test_same_figure_gives_the_same_bytes(tmp_path):
    first, second = (write_figure(EXAMPLE, tmp_path / name) for name in "ab")
    for one, other in zip(first, second, strict=True):
        assert one.read_bytes() == other.read_bytes()


def test_failed_figure_leaves_no_file(tmp_path):
    def fail(canvas):
        raise RuntimeError("no ink")

    broken = Figure("", "", fail, {}, name="broken")
    with pytest.raises(RuntimeError, match="no ink"):
        write_figure(broken, tmp_path)
    assert not list(tmp_path.iterdir())


def test_unknown_name_is_refused_with_the_closest_before_anything_is_written(tmp_path):
    out = tmp_path / "out"
    with pytest.raises(UserError, match=r"fig-3\.22.*did you mean fig-3\.2"):
        reproduce(["fig-3.5", "fig-3.22"], out)
    assert not out.exists()


@pytest.mark.parametrize("name", ["out", "out/deeper"])
def test_file_in_place_of_the_folder_is_refused_before_anything_is_drawn(tmp_path, name):
    (tmp_path / "out").touch()
    with pytest.raises(UserError, match="a file is in the way; give the path of a folder"):
        reproduce(["fig-2.9"], tmp_path / name)


def test_no_name_is_refused_with_the_list(tmp_path):
    with pytest.raises(UserError, match=r"fig-3\.2, fig-3\.5"):
        reproduce([], tmp_path)


def test_ragged_numbers_are_refused():
    with pytest.raises(ValueError, match="differ in length"):
        Figure("x", "", draw, {"a": (1.0,), "b": (1.0, 2.0)})


def test_a_figure_is_found_by_its_name_and_under_no_other():
    assert names("chapter-3") == [f"fig-3.{number}" for number in (2, 5, 6, 7, 8, 9, 10)] + [
        "table-3.1"
    ]
    everything = names()
    assert len(everything) == len(set(everything)) > 30
    assert sorted(everything) == sorted(
        name for group in GROUPS if group != "all" for name in names(group)
    )


@pytest.mark.slow
def test_a_figure_loads_no_other_chapter():
    code = (
        "import sys; from megalopta.reproduction.drawing import find; find('fig-3.2'); "
        "print(any('figures.chapter4.' in name for name in sys.modules))"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout == "False\n"


def late(seconds, value):
    time.sleep(seconds)
    return value


def test_results_come_in_the_order_of_the_tasks():
    tasks = [partial(late, 0.2, "first"), partial(late, 0, "second"), lambda: "third"]
    assert list(side_by_side(tasks)) == ["first", "second", "third"]


def test_a_user_s_mistake_comes_through():
    def refuse():
        raise UserError("no ink")

    with pytest.raises(UserError, match="no ink"):
        list(side_by_side([refuse, refuse]))


def test_one_task_and_one_after_mitsuba_run_in_this_process(monkeypatch):
    assert list(side_by_side([os.getpid])) == [os.getpid()]
    running = SimpleNamespace(variant=lambda: "llvm_ad_spectral")
    monkeypatch.setitem(sys.modules, "mitsuba", running)
    assert list(side_by_side([os.getpid, os.getpid])) == [os.getpid()] * 2


@pytest.mark.skipif(sys.platform != "linux" or (os.cpu_count() or 1) < 2, reason="nothing to fork")
def test_figures_are_the_same_bytes_from_one_process_and_from_several(tmp_path):
    # in an interpreter without Mitsuba, which other tests may have started here
    code = (
        "import os, sys; from pathlib import Path; from megalopta.reproduction.drawing import reproduce\n"
        "from megalopta.reproduction import drawing as module\n"
        "if sys.argv[2] == 'alone': module.os.cpu_count = lambda: 1\n"
        "reproduce(['fig-2.2', 'fig-3.2', 'table-2.1'], Path(sys.argv[1]))\n"
    )
    for name in ("alone", "together"):
        subprocess.run([sys.executable, "-c", code, str(tmp_path / name), name], check=True)
    paths = sorted(path.name for path in (tmp_path / "alone").glob("*.*"))
    assert len(paths) == 12
    for name in paths:
        alone, together = (tmp_path / form / name for form in ("alone", "together"))
        assert alone.read_bytes() == together.read_bytes()


@pytest.mark.skipif(sys.platform != "linux" or (os.cpu_count() or 1) < 2, reason="nothing to fork")
def test_forked_processes_end_with_a_parent_that_was_killed(tmp_path):
    code = (
        "import sys, time; from pathlib import Path\n"
        "from megalopta.reproduction.drawing import side_by_side\n"
        "def draw(): Path(sys.argv[1], str(time.monotonic_ns())).touch(); time.sleep(60)\n"
        "list(side_by_side([draw, draw]))\n"
    )
    with in_a_group([sys.executable, "-c", code, tmp_path]) as parent:
        wait_for(lambda: len(list(tmp_path.iterdir())) == 2)
        assert len(members(parent.pid)) == 3
        parent.kill()
        wait_for(lambda: not members(parent.pid), 5)
