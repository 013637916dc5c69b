"""A dataset for a challenge, split: inputs, which anybody may have, and truth, kept by its host.

**Only what is listed here enters the inputs**: counts as plain arrays, 8-bit pictures without
metadata, the cameras' projection, frame rate and exposure. Scenes, seeds, paths, mounts and IMU,
EXR headers, attributes of Zarr stores, means without noise, plan, records and index do not: from
them truth could be read, or rendered again. Nor do noise-free pictures, unless asked for or there
are no counts, as flow between them is nearly the truth.

**Hashes.** Inputs publish HMAC-SHA-256 (RFC 2104) of every file of the truth, with 32 random bytes
as key, which truth alone has. A plain hash would confirm guesses: of a seed, by rendering a scene
again, or of a flow. Without the key none can be tested. Once the host publishes the truth, everyone
can verify that it is the one that was sealed. It also has the hash of the inputs that belong to it.
"""

import hashlib
import hmac
import secrets
from contextlib import ExitStack
from pathlib import Path

import numpy as np
from pydantic import Field

from megalopta.config.drawing import SECRET_SEED
from megalopta.core import bounded, files
from megalopta.core.errors import UserError
from megalopta.core.folders import locked
from megalopta.core.format_numbers import FORMATS, check_format
from megalopta.core.pictures import checked_png
from megalopta.core.progress import progress, say
from megalopta.core.record import Record
from megalopta.core.validation import checked
from megalopta.dataset.sequence import Sequence
from megalopta.dataset.store import Tree
from megalopta.scenes.hashed_file import sha256_of
from megalopta.sensor import open_counts

_TRUTH = ("flow", "occlusions", "invalid")
_SEAL, _SUMS = "seal.json", "SHA256SUMS"


class TruthSeal(Record, frozen=True):
    """`seal.json` of the truth."""

    format: int = FORMATS["seal"].written
    key: str = Field(pattern="^[0-9a-f]{64}$")
    """Key of the hashes (hexadecimal)"""
    inputs_sha256: str
    """Hash of the list of all files of the inputs, SHA256SUMS"""


class InputsSeal(Record, frozen=True):
    """`seal.json` of the inputs."""

    format: int = FORMATS["seal"].written
    truth: dict[str, str]
    """HMAC-SHA-256 (hexadecimal) of the files of the truth, by path"""


