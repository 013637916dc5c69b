"""Figures 2.18 and 2.19 from recordings: peak responses over the velocity of the plate."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure as Canvas

from megalopta.camera.motion_bench import UNITS, Peaks, pixels_per_frame
from megalopta.core.arrays import Floats
from megalopta.plotting.picture import Figure
from megalopta.plotting.style import BLACK, GRAY
from megalopta.reproduction.chapter2_captured_bench import (
    CAPTURED,
    ERRORS,
    HEADS,
    SIMULATED,
    compared,
    numbered,
)
from megalopta.reproduction.chapter2_estimate import Estimate, jackknifed
from megalopta.reproduction.chapter2_transfer import (
    draw_peaks,
    statistics_columns,
    theory,
    theory_scale,
)


def transfer_figure(
    name: str, method: str, speeds: Sequence[float], found: Mapping[str, Sequence[Peaks]]
) -> Figure:
    """Figure 2.18 or 2.19: `found` holds the peaks of each speed, simulated and captured."""
    velocity = np.array([pixels_per_frame(speed) for speed in speeds])
    ideal = np.array([each.ideal.mean() for each in found[SIMULATED]])
    estimates = {
        label: [Estimate.of(each.noisy.mean(axis=(1, 2))) for each in over_speeds]
        for label, over_speeds in found.items()
    }
    apart = [a - b for a, b in zip(estimates[CAPTURED], estimates[SIMULATED], strict=True)]
    moving = [place for place, speed in enumerate(speeds) if speed > 0]
    ratios = {
        label: Estimate.mean([jackknifed(_snr_db, over_speeds[each].noisy) for each in moving])
        for label, over_speeds in found.items()
    }
    mean = {label: Estimate.mean([each[k] for k in moving]) for label, each in estimates.items()}

    def draw(canvas: Canvas) -> None:
        above, below = canvas.subplots(2, 1, sharex=True, height_ratios=(3, 1))
        snr_db = {label: each.value for label, each in ratios.items()}
        draw_peaks(above, method, velocity, ideal, found, snr_db)
        below.axhline(0, color=GRAY, lw=1)
        values, errors = zip(*apart, strict=True)
        below.errorbar(velocity, values, errors, fmt="o", color=BLACK, capsize=3, lw=1.4, ms=4)
        below.set(xlabel="Image velocity (pixels/frame)", ylabel="Difference")

    return Figure(
        name=name,
        title=f"{numbered(name)}, captured: peak response of {method} over velocity",
        caption=(
            "Points are the mean and σ of the largest response of one detector while an edge "
            f"crosses; below them the difference of the means, captured less simulated, with its "
            f"standard error. {ERRORS} Means are over all speeds but 0."
        ),
        printed={
            "Peak response": compared(mean[CAPTURED], mean[SIMULATED], UNITS[method]),
            "SNR": compared(ratios[CAPTURED], ratios[SIMULATED], "dB"),
            "Largest difference of a speed": (
                f"{max(abs(each.errors_off) for each in apart):.1f} standard errors",
                f"of {len(speeds)} speeds" if len(speeds) > 1 else "of the one speed",
            ),
        },
        printed_by=HEADS,
        draw=draw,
        numbers={
            "speed_mm_s": np.array(speeds, float),
            "velocity_px_per_frame": velocity,
            "theoretical": theory_scale(method, velocity, ideal) * theory(method, velocity),
            "without_noise": ideal,
            **statistics_columns(found),
            "difference": np.array([each.value for each in apart]),
            "difference_error": np.array([each.error for each in apart]),
        },
        height_in=5.0,
    )


def _snr_db(noisy: Floats) -> float:
    return Peaks(noisy, noisy).snr_db
