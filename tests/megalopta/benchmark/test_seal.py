"""A challenge: inputs that hold nothing of the truth, and a truth that cannot be exchanged."""

import hashlib
import json
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from megalopta import open_dataset
from megalopta.benchmark.scores import score_submissions
from megalopta.benchmark.seal import seal_dataset
from megalopta.cli import main as cli
from megalopta.config.drawing import configuration_of
from megalopta.config.recipe import Plan, load_plan
from megalopta.core import files
from megalopta.core.errors import UserError
from megalopta.core.pictures import png_parts

from ..small import content


@pytest.fixture(scope="module")
def sealed(whole, tmp_path_factory):
    """The folder of a sealed dataset, not to be changed."""
    return seal_dataset(whole, tmp_path_factory.mktemp("sealed") / "challenge")


@pytest.fixture
def copied(sealed, tmp_path):
    """A copy of it, to be changed, and the flow of a perfect program."""
    shutil.copytree(sealed, folder := tmp_path / "challenge")
    shutil.copytree(folder / "truth/flow", perfect := tmp_path / "perfect")
    return folder, perfect


def test_inputs_hold_counts_pictures_and_cameras_and_nothing_of_the_truth(whole, sealed):
    sequence, inputs = open_dataset(whole)[0], sealed / "inputs"
    name, exposure = sequence.name, sequence.exposures[0]
    names = {re.sub(r"\d{4}", "N", path) for path in content(inputs)}
    assert names == {
        *("SHA256SUMS", "TRUTH-HMAC-SHA256", "cameras.json"),
        *(f"counts/{name}/{exposure}.npy", f"final/{name}/frame_N.png"),
    }
    counts = np.load(inputs / "counts" / name / f"{exposure}.npy")
    np.testing.assert_array_equal(counts, np.asarray(sequence.counts(exposure)))
    for path in (inputs / "final" / name).glob("*.png"):
        assert {part for part, _ in png_parts(path.read_bytes())} == {b"IHDR", b"IDAT", b"IEND"}
    said = "".join(path.read_text() for path in inputs.iterdir() if path.is_file())
    camera = json.loads((inputs / "cameras.json").read_text())[name]
    assert camera["exposure_s"] == {"spadcam": sequence.configuration.sensors[0].exposure_s}
    assert set(camera["camera"]) == {"kind", "width", "height", "fov_deg"}
    for word in ("seed", "scene", "trajectory", "rotation", "position", "pose", "velocity"):
        assert word not in said
    # neither the flow nor a hash by which a guess of it could be confirmed
    true = {path: (sealed / "truth" / path).read_bytes() for path in content(sealed / "truth")}
    plain = [hashlib.new(kind, each) for kind in ("sha256", "md5") for each in true.values()]
    plain += [hashlib.blake2b(each, digest_size=16) for each in true.values()]
    hidden = [hash_of for hash_of in plain if hash_of.hexdigest() in said]
    assert [hash_of.hexdigest() for hash_of in hidden] == [
        hashlib.sha256(true[path]).hexdigest() for path in true if path.startswith("final/")
    ]
    assert (sealed / "truth/KEY").read_text().split()[0] not in said
    keyed = (inputs / "TRUTH-HMAC-SHA256").read_text().splitlines()
    assert len({line.split()[0] for line in keyed}) == len(true) - 1  # equal files differ, too
    subprocess.run(["sha256sum", "--quiet", "-c", "SHA256SUMS"], cwd=inputs, check=True)


def test_a_sealed_truth_scores_as_the_truth_itself(whole, copied, tmp_path, capsys):
    folder, perfect = copied
    out = tmp_path / "scores.json"
    cli.main(["benchmark", "submit", str(perfect), "--truth", str(folder), "--out", str(out)])
    *_, entry = json.loads(out.read_text())["entries"]
    assert entry["errors"]["all"]["epe_px"] == 0
    *_, plain = score_submissions([perfect], whole / "training").entries
    assert entry["errors"] == plain.model_dump(mode="json")["errors"]
    # a hash of the truth without the key would confirm guesses
    sums = (folder / "inputs/SHA256SUMS").read_bytes()
    assert entry["truth_hash"] == hashlib.sha256(sums).hexdigest() != plain.truth_hash


def test_a_changed_truth_and_other_inputs_are_refused(whole, copied, tmp_path):
    folder, perfect = copied
    truth, inputs = folder / "truth", folder / "inputs"

    def refusal(*places):
        with pytest.raises(UserError) as refused:
            score_submissions([perfect], *places[:1], inputs=(*places, None)[1])
        return str(refused.value)

    other = seal_dataset(whole, tmp_path / "other")
    assert "SHA256SUMS is not that of this truth" in refusal(truth, other / "inputs")
    inputs.rename(tmp_path / "published")
    assert "inputs is missing" in refusal(truth)
    score_submissions([perfect], truth, inputs=tmp_path / "published")
    (tmp_path / "published").rename(inputs)
    flow = sorted(truth.glob("flow/*/*.flo"))[0]
    exact = flow.read_bytes()
    flow.write_bytes(exact[:-1] + b"?")
    assert f"{flow.name} differs from its published hash" in refusal(truth)
    flow.unlink()
    assert f"{flow.name} differs from its published hash" in refusal(truth)
    flow.write_bytes(exact)
    (added := flow.with_name("frame_0099.flo")).write_bytes(exact)
    assert "frame_0099.flo differs from its published hash" in refusal(flow.parents[1])
    added.unlink()
    (inputs / "TRUTH-HMAC-SHA256").write_text("")
    assert "TRUTH-HMAC-SHA256 was changed" in refusal(truth)
    (truth / "KEY").write_text("0")
    assert "restore the truth that was sealed" in refusal(truth)
    assert "it is not sealed" in refusal(whole, inputs)


def test_a_killed_run_leaves_nothing_and_the_same_command_seals(whole, tmp_path, monkeypatch):
    out = tmp_path / "challenge"
    half = tmp_path / ".part-0123456789ab-challenge"
    (half / "inputs").mkdir(parents=True)
    monkeypatch.setattr(files, "write_json", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        seal_dataset(whole, out)
    monkeypatch.undo()
    assert not list(tmp_path.iterdir())
    assert {path.name for path in seal_dataset(whole, out).iterdir()} == {"inputs", "truth"}
    assert (out / "truth").stat().st_mode & 0o77 == 0
    with pytest.raises(UserError, match="exists"):
        seal_dataset(whole, out)


def test_the_challenge_takes_a_secret_seed_that_nobody_finds_by_trying():
    seed = 2**126 + 12345
    plan = load_plan(Path("challenge"), {"seed": str(seed)})
    drawn = [configuration_of(plan, index) for index in range(plan.sequences)]
    assert [settings.camera.width for settings in drawn] == [96] * 10
    kinds = [settings.scene.kind for settings in drawn]
    assert {kind: kinds.count(kind) for kind in kinds} == {"forest": 6, "grating": 2, "plane": 2}
    others = [configuration_of(plan.model_copy(update={"seed": seed + 1}), 0), drawn[0]]
    assert others[0] != others[1]
    assert max(settings.seed for settings in drawn) > 2**59  # 1e-9 by chance
    assert max(settings.scene.seed for settings in drawn) > 2**48
    # noise of former plans is that of before
    assert configuration_of(Plan(seed=1), 0).seed == 1950011106
