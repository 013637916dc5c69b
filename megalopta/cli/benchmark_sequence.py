"""`megalopta benchmark sequence`."""

from argparse import Namespace
from typing import TYPE_CHECKING

from megalopta.cli.command import Verbs, add_dataset, add_out, add_verb

if TYPE_CHECKING:
    from megalopta.config.settings import Settings


def declare(verbs: Verbs) -> None:
    """Add the verb."""
    purpose = "rank flow methods on rendered sequences against the true motion, over the photons"
    command = add_verb(verbs, "sequence", purpose, _run)
    command.settings = _settings
    add_dataset(command)
    add_out(command, "out/ranking")


def _settings() -> "Settings":
    from megalopta.benchmark.ranking_settings import RankingSettings
    from megalopta.config.settings import Settings

    return Settings(RankingSettings())


def _run(options: Namespace) -> None:
    from megalopta.benchmark.ranking_run import run_ranking

    print(run_ranking(options.dataset, options.out, options.overrides))
