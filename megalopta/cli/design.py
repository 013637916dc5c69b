"""`megalopta design`: the exposure at which a sensor can measure motion to a stated error."""

from argparse import Namespace
from pathlib import Path

from megalopta.cli.command import option, out, settings_loader, verb


@verb(
    "design",
    "find the exposure at which a sensor can measure flow or yaw rate to a stated error, over "
    "pitch, aperture, efficiency and dark counts, without drawing photons",
    option("sensor", "preset of a counting sensor, or its YAML file"),
    option(
        "--dataset",
        "rendered dataset of one sequence, whose first frame is the scene (default: dead leaves)",
        Path,
    ),
    out("out/design"),
    settings=settings_loader("benchmark.design", "DesignSettings"),
    often=(
        *("error", "light_levels", "exposure_s", "pitch_m", "f_number", "pde", "dark_counts_hz"),
        *("yaw_deg_s", "frame_rate_hz"),
    ),
    example="megalopta design array-12x4 --error 0.1px --light-levels full_moon starlight "
    "--f-number 1 1.4 2",
)
def _design(options: Namespace) -> None:
    from rich.console import Console
    from rich.table import Table

    from megalopta.benchmark.design import DesignSettings, designed
    from megalopta.benchmark.design_page import table_cells, table_head, write_design
    from megalopta.config.yaml_model import validated

    settings = validated(DesignSettings, {}, "settings", options.overrides)
    found = designed(options.sensor, options.dataset, settings)
    table = Table(*table_head(found))
    for row in found.rows:
        table.add_row(*table_cells(found, row))
    Console(width=120, markup=False).print(table)
    print(write_design(options.out, found))
