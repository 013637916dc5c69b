from .baselines import methods_and_baselines as methods_and_baselines
from .bench_light import (
    BenchLight as BenchLight,
    fitted_light as fitted_light,
)
from .board_of_pairs import (
    errors_of_pairs as errors_of_pairs,
    write_board as write_board,
)
from .detection import (
    COLUMNS as COLUMNS,
    CONTRAST as CONTRAST,
    DARK_COUNTS as DARK_COUNTS,
    RESPONSES as RESPONSES,
    SIZE as SIZE,
    SPEED_COLUMNS as SPEED_COLUMNS,
    Detection as Detection,
    detections as detections,
)
from .forest_flight import (
    FLIGHT_DRAWS as FLIGHT_DRAWS,
    FLIGHT_FLUXES as FLIGHT_FLUXES,
    FLIGHTS as FLIGHTS,
    MotionErrors as MotionErrors,
    flight_errors as flight_errors,
    forest_flight as forest_flight,
    forest_flights as forest_flights,
    together as together,
)
from .leaderboard import (
    EFFICIENCY_FLUXES as EFFICIENCY_FLUXES,
    FLUXES as FLUXES,
    GRID as GRID,
    MARGIN_PX as MARGIN_PX,
    SPEED_PX as SPEED_PX,
    Entry as Entry,
    bound as bound,
    bound_along_x as bound_along_x,
    efficiencies as efficiencies,
    information as information,
    ranked as ranked,
    sequences as sequences,
    unknown_bound as unknown_bound,
)
from .motion_bench import (
    FRAME_RATE_HZ as FRAME_RATE_HZ,
    FRAMES as FRAMES,
    OPEN_PHOTONS as OPEN_PHOTONS,
    PIXELS as PIXELS,
    SENSORS as SENSORS,
    SPEEDS_MM_S as SPEEDS_MM_S,
    TIME_CONSTANTS_S as TIME_CONSTANTS_S,
    UNITS as UNITS,
    Peaks as Peaks,
    crossing_peaks as crossing_peaks,
    detector as detector,
    filter_step as filter_step,
    passing_rates as passing_rates,
    peaks as peaks,
    pixels_per_frame as pixels_per_frame,
    pooled as pooled,
    record as record,
)
from .pairs_on_disk import (
    pairs_below as pairs_below,
    read_pair as read_pair,
    spread as spread,
)
from .panorama_recipes import (
    NATURAL_PANORAMAS as NATURAL_PANORAMAS,
    render_panorama as render_panorama,
)
from .panoramas import (
    RECIPE as RECIPE,
    SHIPPED as SHIPPED,
    natural_templates as natural_templates,
    read_template as read_template,
    write_template as write_template,
)
from .passages import (
    cut_passages as cut_passages,
    cut_rest as cut_rest,
)
from .rainforest_floor import (
    FLOOR_BANDS_NM as FLOOR_BANDS_NM,
    FLOOR_LIGHT as FLOOR_LIGHT,
    floor_passes as floor_passes,
)
from .runner import (
    Results as Results,
    run as run,
)
from .sweep import (
    Point as Point,
    Sweep as Sweep,
    Value as Value,
    load_sweep as load_sweep,
)
from .sweep_cost import announce_sweep as announce_sweep
from .templates import pixels_of as pixels_of
from .thesis_sweeps import (
    PHOTOGRAPHED as PHOTOGRAPHED,
    SWEEPS as SWEEPS,
    in_form as in_form,
)
from .trial import (
    ROWS as ROWS,
    GratingTemplate as GratingTemplate,
    PanoramaTemplate as PanoramaTemplate,
    Template as Template,
    Trial as Trial,
)
from .whole_frame_board import (
    BLOCK_PX as BLOCK_PX,
    FAR_PX as FAR_PX,
    PHOTONS_PER_PX as PHOTONS_PER_PX,
    FrameErrors as FrameErrors,
    OverScenes as OverScenes,
    block_methods as block_methods,
    frame_errors as frame_errors,
)
from .whole_frame_forests import (
    MOVING_VIEWS as MOVING_VIEWS,
    MovingView as MovingView,
    forest_clips as forest_clips,
)
from .whole_frame_scenes import (
    Clip as Clip,
    leaves_clips as leaves_clips,
    panorama_clips as panorama_clips,
)
