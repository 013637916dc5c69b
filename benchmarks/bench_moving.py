"""What things that move cost where a shutter takes them, in frames of the same scene at an instant.

Required, in CPU-seconds of a frame as the render stage writes it, light and truth:

- a trail of 60 trees in the wind through a rolling shutter: at most 5 times;
- motion blur of 8 poses with two moving boxes: at most 2 times.

Of each sequence a middle frame counts, which has neighbors on both sides. It is written for the
second time, so that its kernels are compiled, and after another one, so that nothing else is left.
"""

import tempfile
import time
from pathlib import Path

from megalopta.config.model import Configuration
from megalopta.dataset.store import Dataset
from megalopta.render import RenderSettings
from megalopta.scenes import Forest, MovingObject, PerspectiveCamera, Shutter, Trajectory
from megalopta.scenes.forest.sway import Wind
from megalopta.scenes.motion import Drift
from megalopta.stages.render import FrameWriter

CAMERA = PerspectiveCamera(width=128, height=64)
SETTINGS = RenderSettings(samples_per_pixel=4, integrator="path")
WALK = Trajectory(frames=4, velocity_m_s=(1.0, 0.0, 0.0))
BOXES = tuple(
    MovingObject(position_m=(x, y, 1.5), motion=Drift(velocity_m_s=(0, -y, 0), spin_deg_s=90))
    for x, y in ((3.0, 1.0), (4.0, -1.0))
)
ROLLING = Forest(preset="trail", trees=60, wind=Wind()), (), Shutter(readout_s=0.01)
BLURRED = Forest(preset="trail", trees=60), BOXES, Shutter(exposure_s=0.05, poses=8)


def frame_s(scene: Forest, objects: tuple[MovingObject, ...], shutter: Shutter) -> float:
    """CPU-seconds of a frame whose kernels are compiled."""
    configuration = Configuration(
        scene=scene, objects=objects, shutter=shutter,
        camera=CAMERA, trajectory=WALK, render=SETTINGS,
    )  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        writer = FrameWriter(Dataset(Path(folder) / "data", configuration))
        for frame in (2, 1, 2):
            start = time.process_time()
            writer.write(frame)
            seconds = time.process_time() - start
            print(f"    frame {frame}: {seconds:.1f} CPU-s", flush=True)
    return seconds


def main() -> None:
    cases = {"wind, rolling shutter": (*ROLLING, 5), "boxes, blur of 8 poses": (*BLURRED, 2)}
    for name, (scene, objects, shutter, most) in cases.items():
        print(f"{name}, {CAMERA.width} × {CAMERA.height} px", flush=True)
        instant = frame_s(scene, objects, Shutter())
        taken = frame_s(scene, objects, shutter)
        print(
            f"  at an instant {instant:.1f} CPU-s a frame, so {taken:.1f}: {taken / instant:.2f} "
            f"times (required: {most})",
            flush=True,
        )


if __name__ == "__main__":
    main()
