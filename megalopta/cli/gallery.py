"""`megalopta gallery`."""

from argparse import Namespace
from pathlib import Path

from megalopta.cli.command import Verbs, add_out, add_verb
from megalopta.core.errors import UserError


def declare(verbs: Verbs) -> None:
    """Add the verb."""
    purpose = "render every scene preset at every light level, beside photon counts of it"
    verb = add_verb(verbs, "gallery", purpose, _run)
    verb.add_argument(
        "--views",
        action="store_true",
        help="render larger views of the forests under natural skies instead, views.html",
    )
    verb.add_argument(
        "--statistics",
        action="store_true",
        help="measure statistics of views of the forests instead, image-statistics.png",
    )
    verb.add_argument(
        "--panorama",
        type=Path,
        metavar="FILE",
        help="a photographed panorama (HDR, EXR or PNG, 2:1); with --views shown beside a forest "
        "in its light, with --statistics measured beside them, all at two of its pixels or more",
    )
    add_out(verb, "out/gallery")


def _run(options: Namespace) -> None:
    from megalopta.report.gallery import write_gallery, write_statistics, write_views

    if options.views and options.statistics:
        raise UserError("gallery: --views and --statistics are two things; give one")
    if options.panorama and not (options.views or options.statistics):
        raise UserError("gallery: --panorama goes with --views or --statistics; give one")
    try:
        if options.views:
            print(write_views(options.out, options.panorama))
        elif options.statistics:
            photographs = [options.panorama] if options.panorama else []
            print(*write_statistics(options.out, photographs), sep="\n")
        else:
            print(write_gallery(options.out))
    except ValueError as problem:  # a panorama that is none
        raise UserError(str(problem)) from None
