from . import (
    quantile as quantile,
    streams as streams,
)
from .normals import (
    EDGES as EDGES,
    fill_normals as fill_normals,
)
from .poisson import (
    draw_poisson as draw_poisson,
    fill_poisson as fill_poisson,
    poisson_streams as poisson_streams,
)
from .streams import (
    generator as generator,
    pixel_normals as pixel_normals,
    pixel_uniforms as pixel_uniforms,
)
from .words import (
    LANES as LANES,
    fill_words as fill_words,
    word_streams as word_streams,
)
