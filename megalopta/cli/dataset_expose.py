"""`megalopta dataset expose`."""

from argparse import Namespace
from typing import TYPE_CHECKING

from megalopta.cli.command import Verbs, add_cluster, add_dataset, add_verb

if TYPE_CHECKING:
    from megalopta.config.settings import Settings


def declare(verbs: Verbs) -> None:
    """Add the verb."""
    purpose = "put other sensors, exposures and light levels on the light of a made dataset"
    command = add_verb(verbs, "expose", purpose, _run)
    command.settings = _settings
    add_dataset(command)
    add_cluster(command)


def _settings() -> "Settings":
    from megalopta.config.settings import Settings
    from megalopta.generation.exposing import Exposing

    return Settings(Exposing())


def _run(options: Namespace) -> None:
    from megalopta.generation.exposing import expose, load_exposing

    wanted = load_exposing(options.overrides)
    print(expose(options.dataset, wanted, options.workers, options.scheduler).root)
