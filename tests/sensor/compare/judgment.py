"""What a comparison has to say of a composed fault.

A comparison is "right" if it names at least one of the recipe's names and else only
extras, which are true of the frames but too little; "vague" if it names extras alone or says only
that readings differ; "none" if it says that no known cause explains the difference; "silent" if it
says that frames agree; "wrong" if it names anything else. Names are

- of *what* is changed in all frames and pixels, its cause (`KINDS`); lag, loss, order, stuck bits
  and other changes of the readout are to be named wherever and whenever they are;
- *where* the scale of a part is changed: a block, lines, deviating pixels;
- *when* it is, if not always: a step from a frame on; odd frames or flicker in every k-th; odd
  frames or common noise in random ones; of pixels telegraph noise, of lines row or column noise.

A mean that changes on the way is no cause: lag that adds counts is no efficiency, lost parts are no
banding, copied columns have no hot pixels. Where only the dark counts would tell exposure from
light, either is right of a weak change.
"""

from hashlib import sha256
from typing import NamedTuple

from .changes import LINES, PARTS
from .own_cameras import CAMERAS


class Recipe(NamedTuple):
    """A composed fault of a camera."""

    camera: str
    what: str
    where: str = "whole"
    when: str = "always"

    @property
    def is_reserved(self) -> bool:
        """True for the third of the recipes that is kept for judging."""
        return sha256("/".join(self).encode()).digest()[0] % 3 == 0


class Kind(NamedTuple):
    """What changes, as a line of the table below has it."""

    names: set[str]
    extras: set[str]
    sizes: tuple[float, ...]
    """Weak, middle, strong; none: by the number of counts, or by that of frames"""
    where: tuple[str, ...]
    when: tuple[str, ...]
    cameras: tuple[str, ...]


def _listed(names):
    return set(filter(None, names.split(", ")))


_WHERE = {"W": ("whole",), "A": ("whole", *PARTS[:5]), "L": ("whole", *PARTS[:7])}
_WHERE |= {"X": ("whole", *PARTS), "P": PARTS[:7], "B": ("whole", *PARTS[:3])}
_WHERE |= {"R": ("odd rows",), "C": ("odd columns",), "D": ("pixels",)}
_TABLE = """
light | efficiency | | | X | aefr | cbs
dark | dark counts | | | X | aefr | cbs
exposure | exposure | | | X | aefr | cbs
noise of rows | row noise | common noise | .05 .1 .25 | W | a | cbs
noise of columns | column noise | common noise | .05 .1 .25 | W | a | cbs
moved lag | lag | | .04 .12 .4 | A | af | cbs
added lag | lag | step of gain | .04 .12 .4 | A | af | cbs
running mean | lag | | 2 3 5 | W | a | cs
lost | missing frames | | 0 0 0 | W | er | cbs
repeated | repeated frames | lag, lost parts | 0 0 0 | W | er | cbs
merged | odd frames | lag, flicker, common noise | 0 0 0 | W | er | cbs
empty part | lost parts | | 0 0 0 | P | efr | cbs
full part | lost parts | | 0 0 0 | P | efr | cbs
old part | lost parts | repeated frames, lag | 0 0 0 | P | er | cbs
part of another place | lost parts, order | | 0 0 0 | A | aefr | cbs
order, by one line | order | | 0 0 0 | W | aefr | cbs
order, interleaved | order | | 0 0 0 | W | aefr | cbs
order, mirrored half | order | | 0 0 0 | W | aefr | cbs
order, swapped rows | order | | 0 0 0 | W | aefr | cbs
copied columns | copied columns, order | | 0 0 0 | C | a | cbs
copied rows | copied rows, order | | 0 0 0 | R | a | cbs
stuck at 1 | stuck bit | missing codes, uneven codes | 1 3 5 | X | aefr | cs
stuck at 0 | stuck bit | missing codes, uneven codes | 1 3 5 | X | aefr | cs
swapped bits | missing codes, uneven codes | | 0 1 2 | L | a | cs
lost bits | lost bits, stuck bit, missing codes | uneven codes | 1 2 3 | A | af | cs
clipped | capacity | stuck pixel | 1.5 .8 0 | A | a | cs
wrapped | capacity | | 2.3 1.5 .5 | A | a | cs
offset | offset | | 1 3 8 | L | aefr | cs
gain | step | | .08 .2 .5 | L | aefr | s
leak | light leak, dark counts | | .15 .4 1.5 | B | af | cbs
glow of a corner | light leak | dark counts, hot pixel, odd block | 1 3 8 | W | a | cbs
glow of an edge | light leak | dark counts, hot pixel, odd block, odd row | .5 1.5 5 | W | a | cbs
gradient | uneven light | | .05 .12 .3 | W | a | cbs
vignette | uneven light | | .05 .12 .3 | W | a | cbs
reflection | uneven light | odd block | .05 .12 .3 | W | a | cbs
fringes | uneven light | odd row, odd column, odd block | .05 .12 .3 | W | a | cbs
telegraph | telegraph noise | hot pixel | 3 8 20 | D | a | cbs
dead time | dead time | | .25 .6 1.5 | W | a | cs
read noise | read noise | | 1.5 2.5 5 | W | a | s
afterpulses | afterpulsing | | .03 .07 .2 | W | a | cs
crosstalk to four | crosstalk | odd row, odd column | .03 .07 .2 | W | a | cbs
crosstalk to the right | crosstalk | odd row, odd column | .03 .07 .2 | W | a | cbs
crosstalk along columns | crosstalk | odd row, odd column | .03 .07 .2 | W | a | cbs
crosstalk to corners | crosstalk | odd row, odd column | .03 .07 .2 | W | a | cbs
crosstalk two away | crosstalk | odd row, odd column | .03 .07 .2 | W | a | cbs
"""
_SUBJECTS = {"light": "light", "dark": "dark counts", "exposure": "gain"}
_PROFILES = """
ramp of {0} | drift of {1}, drift of readings | | | A | a | cbs
warm-up of {0} | drift of {1}, drift of readings | step of {1}, odd frames | | A | a | cbs
saw-tooth of {0} | flicker, drift of {1}, drift of readings, step of {1} | | | A | a | cbs
flicker of {0} | flicker | | | A | a | cbs
white of {0} | common noise | odd frames | | A | a | cbs
walk of {0} | common noise, drift of {1}, drift of readings | flicker, step of {1} | | A | a | cbs
"""
KINDS: dict[str, Kind] = {}
for _line in (_TABLE + "".join(_PROFILES.format(*pair) for pair in _SUBJECTS.items())).split("\n"):
    if _line:
        _what, *_names, _sizes, _where, _when, _cameras = map(str.strip, _line.split("|"))
        KINDS[_what] = Kind(
            *map(_listed, _names),
            tuple(float(size) if "." in size else int(size) for size in _sizes.split()),
            _WHERE[_where],
            tuple(when for when in ("always", "from", "every", "random") if when[0] in _when),
            tuple(name for name, letter in zip(CAMERAS, "cbs", strict=True) if letter in _cameras),
        )


