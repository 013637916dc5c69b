from .sections import (
    Section as Section,
    captioned as captioned,
    write_sections as write_sections,
)
from .templates import render_page as render_page
from .text import (
    FAILS as FAILS,
    SENSELESS as SENSELESS,
    UNDEFINED as UNDEFINED,
    duration as duration,
    enumerate_words as enumerate_words,
    level_name as level_name,
    level_title as level_title,
    lux as lux,
    number as number,
    percent as percent,
    plural as plural,
    relative_error as relative_error,
    short as short,
)
