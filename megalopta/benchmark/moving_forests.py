"""Rendered forests with a moving camera: clips with true parallax, and long flights.

Near plants move faster than far ones and occlude them, unlike dead leaves or a rotating camera.
Light is baked, so its remaining error, 6 %, is fixed to surfaces and moves with them; the
flickering part is reported. Clips are kept in the cache folder.

In a flight the camera yaws left and right by up to 0.7° per frame, pitches and rolls by up to 0.5°,
and flies 10 cm per frame, up to 30° to the side of its view and 8° upward, so that neither rotation
nor heading stays near an axis. Trees 2 m away move by about 2 px per frame.
"""

import io
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from megalopta.benchmark.clips import FRAMES, SHAPE, FlowClip
from megalopta.benchmark.panoramas import LUMINANCE_BAND_NM
from megalopta.core.array_store import ArrayStore
from megalopta.core.arrays import Floats
from megalopta.core.folders import cache_folder
from megalopta.core.freshness import BAKE_MODEL, RENDER_MODEL, TRUTH_MODEL, digest
from megalopta.core.record import Record
from megalopta.render import RenderSettings, SceneRenderer, frame_seed, render_once
from megalopta.scenes import (
    CameraPath,
    Forest,
    Light,
    PerspectiveCamera,
    Recorded,
    Trajectory,
    build_scene,
)

Pass = TypeVar("Pass")

_MOST_BYTES = 10**8
"""Size limit of all clips; one takes 5 MB."""
_ARRAYS = "light", "flow", "noise"

FLIGHT_FRAMES = 80
FLIGHTS = 3
_STEP_M, _EYE_M, _CLIMB_DEG = 0.1, 1.6, 8.0
_LARGEST_TURN_DEG, _LARGEST_ASIDE_DEG = 0.7, 30.0
_LARGEST_NOD_DEG, _NODS, _ROLLS = 3.0, 2.0, 2.5
_RATE_HZ = 20.0
_FLIGHT_SAMPLES = 128


VIEW_SETTINGS = RenderSettings(
    samples_per_pixel=64,
    max_depth=4,
    bands_nm=(LUMINANCE_BAND_NM,),
    integrator="baked",
    bake_error=0.06,
)


class MovingView(Record, frozen=True):
    """A forest, its light, and the camera's path."""

    forest: Forest
    """Plants and ground."""
    light: Light
    """Light; clips have mean 1."""
    trajectory: CameraPath
    """Pose of the camera in each frame."""
    camera: PerspectiveCamera = PerspectiveCamera(width=SHAPE[1], height=SHAPE[0], fov_deg=60)
    """Projection and image size."""
    settings: RenderSettings = VIEW_SETTINGS
    """Rendering settings."""


def _view(
    preset: str, velocity_m: tuple[float, float, float], turn_deg: float, **light: float
) -> MovingView:
    """Return a view of a forest from 1.6 m, with translation and turn per frame."""
    return MovingView(
        forest=Forest.model_validate({"preset": preset, "seed": 5, "trees": 60}),
        light=Light(level="daylight", **light),
        trajectory=Trajectory(
            frames=FRAMES,
            frame_rate_hz=_RATE_HZ,
            position_m=(0, 0, 1.6),
            look_at_m=(10, 0, 1.6),
            velocity_m_s=tuple(_RATE_HZ * way for way in velocity_m),
            rotation_deg_s=_RATE_HZ * turn_deg,
        ),
    )


MOVING_VIEWS: Mapping[str, MovingView] = MappingProxyType(
    {
        "open, sideways": _view("open", (0, 0.08, 0), 0.0, disc_fraction=0.0),
        "understorey, forward": _view("understorey", (0.12, 0.02, 0), 0.1, disc_fraction=0.3),
        "open, around a tree": _view("open", (0, -0.1, 0), 0.7, disc_fraction=0.3),
        "clearing, up and across": _view("clearing", (0, 0.1, 0.06), -0.4, disc_fraction=0.3),
    }
)
"""Views by name: three densities, four kinds of motion. A dense forest would take hours."""


