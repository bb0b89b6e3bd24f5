"""Sections of the page by name, in their order.

Each section is a module with ``make(studies, out)``. ``studies`` maps the name of a world
("matched", "mismatched") to the folder of a finished study, as written by `emgface study run`;
``out`` is the folder of the page, for figures and CSV. It returns Markdown that begins with a
heading of the second level.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

from studies.science import (
    baselines,
    choices,
    controls,
    inference,
    inverse,
    normalisation,
    strength,
    worlds,
)

Section = Callable[[Mapping[str, Path], Path], str]

SECTIONS: dict[str, Section] = {
    "controls": controls.make,
    "worlds": worlds.make,
    "baselines": baselines.make,
    "normalisation": normalisation.make,
    "strength": strength.make,
    "choices": choices.make,
    "inference": inference.make,
    "inverse": inverse.make,
}

NEED_STUDIES: Final = frozenset({"worlds", "baselines", "normalisation", "inference"})
"""Sections that use the finished studies of all worlds; the others require volunteers only."""
