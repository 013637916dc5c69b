"""Flow of other programs, scored through the command line."""

import json
import shutil

import cv2
import numpy as np
import pytest
from PIL import Image

from megalopta.benchmark.scores import Scores, score_submissions
from megalopta.cli import main as cli
from megalopta.core.errors import UserError
from megalopta.flow.detectors.gray_detector import detector_from
from megalopta.flow.formats import write_flo

SHAPE = (60, 80)
MOTIONS = ((2, 1), (-3, 0))


def pictures():
    """Two sequences of two frames whose texture moves as a whole, from black to white."""
    for index, motion in enumerate(MOTIONS):
        random = np.random.default_rng(index).random((100, 120))
        texture = cv2.GaussianBlur(random, (0, 0), 1.5)
        texture = np.rint(255 * (texture - texture.min()) / np.ptp(texture)).astype(np.uint8)
        first = texture[20:80, 20:100].copy()
        second = texture[20 - motion[1] : 80 - motion[1], 20 - motion[0] : 100 - motion[0]].copy()
        for each in (first, second):
            each[0, :2] = 0, 255  # so that gray levels are not stretched
        yield f"scene_{index}", motion, first, second


@pytest.fixture
def tree(tmp_path):
    """True flow as Sintel lays it out, and that of OpenCV's DIS, written by cv2 alone."""
    truth, submitted, rng = tmp_path / "truth", tmp_path / "dis", np.random.default_rng(0)
    for name, motion, first, second in pictures():
        true = np.broadcast_to(np.float32(motion), (*SHAPE, 2))
        write_flo(truth / "training" / "flow" / name / "frame_0001.flo", true)
        for kind, mask in (("occlusions", 255 * (rng.random(SHAPE) < 0.2)), ("invalid", 0)):
            path = truth / "training" / kind / name / "frame_0001.png"
            path.parent.mkdir(parents=True)
            Image.fromarray(np.broadcast_to(mask, SHAPE).astype(np.uint8)).save(path)
        dis = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
        found = dis.calc(first, second, None)
        path = submitted / "clean" / name / "frame0001.flo"
        path.parent.mkdir(parents=True)
        assert cv2.writeOpticalFlow(str(path), found)
    return truth, submitted


def submit(capsys, truth, flow, *words):
    words = truth.parent / "scores.json", "--truth", truth, flow, *words
    cli.main(["benchmark", "submit", "--out", *map(str, words)])
    return capsys.readouterr().out


@pytest.fixture
def told(refused):
    """Submits flow that is refused, and returns what is said."""
    return lambda truth, *flows: refused("benchmark", "submit", *flows, "--truth", truth)


def test_scores_are_those_of_an_independent_script(tree, tmp_path, capsys):
    truth, submitted = tree
    out = tmp_path / "scores.json"
    printed = submit(capsys, truth, submitted, "--out", out)
    assert "overall" in printed

    epe, hidden = [], []
    for path in sorted(submitted.glob("clean/*/*.flo")):
        raw = np.fromfile(path, "<f4")[3:].reshape(*SHAPE, 2)
        scene = truth / "training" / "flow" / path.parent.name / "frame_0001.flo"
        true = np.fromfile(scene, "<f4")[3:].reshape(*SHAPE, 2)
        epe.append(np.linalg.norm(raw - true, axis=-1))
        mask = truth / "training" / "occlusions" / path.parent.name / "frame_0001.png"
        hidden.append(np.asarray(Image.open(mask)) > 0)
    epe, hidden = np.array(epe), np.array(hidden)

    scores = json.loads(out.read_text())
    *sequences, entry = scores["entries"]
    assert [(each["sequence"], each["frames"]) for each in sequences] == [
        ("scene_0", 1),
        ("scene_1", 1),
    ]
    assert (entry["pass_name"], entry["sequence"], entry["frames"]) == ("clean", None, 2)
    overall = entry["errors"]
    assert overall["all"]["epe_px"] == pytest.approx(epe.mean(), rel=1e-6)
    assert overall["visible"]["epe_px"] == pytest.approx(epe[~hidden].mean(), rel=1e-6)
    assert overall["occluded"]["epe_px"] == pytest.approx(epe[hidden].mean(), rel=1e-6)
    assert overall["all"]["over_1px_percent"] == pytest.approx(100 * (epe > 1).mean())
    assert overall["fast"]["epe_px"] is None
    first = sequences[0]["errors"]["all"]
    assert first["epe_px"] == pytest.approx(epe[0].mean(), rel=1e-6)


def with_pictures(truth):
    for name, _, *frames in pictures():
        for number, frame in enumerate(frames, start=1):
            path = truth / "training" / "clean" / name / f"frame_{number:04}.png"
            path.parent.mkdir(parents=True, exist_ok=True)
            Image.fromarray(frame).save(path)


def test_a_method_is_scored_as_the_files_that_it_would_write(tree, tmp_path, capsys):
    truth, submitted = tree
    with_pictures(truth)
    out = tmp_path / "scores.json"
    submit(capsys, truth, "dis", "--out", out)
    *_, entry = json.loads(out.read_text())["entries"]
    *_, files = score_submissions([submitted], truth).entries
    assert (entry["program"], entry["pass_name"]) == ("DIS", "clean")
    assert entry["truth_hash"] == files.truth_hash
    for group in ("all", "visible", "occluded"):
        assert entry["errors"][group]["epe_px"] == pytest.approx(
            files.errors[group]["epe_px"], rel=1e-6
        )
    nothing = detector_from(lambda a, b: np.full((*a.shape, 2), np.nan), "nothing")
    with pytest.raises(UserError, match="nothing on .*: no flow where the truth is known"):
        score_submissions([nothing], truth)
    *_, still = score_submissions([lambda a, b: np.zeros((*a.shape, 2))], truth).entries
    speeds = [np.hypot(*motion) for motion in MOTIONS]
    assert still.errors["all"]["epe_px"] == pytest.approx(np.mean(speeds))


