"""Memory and disk that a stage needs, to a factor of two; too much is refused."""

import os
import shutil
from pathlib import Path

from megalopta.config.model import Configuration
from megalopta.core.bounded import check_decoded
from megalopta.core.errors import UserError
from megalopta.core.pictures import SENSED_BYTES
from megalopta.dataset.frames import frames_at_once
from megalopta.sensor import Sensor
from megalopta.stages.sense import burst_frames

_REMEDIES = {
    "render": "trajectory.frames, camera.width and height, or render.samples_per_pixel",
    "sense": "trajectory.frames, the camera's size, sub_frames, burst_hz or tcspc.bins, or give "
    "fewer sensors or light_levels",
    "flow": "trajectory.frames or the camera's size, or give fewer methods or exposures",
    "benchmark": "trajectory.frames, benchmark.fluxes_per_decade or repeats, or give fewer sizes",
}


def refuse_absurd(settings: Configuration, stage: str, root: Path) -> None:
    """Refuse a stage that exceeds this machine, before anything is built.

    Raises UserError with the need, the capacity, and the settings to lower.
    """
    camera, (memory, disk) = settings.camera, needed_bytes(settings, stage)
    if stage == "sense" and not settings.scene.has_truth:  # a file states the size
        pixels = camera.width * camera.height * frames_at_once(settings)
        check_decoded("sense at this size (--width)", (pixels,), SENSED_BYTES)
    physical = float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    place = root.absolute()
    folder = next(folder for folder in (place, *place.parents) if folder.exists())
    # content of the folder may be part of the output
    held = sum(path.stat().st_size for path in root.rglob("*") if path.is_file())
    room = float(shutil.disk_usage(folder).free + held)
    for needed, most, clause in (
        (memory, physical, "of memory, and this machine has"),
        (disk, room, f"on disk, and {root} has space for"),
    ):
        if needed > most:
            raise UserError(
                f"{stage}: {settings.trajectory.frames} frames of {camera.width} × "
                f"{camera.height} would take about {size(needed)} {clause} {size(most)}; lower "
                f"{_REMEDIES[stage]}"
            )


def needed_bytes(settings: Configuration, stage: str) -> tuple[float, float]:
    """Return the most memory and disk space that a stage needs."""
    frames, pixels = settings.trajectory.frames, settings.camera.width * settings.camera.height
    held = pixels * frames_at_once(settings)
    methods, exposures = len(settings.methods), len(settings.sensors) * len(settings.light_levels)
    if not settings.scene.has_truth and stage in ("render", "benchmark"):
        memory, disk = pixels * 100.0, 0.0  # the file, which exists
    elif stage == "render":
        bands, shutter = len(settings.render.bands_nm), settings.shutter
        memory = pixels * (1000 + 16 * bands) + 1000 * frames
        light = 3.9 * bands * (1 if shutter.is_instant else 2)
        disk = light + 72 * (2 if shutter.readout_s else 1) + 14  # and pictures for training
    elif stage == "sense":
        memory = held * (120 + 8 * settings.sub_frames)
        disk = exposures * ((22 if settings.expectation else 3) + 7 * settings.correct)
        bits = burst_frames(settings)
        of_product = {"burst_npy": bits / 8, "sums_npy": 2 * bits / settings.cubes.sum_frames}
        of_product["color_npy"] = 12.0
        disk += exposures * sum(of_product.get(name, 0.0) for name in settings.products)
        if "histograms_npy" in settings.products:
            bins = [sensor.tcspc.bins for sensor in settings.sensors if isinstance(sensor, Sensor)]
            disk += 4 * len(settings.light_levels) * sum(bins)
            memory += 40 * pixels * max(bins, default=0)
    elif stage == "flow":
        memory = held * 80 + pixels * 240 * methods
        disk = 5 * exposures * methods
    else:
        memory = held * 60 + pixels * 160 * methods * len(settings.benchmark.fluxes)
        disk = 8
    memory += 1e9  # of the program
    return memory, float(frames * pixels * disk)


def size(number: float) -> str:
    """Format an amount of memory, such as "40 GB"."""
    for unit, bytes_ in (("PB", 1e15), ("TB", 1e12), ("GB", 1e9)):
        if number >= bytes_:
            return f"{number / bytes_:.3g} {unit}"
    return f"{number / 1e6:.0f} MB"
