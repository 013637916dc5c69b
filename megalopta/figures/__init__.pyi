from .picture import (
    Cell as Cell,
    Figure as Figure,
    borne_out as borne_out,
    columns_of as columns_of,
)
from .recipe import (
    FigureRecipe as FigureRecipe,
    Run as Run,
    Templates as Templates,
)
from .registry import names as names
from .reproduction import (
    reproduce as reproduce,
    reproduce_sweep as reproduce_sweep,
)
from .style import (
    BLACK as BLACK,
    BLUE as BLUE,
    DASHES as DASHES,
    GLYPHS as GLYPHS,
    GRAY as GRAY,
    GREEN as GREEN,
    MARKERS as MARKERS,
    ORANGE as ORANGE,
    PALETTE as PALETTE,
    RULE as RULE,
    VERMILION as VERMILION,
    draw_table as draw_table,
    house_style as house_style,
    line_style as line_style,
    method_style as method_style,
    new_canvas as new_canvas,
    write_at as write_at,
)
from .svg import (
    in_style as in_style,
    logarithmic as logarithmic,
    new_axes as new_axes,
    themed as themed,
    to_svg as to_svg,
)
from .sweep import sweep_figure as sweep_figure
from .thresholds import (
    MeanThreshold as MeanThreshold,
    mean_threshold as mean_threshold,
    or_nan as or_nan,
    sweep_curve as sweep_curve,
    threshold_of as threshold_of,
)
from .writing import write_figure as write_figure
