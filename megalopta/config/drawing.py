"""Draw a sequence of a plan from seed and index alone."""

from collections import defaultdict
from collections.abc import Iterator, Mapping
from functools import cache, partial
from itertools import product, starmap
from typing import Any

import numpy as np

from megalopta.config import built_in_text
from megalopta.config.model import Configuration, fitted, with_suited_depth
from megalopta.config.recipe import Plan, RigCamera, Stream, choose, draw_entry
from megalopta.config.rendering import RenderingSettings
from megalopta.config.scene import own_fields
from megalopta.config.sensing import SensingSettings
from megalopta.config.yaml_model import mapping, validated
from megalopta.core.errors import UserError
from megalopta.core.validation import merged
from megalopta.sensor import ImageSensor, generator

SECRET_SEED = 2**63
"""Least seed of a plan that nobody can find by trying"""
_DEALT_PATHS = 10_000
"""Paths after which the order of splits comes again"""
_DRAW = "draw a value, such as trajectory: {rotation_deg_s: {uniform: [-30, 30]}}"
_DRAWN = ("scenes", "lights", "cameras", "trajectories")


def sequence_name(index: int) -> str:
    """Name of a sequence and of its folders, such as "000731"."""
    return f"{index:06d}"


def configuration_of(plan: Plan, index: int) -> Configuration:
    """Configuration of a sequence. Raises UserError if the drawn values do not fit together."""
    return configuration_at(plan, index, _stream(plan, index))


def check_plan(plan: Plan) -> list[Configuration]:
    """Draw sequences at the lower end, the middle and the upper end of every range.

    Every entry is drawn at least once, for all cameras of a rig. Raises UserError if one does not
    fit.
    """
    counts = {name: len(getattr(plan, name)) for name in _DRAWN}
    # only a trajectory may not fit a scene: all pairs of these, the rest in turn
    pairs = list(product(range(counts["scenes"]), range(max(1, counts["trajectories"]))))
    configurations = []
    for step in range(max(len(pairs), *counts.values())):
        scene, trajectory = pairs[step % len(pairs)]
        number = dict.fromkeys(counts, step) | {"scenes": scene, "trajectories": trajectory}
        entry = {name: (number[name] % n + 0.5) / n for name, n in counts.items() if n}
        for share in (0.0, 0.5, 1 - 2**-53):
            at = defaultdict[str, float](partial(float, share), entry)
            for camera in range(plan.cameras_per_path):
                configurations.append(configuration_at(plan, camera, at.__getitem__))
            if len(at) == len(entry):  # without ranges all shares are alike
                break
    return configurations


@cache
def _preset(name: str) -> dict[str, Any]:
    """Values of a built-in configuration without its exposures, which the plan states."""
    values, left_out = mapping(built_in_text(name), "preset"), own_fields(SensingSettings)
    return {field: value for field, value in values.items() if field not in left_out}


def configuration_at(plan: Plan, index: int, at: Stream) -> Configuration:
    """Configuration of a sequence, drawn from a stream."""
    scene = _drawn(plan, "scenes", at)
    fields = dict(scene) if isinstance(scene, Mapping) else {"preset": scene}
    preset = fields.pop("preset")
    values = _preset(preset)
    kind = fields.get("scene", {}).get("kind", values["scene"]["kind"])
    values = merged(with_suited_depth(values, kind), fields)
    for name, field in (("lights", "light"), ("cameras", "camera"), ("trajectories", "trajectory")):
        if getattr(plan, name):
            chosen = _drawn(plan, name, at)
            chosen = chosen if isinstance(chosen, Mapping) else {"level": chosen}
            values = merged(values, {field: chosen})
    values = merged(values, draw_entry(plan.every, at, "every"))
    of_rig = plan.rig[index % len(plan.rig)] if plan.rig else RigCamera()
    if of_rig.camera:
        values["scene_camera"] = values.get("camera", {})
    differing = {"camera": of_rig.camera, "render": of_rig.render, "shutter": of_rig.shutter}
    values = merged(values, {name: fields for name, fields in differing.items() if fields})
    values["name"] = sequence_name(index)
    # a secret seed gives noise whose seed cannot be found by trying all
    seeds = 2**31 if plan.seed < SECRET_SEED else SECRET_SEED
    values["seed"] = int(generator(plan.seed, "plan", index, "seed").integers(seeds))
    values["light_levels"] = draw_entry(plan.light_levels, at, "light_levels")
    values["sensors"] = draw_entry(of_rig.sensors or plan.sensors, at, "sensors")
    values["products"] = list(plan.products)
    configuration = fitted(validated(Configuration, values, f"sequence {index} (scene {preset})"))
    if not configuration.scene.has_truth:
        raise UserError(
            f"sequence {index} (scene {preset}): a plan renders its scenes; make a dataset of "
            "these pictures with megalopta sense"
        )
    changes: dict[str, Any] = {}
    if plan.rig:  # next to the first camera with which it is a pair
        alike = [camera for camera in plan.rig if camera.camera == of_rig.camera]
        pairs = [camera.mount for camera in alike if of_rig.baseline_m(camera) is not None]
        partner = pairs[0] if pairs and configuration.camera.intrinsics is not None else None
        mounted = configuration.trajectory.mounted(of_rig.mount)
        changes = {"trajectory": mounted, "stereo_with": partner}
        if index % len(plan.rig):
            changes["imu"] = None  # the first camera's sequence has it
    return repeated(configuration.model_copy(update=changes), plan.repeats)


