"""Ranking of the sequences in a folder, from its frames to its page."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from megalopta.benchmark.methods import velocity_methods
from megalopta.benchmark.ranking import rank_methods
from megalopta.benchmark.ranking_light import lit
from megalopta.benchmark.ranking_page import NAME, write_ranking
from megalopta.benchmark.ranking_record import Ranking
from megalopta.benchmark.ranking_settings import RankingSettings
from megalopta.config.yaml_model import validated
from megalopta.core import bounded
from megalopta.core.enclosure import check_enclosed
from megalopta.core.errors import UserError
from megalopta.core.folders import locked
from megalopta.core.format_numbers import check_format
from megalopta.dataset.layout import Tree
from megalopta.dataset.store import Dataset, open_sequence
from megalopta.flow.detectors.registry import Method
from megalopta.stages.ledger import Ledger

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
    if not tree.lone:
        datasets = [tree.opened(name)[1] for name in tree.names()]
        if not datasets:
            raise UserError(f"{root}: no finished sequence; run megalopta dataset make")
        return list(datasets)
    dataset = open_sequence(root)
    Ledger(dataset).require("render")
    return [dataset]
