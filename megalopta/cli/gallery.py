"""`megalopta gallery`."""

from argparse import Namespace
from pathlib import Path

from megalopta.cli.command import Verbs, add_out, add_verb
from megalopta.errors import UserError


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
        "--panorama",
        type=Path,
        metavar="FILE",
        help="with --views: a photographed panorama (HDR, EXR or PNG, 2:1), shown beside a forest "
        "in its light",
    )
    add_out(verb, "out/gallery")


def _run(options: Namespace) -> None:
    from megalopta.gallery import write_gallery, write_views

    if not options.views:
        if options.panorama:
            raise UserError("gallery: --panorama goes with --views; give both, or neither")
        print(write_gallery(options.out))
        return
    try:
        print(write_views(options.out, options.panorama))
    except ValueError as problem:  # a panorama that is none
        raise UserError(str(problem)) from None
