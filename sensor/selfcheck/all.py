"""Checks of every effect, in the order of the table; those of the counting laws are apart."""

from megalopta.sensor.selfcheck.analog import check_analog
from megalopta.sensor.selfcheck.binary import check_gated_bits
from megalopta.sensor.selfcheck.combinations import AVALANCHE_CHECKS
from megalopta.sensor.selfcheck.comparison import Check
from megalopta.sensor.selfcheck.ctia import check_ctia_discharge, check_ctia_noise
from megalopta.sensor.selfcheck.ctia_bias import check_gate_leak, check_pulse_loop, check_trimming
from megalopta.sensor.selfcheck.measured import check_measured_maps
from megalopta.sensor.selfcheck.optics import check_falloff, check_lens, check_transmission
from megalopta.sensor.selfcheck.parts import check_parts
from megalopta.sensor.selfcheck.readings import reading_checks
from megalopta.sensor.selfcheck.terms import TERM_CHECKS

EFFECT_CHECKS: tuple[Check, ...] = (
    check_lens,
    check_falloff,
    check_transmission,
    *TERM_CHECKS,
    *AVALANCHE_CHECKS,
    check_analog,
    check_measured_maps,
    check_gated_bits,
    check_parts,
    check_ctia_discharge,
    check_ctia_noise,
    check_trimming,
    check_pulse_loop,
    check_gate_leak,
    *reading_checks(),
)
