"""`megalopta gallery`."""

from argparse import Namespace

from megalopta.cli.command import Verbs, add_out, add_verb


def declare(verbs: Verbs) -> None:
    """Add the verb."""
    purpose = "render every scene preset at every light level, beside photon counts of it"
    add_out(add_verb(verbs, "gallery", purpose, _run), "out/gallery")


def _run(options: Namespace) -> None:
    from megalopta.gallery import write_gallery

    print(write_gallery(options.out))
