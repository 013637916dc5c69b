"""What an exposure gives, in place of one that was made."""

from megalopta.report.source import Budget
from megalopta.sensor import PRESETS


def budget(sensor, level, lux, ratio=1.0, **more):
    """Budget of an exposure with a signal-to-noise ratio around one."""
    usual = dict.fromkeys(("dark", "saturated_fraction", "photons_per_frame"), 0.0)
    usual |= dict.fromkeys(("photons", "detected", "expected"), 1.0)
    return Budget(
        sensor=PRESETS[sensor],
        level=level,
        illuminance_lux=lux,
        signal_to_noise=(0.5 * ratio, ratio, 2 * ratio),
        **usual | more,
    )