def test_frames_must_pair_strictly(tree, told):
    truth, submitted = tree
    some = submitted / "clean" / "scene_1" / "frame0001.flo"
    extra = some.with_name("frame0009.flo")
    shutil.copy(some, extra)
    text = told(truth, submitted)
    assert "frame0009.flo matches no frame" in text
    extra.unlink()
    some.unlink()
    text = told(truth, submitted)
    assert "lacks 1 of 2 frames, the first is scene_1/frame_0001" in text


def test_mistakes_get_one_sentence(tree, tmp_path, told):
    truth, submitted = tree
    path = submitted / "clean" / "scene_0" / "frame0001.flo"
    whole = path.read_bytes()
    path.write_bytes(whole[:-4])
    assert "frame0001.flo" in told(truth, submitted)
    write_flo(path, np.zeros((30, 40, 2)))
    text = told(truth, submitted)
    assert "frame0001.flo" in text and "a flow of 40 × 30 px, the truth has 80 × 60" in text
    path.write_bytes(whole)
    assert "no such folder" in told(truth, tmp_path / "none")
    path.write_bytes(whole[:-4])  # is not read before
    assert "BM gives no dense flow" in told(truth, submitted, "BM")
    path.write_bytes(whole)
    np.save(path.with_suffix(".npy"), np.zeros((*SHAPE, 2)))
    assert "holds .flo and .npy: give one format" in told(truth, submitted)
    path.with_suffix(".npy").unlink()


def test_programs_are_compared_in_one_table(tree, tmp_path, capsys):
    truth, submitted = tree
    perfect, out = tmp_path / "perfect", tmp_path / "scores.json"
    shutil.copytree(truth / "training" / "flow", perfect)
    printed = submit(capsys, truth, submitted, perfect, "--out", out)
    overall = [each for each in json.loads(out.read_text())["entries"] if not each["sequence"]]
    assert [(each["program"], each["pass_name"]) for each in overall] == [
        ("dis", "clean"),
        ("perfect", ""),
    ]
    assert overall[1]["errors"]["all"]["epe_px"] == 0
    assert overall[1]["errors"]["all"]["wauc_percent"] == 100
    assert "perfect" in printed and "dis" in printed


def test_confidence_next_to_flow_is_scored_by_the_order_of_its_pixels(tree, told, capsys):
    truth, submitted = tree
    paths = sorted(submitted.glob("clean/*/*.flo"))
    *_, without = score_submissions([submitted], truth).entries
    assert set(without.errors["confidence"].values()) == {None}
    for path in paths:
        motion = np.float32(MOTIONS[int(path.parent.name[-1])])
        error = np.hypot(*(cv2.readOpticalFlow(str(path)) - motion).transpose(2, 0, 1))
        np.save(path.with_name(f"{path.stem}.uncertainty.npy"), error)
    *_, entry = score_submissions([submitted], truth).entries
    confidence = entry.errors["confidence"]
    assert {**entry.errors, "confidence": 0} == {**without.errors, "confidence": 0}
    assert confidence["ause"] == pytest.approx(0, abs=1e-12)
    assert 0.2 < confidence["ause_random"] < 1
    assert confidence["surest_half_px"] < entry.errors["all"]["epe_px"]
    assert f"{confidence['ause_random']:.3g}" in submit(capsys, truth, submitted)

    stated = paths[0].with_name(f"{paths[0].stem}.uncertainty.npy")
    stated.unlink()  # then its pixels are the least sure
    *_, entry = score_submissions([submitted], truth).entries
    assert entry.errors["confidence"]["ause"] > 1e-3
    for values in (np.zeros(SHAPE) - 1, np.zeros((3, 4)), np.zeros(SHAPE, int)):
        np.save(stated, values)
        assert stated.name in told(truth, submitted)
    np.save(stated, np.zeros(SHAPE))
    paths[0].unlink()
    assert f"{stated.name} has no flow file of its name" in told(truth, submitted)


def test_methods_have_the_confidence_that_they_state_or_forward_backward_consistency(tree):
    truth, _ = tree
    with_pictures(truth)
    *_, stated, _, _, consistent = score_submissions(["PF", "dis"], truth).entries
    assert (stated.program, consistent.program) == ("PF", "DIS")
    for entry in (stated, consistent):  # errors are at the edges of the image
        confidence = entry.errors["confidence"]
        assert 0 < confidence["ause"] < 0.6 * confidence["ause_random"]


def test_programs_of_one_name_are_refused(tree, told, tmp_path):
    truth, submitted = tree
    shutil.copytree(submitted, again := tmp_path / "again" / "dis")
    assert "dis: 2 programs of this name" in told(truth, submitted, again)


def test_scores_of_the_former_format_are_read(tree):
    truth, submitted = tree
    former = score_submissions([submitted], truth).model_dump(mode="json") | {"format": 2}
    for entry in former["entries"]:
        entry["format"] = 2
        del entry["errors"]["confidence"]
    assert Scores.model_validate(former).entries[0].errors["all"]["epe_px"] > 0
