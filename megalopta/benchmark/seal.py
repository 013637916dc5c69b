"""A dataset for a challenge, split: inputs, which anybody may have, and truth, kept by its host.

**Only what is listed here enters the inputs**: counts as plain arrays, 8-bit pictures of counts
without metadata (noise-free ones only if there are no counts), projection, frame rate, exposure.
From scenes, seeds, paths, mounts, IMU, EXR headers, attributes of Zarr stores, means without noise,
plan, records and index, truth could be read, or rendered again.

**Hashes.** Inputs publish HMAC-SHA-256 (RFC 2104) of every file of the truth, with a random key
that truth alone has. Plain hashes would confirm guesses: of a seed, by rendering again, or of a
flow. Once truth is published, everyone can verify that it is what was sealed.
"""

import hashlib
import hmac
import secrets
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from megalopta.config.drawing import SECRET_SEED
from megalopta.core import bounded, files
from megalopta.core.errors import UserError
from megalopta.core.folders import locked
from megalopta.core.pictures import checked_png
from megalopta.core.progress import progress, say
from megalopta.dataset.sequence import Sequence
from megalopta.dataset.store import Tree

_KEY, _TRUTH, _SUMS = "KEY", "TRUTH-HMAC-SHA256", "SHA256SUMS"


def seal_dataset(root: Path, out: Path) -> Path:
    """Split a rendered dataset into the folders `inputs` and `truth` of a new folder; return that.

    It appears once complete. Raises UserError if the folder exists, or the dataset is unfinished,
    damaged or made of pictures.
    """
    tree, out = Tree(root.absolute()), out.absolute()
    plan, names = tree.plan, tree.names()
    if out.exists() or out.is_relative_to(tree.root):
        raise UserError(f"{out}: exists, or is in the dataset; give a new folder elsewhere")
    if not names or (plan and len(names) < plan.sequences):
        raise UserError(f"{root}: not all sequences are finished; run: {tree.make_again}")
    if (seed := plan.seed if plan else 0) < SECRET_SEED:
        say(
            f"{root}: who knows its settings and finds its seed, {seed}, can render the truth "
            "again; make a dataset with a secret seed of more than 20 digits"
        )
    is_alone, making = locked(out.parent, f".{out.name}.lock"), files.atomic_write(out)
    with is_alone, making as part, progress("Sealing", len(names), "sequence") as advance:
        for path in filter(files.is_temporary, out.parent.glob(f".part-*-{out.name}")):
            files.remove(path)  # of a killed run
        inputs, truth, cameras = part / "inputs", part / "truth", {}
        truth.mkdir(mode=0o700, parents=True)
        for name in names:
            cameras[name] = _split(Sequence(tree.opened(name)), inputs, truth)
            advance(1)
        files.write_json(inputs / "cameras.json", cameras)
        key = secrets.token_bytes(32)
        (inputs / _TRUTH).write_text(_sums(truth, key))
        (inputs / _SUMS).write_text(sums := _sums(inputs))
        (truth / _KEY).write_text(f"{key.hex()} {hashlib.sha256(sums.encode()).hexdigest()}\n")
    return out


def _split(sequence: Sequence, inputs: Path, truth: Path) -> dict[str, Any]:
    """Write what either may have of a sequence; return what the inputs say of its camera."""
    dataset, settings = sequence.dataset, sequence.configuration
    dataset.require_truth()
    for exposure in sequence.exposures:
        counts = sequence.counts(exposure)
        path = inputs / "counts" / sequence.name / f"{exposure}.npy"
        path.parent.mkdir(parents=True, exist_ok=True)
        stored = np.lib.format.open_memmap(path, "w+", counts.dtype, counts.shape)
        for index in range(len(counts)):
            stored[index] = counts[index]
    pictures = "final" if sequence.exposures else "clean"  # flow of clean ones is nearly the truth
    for file in dataset.files:
        folder, kind, *below = Path(file).parts
        if folder != "training" or kind not in {"flow", "occlusions", "invalid", pictures}:
            continue
        content = bounded.read_bytes(dataset.compared(dataset.root / file), bounded.ARRAY_BYTES)
        if kind == pictures:
            content = checked_png(content, (b"IHDR", b"PLTE", b"IDAT", b"IEND"))
        for place in (truth, inputs) if kind == pictures else (truth,):
            path = place.joinpath(kind, *below)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
    sensors = dataset.former.exposures or settings.sensors
    return {
        "frames": len(sequence),
        "frame_rate_hz": settings.trajectory.frame_rate_hz,
        "exposure_s": {sensor.name: sensor.exposure_s for sensor in sensors},
        "camera": settings.camera.model_dump(mode="json"),
    }


def opened_seal(truth: Path, inputs: Path | None = None) -> str | None:
    """Verify a sealed truth with the published inputs; return their hash, or None if not sealed.

    `truth` is its folder, the one above or one below; `inputs` lie next to it by default. Raises
    UserError if either was changed, or they do not belong together.
    """
    homes = (truth / "truth", truth, *truth.resolve().parents)
    home = next((folder for folder in homes if (folder / _KEY).is_file()), None)
    if home is None:
        if inputs:
            raise UserError(f"{truth}: has no {_KEY}, so it is not sealed; omit {inputs}")
        return None
    with bounded.undamaged(home / _KEY, "restore the truth that was sealed"):
        key, expected = bounded.read_text(home / _KEY).split()
        sums_of_truth = _sums(home, bytes.fromhex(key))
    inputs = inputs or home.resolve().parent / "inputs"
    with bounded.undamaged(inputs, "give the inputs that were published with this truth"):
        sums, published = (bounded.read_text(inputs / name) for name in (_SUMS, _TRUTH))
        if hashlib.sha256(sums.encode()).hexdigest() != expected:
            raise ValueError(f"{_SUMS} is not that of this truth")
        if hashlib.sha256(published.encode()).hexdigest() not in sums:
            raise ValueError(f"{_TRUTH} was changed")
    if changed := set(sums_of_truth.splitlines()) ^ set(published.splitlines()):
        raise UserError(
            f"{home / min(changed)[66:]} differs from its published hash; restore the truth that "
            "was sealed"
        )
    return expected


def _sums(folder: Path, key: bytes = b"") -> str:
    """Return the hashes of a folder's files, as `sha256sum` prints them; with a key, their HMAC."""
    lines = []
    for path in sorted(path for path in folder.rglob("*") if path.is_file() and path.name != _KEY):
        name = path.relative_to(folder).as_posix()
        # with the name: equal files, such as those of a steady motion, have different hashes
        kind = partial(hmac.new, key, f"{name}\0".encode(), "sha256") if key else hashlib.sha256
        with path.open("rb") as file:
            lines.append(f"{hashlib.file_digest(file, kind).hexdigest()}  {name}\n")
    return "".join(lines)
