"""How large a plan will be, measured on a few frames of a few of its sequences."""

import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from megalopta.config import Configuration
from megalopta.dataset import files_in
from megalopta.making.staging import MADE
from megalopta.plan import Plan, configuration_of
from megalopta.progress import duration, silent
from megalopta.stages import run_stage, size

_PROBED, _DRAWN = 3, 200
_FEW, _MORE = 2, 4


@dataclass(frozen=True)
class Cost:
    """Of a sequence: what it takes to begin, and what each frame adds."""

    seconds: float
    seconds_a_frame: float
    bytes_a_frame: float


def dry_run(root: Path, plan: Plan, workers: int = 1, only: Sequence[int] | None = None) -> None:
    """Print what a plan will take, and make nothing of it.

    The time is that of this machine, with as many sequences side by side as there are workers;
    light that would be baked for many frames is traced for these few, which takes longer.
    """
    indices = list(only) if only is not None else range(plan.sequences)
    some = indices[:: max(1, len(indices) // _DRAWN)]
    drawn = [configuration_of(plan, index) for index in some]
    by_kind = {each.scene.kind: each for each in drawn}
    costs = {kind: probe(each) for kind, each in list(by_kind.items())[:_PROBED]}
    frames = [each.trajectory.frames for each in drawn]
    mean = Cost(*(sum(values) / len(values) for values in zip(*_values(costs), strict=True)))
    found = [costs.get(each.scene.kind, mean) for each in drawn]
    share = len(indices) / len(drawn)
    seconds = share * sum(
        cost.seconds + count * cost.seconds_a_frame
        for cost, count in zip(found, frames, strict=True)
    )
    bytes_ = share * sum(
        cost.bytes_a_frame * count for cost, count in zip(found, frames, strict=True)
    )
    print(
        f"{root}: {len(indices)} sequences, {round(share * sum(frames))} frames, about "
        f"{size(bytes_)}, about {duration(seconds / workers)}"
        + (f" with {workers} workers" if workers > 1 else "")
    )


def probe(configuration: Configuration) -> Cost:
    """Measure a sequence on its first few frames, in a folder that goes again."""
    (few_s, _), (more_s, more_bytes) = (
        _measured(configuration, frames) for frames in (_FEW, _MORE)
    )
    each_s = max(more_s - few_s, 0.0) / (_MORE - _FEW)
    return Cost(max(few_s - _FEW * each_s, 0.0), each_s, more_bytes / _MORE)


def _measured(configuration: Configuration, frames: int) -> tuple[float, float]:
    trajectory = configuration.trajectory.model_copy(update={"frames": frames})
    short = configuration.model_copy(update={"trajectory": trajectory})
    with tempfile.TemporaryDirectory() as folder, silent():
        start = time.perf_counter()
        for stage in MADE:
            run_stage(Path(folder) / "data", short, stage)
        seconds = time.perf_counter() - start
        written = sum(path.stat().st_size for path in files_in([Path(folder)]))
    return seconds, written


def _values(costs: dict[str, Cost]) -> list[tuple[float, float, float]]:
    return [(each.seconds, each.seconds_a_frame, each.bytes_a_frame) for each in costs.values()]