def judged(recipe, strength):
    """Names that are right, and names that are true of the frames but too little."""
    camera, what, where, when = recipe
    profile, _, quantity = what.rpartition(" of ")
    is_rate, is_scaled = quantity in _SUBJECTS, what in (*_SUBJECTS, "offset", "gain", "leak")
    subject = {**_SUBJECTS, "leak": "dark counts"}.get(quantity, quantity)
    names, extras = set(KINDS[what].names), set(KINDS[what].extras)
    line, is_area = LINES.get(where, ""), where in ("half", "quarter", "block")
    fluctuates = when in ("every", "random") or profile in ("flicker", "white", "walk")
    # where
    place = {"whole": set(), "pixels": {"deviating pixel"}}.get(where, {"odd block"})
    if line:
        place = place | {f"odd {line}"} | ({f"{line} offset"} if what == "offset" else set())
    if what in ("light", "exposure") and is_area:
        place = place | {"uneven light"}
    if what == "offset" and where == "half":
        place = place | {"row offset", "column offset"}
    if what == "dark" and when == "always":
        place = place | {"hot pixel" if where == "pixels" else "dark counts"}
    # when
    moment = {
        "always": set(),
        "from": {f"step of {subject}", "step of readings"},
        "every": {"odd frames", "flicker"},
        "random": {"odd frames", "common noise"},
    }[when]
    if line and fluctuates:
        moment |= {f"{line} noise"} | ({"row banding"} if line == "row" else set())
    if where == "pixels" and when != "always":
        moment |= {"telegraph noise"}
    drift = {f"drift of {subject}", "drift of readings"} if is_rate or is_scaled else set()
    of_light = {"drift of light"} if "drift" in "".join(names) else set()
    of_light |= {"drift of light", "step of light"} if when == "from" else set()
    # what
    if is_scaled:
        is_all = where == "whole" and when == "always"
        names = (names if is_all or what == "leak" else set()) | place | moment
    elif is_rate:
        names |= moment
    elif where == "whole" and when in ("every", "random"):
        names |= {"odd frames"}
    if quantity == "exposure":
        # weak changes of dark counts are not seen
        names |= of_light - (drift if when == "from" else set()) if strength == 0 else set()
        extras |= of_light
    if any(name.startswith("step of") for name in names | extras):
        extras |= {"step of readings"}
    extras |= place | moment | (drift if when == "from" else set())
    if profile in ("warm-up", "walk"):  # the mean changes, too
        extras |= KINDS[quantity].names
    if fluctuates:
        extras |= {"common noise"}
        extras |= {"row banding"} if "order" in names and when == "every" else set()
    if where != "whole" and (fluctuates or profile == "warm-up"):
        # strongly changed bits are all 1, or all 0
        is_lost = strength == 2 if camera == "bits" else not (is_scaled or is_rate)
        extras |= {"lost parts"} if is_lost else set()
    if where != "whole" or names & {"order", "light leak", "uneven light"}:
        extras |= {"deviating pixel"}
    if is_area:
        extras |= {"odd row", "odd column"}
        if quantity in ("light", "exposure", "added lag"):
            extras |= {"uneven light"}
        extras |= {"row banding"} if profile in ("flicker", "saw-tooth") else set()
    return names, extras - names