def seal_dataset(root: Path, out: Path, with_clean: bool = False) -> Path:
    """Split a rendered dataset into the folders `inputs` and `truth` of a new folder; return that.

    It appears once complete. `with_clean`: inputs have the noise-free pictures, too. Raises
    UserError if the folder exists, or the dataset is unfinished, damaged or made of pictures.
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
    with ExitStack() as stack:
        stack.enter_context(locked(out.parent, f".{out.name}.lock"))
        for path in filter(files.is_temporary, out.parent.glob(f".part-*-{out.name}")):
            files.remove(path)  # of a killed run
        part = stack.enter_context(files.atomic_write(out))
        inputs, truth, cameras = part / "inputs", part / "truth", {}
        truth.mkdir(mode=0o700, parents=True)
        advance = stack.enter_context(progress("Sealing", len(names), "sequence"))
        for name in names:
            cameras[name] = _split(Sequence(tree.opened(name)), inputs, truth, with_clean)
            advance(1)
        files.write_json(inputs / "cameras.json", cameras)
        key = secrets.token_bytes(32)
        hashes = {name: _hmac(key, truth, name) for name in _names_in(truth)}
        files.write_text(inputs / _SEAL, InputsSeal(truth=hashes).model_dump_json(indent=1))
        sums = [f"{sha256_of(inputs / name)}  {name}\n" for name in _names_in(inputs)]
        files.write_text(inputs / _SUMS, "".join(sums))
        sealed = TruthSeal(key=key.hex(), inputs_sha256=sha256_of(inputs / _SUMS))
        files.write_text(truth / _SEAL, sealed.model_dump_json(indent=1))
    return out


def _split(sequence: Sequence, inputs: Path, truth: Path, with_clean: bool) -> dict[str, object]:
    """Write what either may have of a sequence; return what the inputs say of its camera."""
    dataset, name, exposures = sequence.dataset, sequence.name, {}
    dataset.require_truth()
    for exposure in sequence.exposures:
        counts, path = sequence.counts(exposure), inputs / "counts" / name / f"{exposure}.npy"
        path.parent.mkdir(parents=True, exist_ok=True)
        stored = np.lib.format.open_memmap(path, "w+", counts.dtype, counts.shape)
        for index in range(len(counts)):
            stored[index] = counts[index]
        stored.flush()
        store = dataset.store(dataset.root / "counts" / name / f"{exposure}.zarr")
        exposure_s = open_counts(store).sensor.exposure_s
        exposures[exposure] = {"unit": counts.unit, "exposure_s": exposure_s}
    pictures = {"final", "clean"} if with_clean or not exposures else {"final"}
    for file in dataset.files:
        folder, kind = Path(file).parts[:2]
        if folder != "training" or kind not in {*_TRUTH, *pictures}:
            continue
        content = bounded.read_bytes(dataset.compared(dataset.root / file), bounded.ARRAY_BYTES)
        if kind in pictures:
            content = checked_png(content, (b"IHDR", b"PLTE", b"IDAT", b"IEND"))
        for place in (truth, inputs) if kind in pictures else (truth,):
            path = place / kind / name / Path(file).name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
    settings = sequence.configuration
    intrinsics = sequence.intrinsics
    return {
        "frames": len(sequence),
        "frame_rate_hz": settings.trajectory.frame_rate_hz,
        "camera": settings.camera.model_dump(mode="json"),
        "intrinsics_px": None if intrinsics is None else intrinsics.tolist(),
        "counts": exposures,
    }


def opened_seal(truth: Path, inputs: Path | None = None) -> str | None:
    """Verify a sealed truth with the published inputs; return their hash, or None if not sealed.

    `truth` is its folder, the one above or one below; `inputs` lie next to it by default. Raises
    UserError if either was changed, or they do not belong together.
    """
    homes = (truth / "truth", truth, *truth.resolve().parents)
    home = next((folder for folder in homes if (folder / _SEAL).is_file()), None)
    if home is None:
        if inputs:
            raise UserError(f"{truth}: has no {_SEAL}, so it is not sealed; omit {inputs}")
        return None
    inputs = inputs or home.resolve().parent / "inputs"
    with bounded.undamaged(home / _SEAL, "restore the truth that was sealed"):
        values = bounded.read_json(home / _SEAL)
        check_format("seal", values, home / _SEAL)
        sealed = checked(TruthSeal, values)
    with bounded.undamaged(inputs, "give the inputs that were published with this truth"):
        sums = bounded.read_text(inputs / _SUMS)
        if sha256_of(inputs / _SUMS) != sealed.inputs_sha256:
            raise ValueError(f"{_SUMS} is not that of this truth")
        if f"{sha256_of(inputs / _SEAL)}  {_SEAL}\n" not in sums:
            raise ValueError(f"{_SEAL} was changed")
        published = checked(InputsSeal, bounded.read_json(inputs / _SEAL)).truth
    key, names = bytes.fromhex(sealed.key), [name for name in _names_in(home) if name != _SEAL]
    for name in sorted({*names, *published}):
        if name not in published or name not in names or _hmac(key, home, name) != published[name]:
            raise UserError(
                f"{home / name} differs from its published hash; restore the truth that was sealed"
            )
    return sealed.inputs_sha256


def _names_in(folder: Path) -> list[str]:
    paths = (path for path in folder.rglob("*") if not path.is_dir())
    return sorted(path.relative_to(folder).as_posix() for path in paths)


def _hmac(key: bytes, folder: Path, name: str) -> str:
    """Return the hash of a file and of its path in a folder, which files thus cannot exchange."""
    with (folder / name).open("rb") as file:
        signed = hmac.new(key, f"{name}\0".encode(), "sha256")
        return hashlib.file_digest(file, lambda: signed).hexdigest()