def repeated(configuration: Configuration, repeats: int) -> Configuration:
    """Repeat every sensor: the same device with independent noise."""
    sensors = tuple(starmap(repeated_name, product(configuration.sensors, range(repeats))))
    return configuration.model_copy(update={"sensors": sensors})


def repeated_name(sensor: ImageSensor, number: int) -> ImageSensor:
    """Return a device named after its repeat, which seeds its noise; repeat 0 is the device."""
    return sensor.model_copy(update={"name": f"{sensor.name}-r{number + 1}"}) if number else sensor


def split_of(plan: Plan, index: int) -> str:
    """Split that a sequence belongs to: of any number of first paths, each gets its share."""
    order = _split_order(tuple(sorted(plan.splits.items())))
    return order[index // plan.cameras_per_path % len(order)]


@cache
def _split_order(shares: tuple[tuple[str, float], ...]) -> list[str]:
    """Return the splits of paths in turn: each goes to the split that lacks most."""
    total, counts, order = sum(share for _, share in shares), dict.fromkeys(dict(shares), 0), []
    for place in range(1, _DEALT_PATHS + 1):
        lacks = {name: round(place * share / total - counts[name], 9) for name, share in shares}
        order.append(max(lacks, key=lacks.__getitem__))
        counts[order[-1]] += 1
    return order


def plan_warnings(plan: Plan) -> Iterator[str]:
    """Yield what is wrong with its sequences together: empty splits, and motion that repeats."""
    firsts = range(0, plan.sequences, plan.cameras_per_path)[:_DEALT_PATHS]
    split = {index: split_of(plan, index) for index in firsts}
    if empty := sorted({name for name, share in plan.splits.items() if share} - {*split.values()}):
        turns = [*_split_order(tuple(sorted(plan.splits.items()))), *empty]
        least = max(map(turns.index, empty)) * plan.cameras_per_path + 1
        yield (
            f"splits: {' and '.join(empty)} get none of the sequences ({plan.sequences}); make "
            f"{least} or more, or change the shares"
        )
    fields, alike = set(RenderingSettings.model_fields) - {"name", "seed"}, defaultdict(list)
    motions, is_still = set[tuple[str, bytes]](), False
    for index in firsts[:200]:  # each takes 4 ms
        settings = configuration_of(plan, index)
        alike[settings.model_dump_json(include=fields)].append(index)
        poses = settings.trajectory.poses()
        motion = np.round(np.linalg.inv(poses[0]) @ poses, 6)
        moving = {"camera", "objects"} | ({"scene"} if (motion == motion[0]).all() else set())
        motions.add((settings.model_dump_json(include=moving), motion.tobytes()))
        is_still |= len(poses) == 1
    crossing = [equal for equal in alike.values() if len({split[index] for index in equal}) > 1]
    for equal in crossing:
        names = ", ".join(map(sequence_name, equal[:3])) + (", …" if len(equal) > 3 else "")
        yield f"sequences {names} are equal but for noise, and in different splits; {_DRAW}"
    if is_still:
        yield "trajectory.frames 1: one frame has no flow; give 2 or more"
    elif len(motions) <= (paths := len(firsts[:200])) / 2 and not crossing:
        yield f"different motions: {len(motions)} in {paths} paths, easy to learn by heart; {_DRAW}"


def _stream(plan: Plan, index: int) -> Stream:
    """Random numbers of a path, the same for all cameras of a rig; entries are dealt like cards.

    Each depends on seed, index and path alone.
    """
    number, dealt = index // plan.cameras_per_path, dict[str, float]()
    for name in _DRAWN:
        if count := len(getattr(plan, name)):
            turn, place = divmod(number, count)
            order = generator(plan.seed, "plan", turn, name).permutation(count)
            dealt[name] = (order[place] + 0.5) / count
    return lambda path: (
        dealt[path] if path in dealt else float(generator(plan.seed, "plan", number, path).random())
    )


def _drawn(plan: Plan, name: str, at: Stream) -> Any:
    index, entry = choose(list(getattr(plan, name)), at, name)
    return draw_entry(entry, at, f"{name}.{index}")
