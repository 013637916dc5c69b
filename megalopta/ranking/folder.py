"""Ranking of the sequences in a folder, from its frames to its page."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from megalopta import bounded
from megalopta.config import validated
from megalopta.dataset import Dataset, open_dataset
from megalopta.enclosure import check_enclosed
from megalopta.errors import UserError
from megalopta.flow.detectors import Method
from megalopta.folders import locked
from megalopta.format_numbers import check_format
from megalopta.ranking.light import lit
from megalopta.ranking.methods import velocity_methods
from megalopta.ranking.page import NAME, write_ranking
from megalopta.ranking.record import Ranking
from megalopta.ranking.run import rank_methods
from megalopta.ranking.settings import RankingSettings
from megalopta.stages import Ledger
from megalopta.tree import Tree

FOLDER = "ranking"
"""Where the demo puts it, in the folder of its dataset"""


def read_ranking(folder: Path) -> Ranking | None:
    """Read what `run_ranking` has written to a folder; None where nothing is. Raises UserError."""
    path = folder / NAME
    if not path.exists():
        return None
    try:
        values = bounded.read_json(path)
        check_format("ranking", values, path)
        return Ranking.model_validate(values)
    except (OSError, ValueError, AttributeError):
        raise UserError(f"{path} is damaged; remove it, or rank the methods again") from None


def run_ranking(
    root: str | Path,
    out: str | Path,
    settings: Mapping[str, str] | None = None,
    methods: Sequence[Method] = (),
) -> Path:
    """Rank flow methods on a rendered dataset; return the page.

    Velocities are kept in OUT/velocities as they are found, so that a broken run, or one with
    another method more, goes on from there.

    Parameters
    ----------
    root
        Folder of a dataset with one sequence or many.
    out
        Folder for ranking.html, .csv and .json.
    settings
        Values of `RankingSettings` by name, as YAML.
    methods
        In the place of those of the settings: names, detectors, or functions of two frames
        (`megalopta.flow.detector_from` says of what kind).

    Raises
    ------
    UserError
        When frames are missing, too few or too small, or a setting is wrong.
    """
    out, chosen = Path(out), validated(RankingSettings, {}, "settings", dict(settings or {}))
    datasets = sequences_of(Path(root))
    with locked(out):
        try:
            ranked = velocity_methods(methods or chosen.methods)
            chosen = lit(chosen.model_copy(update={"methods": tuple(ranked)}), datasets)
            ranking, example = rank_methods(datasets, chosen, ranked, out / "velocities")
        except ValueError as problem:
            raise UserError(str(problem)) from None
        return write_ranking(out, ranking, example)


def sequences_of(root: Path) -> list[Dataset]:
    """Open the rendered sequences of a folder. Raises UserError."""
    tree = Tree(root)
    check_enclosed(root)
    if tree.records.is_dir():
        datasets = [tree.opened(name)[1] for name in tree.names()]
        if not datasets:
            raise UserError(f"{root}: no finished sequence; run megalopta dataset make")
        return list(datasets)
    dataset = open_dataset(root)
    Ledger(dataset).require("render")
    return [dataset]
