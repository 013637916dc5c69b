"""`megalopta scene`: what scenes are for other programs."""

from argparse import Namespace
from functools import partial

from megalopta.cli.command import VERBS, Verb, at_least, option, out, verb
from megalopta.cli.stages import settings_of_stage
from megalopta.core.errors import UserError, refused_as

VERBS["scene"] = Verb("export a scene")


@verb(
    "scene export",
    "write a frame of a scene as Mitsuba's XML, which plain Mitsuba renders alike, or as GLB",
    option("configuration", "YAML file, name of a configuration, or dataset folder"),
    out("out/scene", "folder of the XML and its files, or a GLB file by its name"),
    option("--frame", "frame, counted from 0", at_least(0), 0),
    settings=partial(settings_of_stage, "render"),
    often=("scene.kind", "light.level", "camera.width", "camera.height", "render.bands_nm"),
    example="megalopta scene export demo --out out/scene --frame 3",
)
def _export(options: Namespace) -> None:
    from megalopta.config.model import load
    from megalopta.core import files
    from megalopta.render import export_scene
    from megalopta.scenes.glb import glb_of
    from megalopta.stages.render import build

    settings = load(options.configuration, options.overrides)
    path = settings.trajectory
    if options.frame >= path.frames:
        raise UserError(
            f"--frame {options.frame}: frames are 0 to {path.frames - 1}; give one of these"
        )
    scene, pose, time_s = build(settings), path.poses()[options.frame], path.times_s[options.frame]
    if options.out.suffix.lower() == ".glb":
        with files.atomic_write(options.out) as temporary:
            temporary.write_bytes(glb_of(scene, float(time_s)))
        print(options.out)
        return
    with refused_as("scene export"):
        print(
            export_scene(scene, settings.camera, settings.render, pose, options.out, float(time_s))
        )
