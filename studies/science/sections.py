"""The sections of the page, in the order of the page.

Each section is a module with ``make(studies, out)``. ``studies`` maps the name of a world ("matched",
"mismatched") to the folder of a finished study, as `emgface study run` writes it: ``cube.nc`` with
its configuration, and the results of all stages under ``store``. ``out`` is the folder of the page;
figures and CSV go there. Returned is Markdown that begins with a heading of the second level.
"""

from collections.abc import Callable, Mapping
from pathlib import Path

from studies.science import baselines, inference, normalisation, worlds

Section = Callable[[Mapping[str, Path], Path], str]

SECTIONS: tuple[Section, ...] = (worlds.make, baselines.make, normalisation.make, inference.make)