def forest_flight(seed: int = 5) -> MovingView:
    """Return a flight; it turns both ways in each half."""
    return MovingView(
        forest=Forest.model_validate({"preset": "open", "seed": seed, "trees": 60}),
        light=Light(level="daylight", disc_fraction=0.3),
        camera=PerspectiveCamera(width=120, height=120, fov_deg=60),
        trajectory=Recorded(frames=FLIGHT_FRAMES, frame_rate_hz=_RATE_HZ, csv=_recording()),
        settings=VIEW_SETTINGS.model_copy(update={"samples_per_pixel": _FLIGHT_SAMPLES}),
    )


def forest_flights(count: int = FLIGHTS) -> dict[str, MovingView]:
    """Return flights through `count` forests, by name."""
    return {f"flight {number + 1}": forest_flight(seed=5 + number) for number in range(count)}


def forest_clips(
    views: Mapping[str, MovingView] = MOVING_VIEWS,
    cache: Path | None = None,
    after_frame: Callable[[], object] = lambda: None,
) -> Iterator[tuple[FlowClip, float]]:
    """Yield clips of views by name, and the flicker of a pixel by rendering, σ over the mean.

    Each view has an even number of frames. Renderings are kept in the cache folder, by default the
    user's; `after_frame` is called after each frame, also for cached clips.
    """
    for name, view in views.items():
        text = f"{RENDER_MODEL} {BAKE_MODEL} {TRUTH_MODEL} {view.model_dump_json()}"
        store = ArrayStore(cache_folder(cache) / "clips", digest(text), _MOST_BYTES)
        kept = store.read(_ARRAYS)
        if kept is None:
            kept = _rendered(view, after_frame)
            store.write(kept)
        else:
            for _ in range(view.trajectory.frames):
                after_frame()
        yield FlowClip(name, kept["light"], kept["flow"]), float(kept["noise"])


def _rendered(view: MovingView, after_frame: Callable[[], object]) -> dict[str, NDArray[Any]]:
    """Light (T, H, W), flow (H, W, 2) and flicker of a view."""
    scene = build_scene(view.forest, view.light, view.camera, view.trajectory)
    poses = view.trajectory.poses()
    renderer = SceneRenderer(scene, view.camera, view.settings, poses)
    light, flicker, middle = [], 0.0, len(poses) // 2 - 1
    for index, pose in enumerate(poses):
        seeds = partial(frame_seed, 0, index)
        image, noise = render_once(
            partial(_pass, renderer.radiance, pose, seeds),
            partial(_pass, renderer.measured, pose, seeds) if index == middle else None,
        )
        if noise and noise.surface:
            flicker = (noise.surface.rms**2 - noise.surface.standing**2) ** 0.5
        light.append(image[..., 0])
        after_frame()
    frames = np.array(light, np.float64)
    flow = renderer.flow(poses, middle, middle + 1).displacement
    return {"light": frames / frames.mean(), "flow": flow, "noise": np.array(flicker)}


def _pass(
    render: Callable[[Floats, int], Pass], pose: Floats, seeds: Callable[[int], int], number: int
) -> Pass:
    return render(pose, seeds(number))


def _recording() -> str:
    """Return the path as CSV: time, position and quaternion."""
    times = np.arange(FLIGHT_FRAMES)
    phase = 2 * np.pi * times / FLIGHT_FRAMES
    look = np.radians(_LARGEST_TURN_DEG) * FLIGHT_FRAMES / (2 * np.pi) * np.sin(phase)
    way = look - np.radians(_LARGEST_ASIDE_DEG) * np.sin(phase / 2)
    climb = np.radians(_CLIMB_DEG)
    steps = np.column_stack(
        (
            np.cos(climb) * np.cos(way),
            np.cos(climb) * np.sin(way),
            np.full(FLIGHT_FRAMES, np.sin(climb)),
        )
    )
    places = np.array([0, 0, _EYE_M]) + _STEP_M * (np.cumsum(steps, axis=0) - steps)
    nod, roll = _LARGEST_NOD_DEG * np.sin(_NODS * phase), _LARGEST_NOD_DEG * np.sin(_ROLLS * phase)
    body = Rotation.from_euler("ZYX", np.column_stack((np.degrees(look), nod, roll)), degrees=True)
    ahead = Rotation.from_matrix([[0, 0, 1], [-1, 0, 0], [0, -1, 0]])  # right, down and forward
    text = io.StringIO()
    table = np.column_stack((times / _RATE_HZ, places, (body * ahead).as_quat()))
    np.savetxt(text, table, delimiter=",", fmt="%.9f")
    return text.getvalue()
