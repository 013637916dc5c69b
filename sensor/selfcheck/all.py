"""Checks of every effect, by groups that can be run alone, in the order of the table."""

from megalopta.sensor.selfcheck.analog import check_analog, check_codes, check_silent_readings
from megalopta.sensor.selfcheck.between import check_sub_frames
from megalopta.sensor.selfcheck.binary import check_chance, check_gated_bits
from megalopta.sensor.selfcheck.calibration import check_bad_pixels, check_calibration
from megalopta.sensor.selfcheck.carriers import (
    check_delayed_afterpulsing,
    check_stated_afterpulsing,
    check_tabulated_mean,
)
from megalopta.sensor.selfcheck.combinations import (
    check_combinations,
    check_dark_neighbor,
    check_dead_time_ends,
    check_delays,
    check_maps,
    check_measured_crosstalk,
    check_running_frames,
)
from megalopta.sensor.selfcheck.comparison import Check
from megalopta.sensor.selfcheck.correction import (
    check_ambiguity,
    check_correction,
    check_curvature,
    check_filling,
    check_propagation,
)
from megalopta.sensor.selfcheck.counting import counting_checks
from megalopta.sensor.selfcheck.ctia import (
    check_ctia_discharge,
    check_ctia_noise,
    check_ctia_pattern,
    check_ctia_times,
)
from megalopta.sensor.selfcheck.ctia_bias import (
    check_gate_leak,
    check_leak_floor,
    check_pulse_loop,
    check_trimming,
)
from megalopta.sensor.selfcheck.device import check_bias_laws, check_device, check_operation
from megalopta.sensor.selfcheck.drawn import (
    check_certain_neighbor,
    check_drawn_dead_time,
    check_poisson_quantiles,
    check_skewness,
)
from megalopta.sensor.selfcheck.interplay import interplay_checks
from megalopta.sensor.selfcheck.measured import check_measured_maps, check_windows
from megalopta.sensor.selfcheck.optics import (
    check_blur,
    check_falloff,
    check_lens,
    check_transmission,
)
from megalopta.sensor.selfcheck.parts import check_parts
from megalopta.sensor.selfcheck.placed import check_adc, check_places
from megalopta.sensor.selfcheck.readings import (
    check_few_events,
    check_full_swing,
    check_paralyzable_law,
    check_tabulated_laws,
    reading_checks,
)
from megalopta.sensor.selfcheck.sheets import check_sheets, check_table_devices
from megalopta.sensor.selfcheck.stated import (
    check_stated_analog,
    check_stated_conversion,
    check_stated_crosstalk,
    check_stated_dead_time,
)
from megalopta.sensor.selfcheck.stated_paralyzable import check_stated_paralyzable
from megalopta.sensor.selfcheck.terms import (
    check_afterpulsing,
    check_counters,
    check_crosstalk,
    check_dim_light,
    check_few_lost,
    check_frames,
    check_gate_and_jitter,
    check_light,
    check_poisson_means,
    check_rare_bits,
)

_EFFECTS: dict[str, tuple[Check, ...]] = {
    "light": (check_light, check_lens, check_falloff, check_transmission, check_blur),
    "device": (
        check_device,
        check_operation,
        check_bias_laws,
        check_measured_maps,
        check_windows,
        check_sheets,
        check_table_devices,
    ),
    "dead-time": (
        check_stated_dead_time,
        check_stated_paralyzable,
        check_few_lost,
        check_drawn_dead_time,
        check_skewness,
        check_dead_time_ends,
    ),
    "afterpulsing": (
        check_afterpulsing,
        check_stated_afterpulsing,
        check_delayed_afterpulsing,
        check_tabulated_mean,
        check_delays,
    ),
    "crosstalk": (
        check_crosstalk,
        check_stated_crosstalk,
        check_measured_crosstalk,
        check_dark_neighbor,
        check_certain_neighbor,
    ),
    "combinations": (check_combinations, check_maps),
    "gate": (check_gate_and_jitter, check_gated_bits, check_chance),
    "changing-light": (check_parts, check_running_frames, check_sub_frames),
    "counters": (
        check_counters,
        check_analog,
        check_codes,
        check_silent_readings,
        check_stated_analog,
        check_stated_conversion,
    ),
    "frames": (
        check_places,
        check_adc,
        check_frames,
        check_dim_light,
        check_poisson_means,
        check_poisson_quantiles,
        check_rare_bits,
    ),
    "ctia": (
        check_ctia_discharge,
        check_ctia_times,
        check_ctia_noise,
        check_ctia_pattern,
        check_trimming,
        check_pulse_loop,
        check_leak_floor,
        check_gate_leak,
    ),
    "readings": (
        check_few_events,
        check_paralyzable_law,
        check_tabulated_laws,
        check_full_swing,
        *reading_checks(),
        *interplay_checks(20_000),
    ),
    "correction": (
        check_correction,
        check_calibration,
        check_bad_pixels,
        check_curvature,
        check_propagation,
        check_filling,
        check_ambiguity,
    ),
}
EFFECT_CHECKS: tuple[Check, ...] = tuple(check for group in _EFFECTS.values() for check in group)
"""All but the laws of the counts, which take long"""

CHECKS: dict[str, tuple[Check, ...]] = {"counting": counting_checks(), **_EFFECTS}
