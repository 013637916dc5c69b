"""Checks of every effect, in the order of the table; those of the counting laws are apart."""

from megalopta.sensor.check import Check
from megalopta.sensor.check_binary import check_gated_bits
from megalopta.sensor.check_ctia import check_ctia_discharge, check_ctia_noise
from megalopta.sensor.check_ctia_bias import check_gate_leak, check_pulse_loop, check_trimming
from megalopta.sensor.check_measured import check_measured_maps
from megalopta.sensor.check_optics import check_falloff, check_lens
from megalopta.sensor.check_terms import TERM_CHECKS

EFFECT_CHECKS: tuple[Check, ...] = (
    check_lens,
    check_falloff,
    *TERM_CHECKS,
    check_measured_maps,
    check_gated_bits,
    check_ctia_discharge,
    check_ctia_noise,
    check_trimming,
    check_pulse_loop,
    check_gate_leak,
)
