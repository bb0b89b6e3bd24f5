"""Tasks of a jaw: excitations, head posture, load and morsel, as a table."""

import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from emgface.anatomy.jaw.model import Floats
from emgface.anatomy.jaw.series import Excitation, morsel_side, ramps, read_probes
from emgface.errors import JawError

TASK_RISE = 0.2
"""Time over which the excitations of a task rise [s]."""


@dataclass(frozen=True)
class JawTask:
    """One movement.

    Attributes
    ----------
    title : str
    duration : float
        [s]
    excitation : mapping
        Corners (time [s], value) of every exciter.
    head : float
        Backward rotation of the head about the first cervical vertebra, from 0 over `TASK_RISE`
        [degrees].
    load : (3,) constant force on the lower incisor [N].
    morsel : str or None
        Side of a morsel between the teeth, "L" or "R".
    series : bool
        Whether published series replace the excitations, if a folder of them is given.
    settles : bool
        Whether the task ends at rest, so that it takes longer if a body still moves then
        (`emgface.anatomy.jaw.run.run_task`).
    """

    title: str
    duration: float
    excitation: Mapping[str, list[tuple[float, float]]] = field(
        default_factory=dict[str, list[tuple[float, float]]]
    )
    head: float = 0.0
    load: tuple[float, float, float] = (0.0, 0.0, 0.0)
    morsel: str | None = None
    series: bool = False
    settles: bool = False

    def excitations(self) -> Excitation:
        """Excitation over time."""
        return ramps(self.excitation)


def _rising(**levels: float) -> dict[str, list[tuple[float, float]]]:
    return {name: [(0.0, 0.0), (TASK_RISE, level)] for name, level in levels.items()}


def _burst(level: float, *times: float, tone: float = 0.0) -> list[tuple[float, float]]:
    """Corners of a trapezoid, over a tone before and after it."""
    before = [(0.0, tone), (0.04, 0.0)] if tone else []
    return [*before, *zip(times, (0.0, level, level, tone), strict=True)]


_CHEWING = {
    "bi_ad": _burst(0.3, 0.03, 0.12, 0.26, 0.34),
    "bi_my": _burst(0.225, 0.03, 0.12, 0.26, 0.34),
    "ip_R": _burst(0.12, 0.05, 0.18, 0.38, 0.48),
    "ip_L": _burst(0.06, 0.05, 0.15, 0.26, 0.34),
    **{
        name + side: _burst(level * share, 0.36, 0.46 + late, 0.63, 0.70, tone=0.02)
        for name, level in (("t", 1.0), ("m", 1.3), ("mp", 1.0))
        for side, share, late in (("_L", 0.12, 0.0), ("_R", 0.10, 0.02))
    },
}
"""The lateral pterygoid of the other side acts longer, the closers of the side of the morsel are
stronger and faster. Levels and times are chosen."""

_OPENERS = {"bi_ad": 1.0, "bi_my": 1.0, "bi_ip": 1.0}

JAW_TASKS = {
    "rest": JawTask(
        "rest under gravity, closers at 0.04 %", 2.0, {"bi_close": [(0.0, 4e-4)]}, settles=True
    ),
    "close": JawTask("closing, closers at 0.4 %", 1.0, {"bi_close": [(0.0, 4e-3)]}, settles=True),
    "open": JawTask("wide opening, head still", 1.0, _rising(**_OPENERS)),
    "open_head": JawTask("wide opening, head 15 degrees back", 1.0, _rising(**_OPENERS), head=15.0),
    "gape": JawTask(
        "wide opening, with depressors and retractors of the hyoid",
        1.0,
        _rising(**_OPENERS, bi_infrahyoid=0.3, bi_retracthyoid=0.35),
    ),
    "protrude": JawTask(
        "protrusion, inferior lateral pterygoids", 1.0, _rising(bi_ip=1.0, bi_close=2e-2)
    ),
    "lateral": JawTask(
        "movement to the right, left inferior lateral pterygoid",
        1.0,
        _rising(ip_L=0.5, bi_close=1e-2),
    ),
    "clench": JawTask("clenching, closers at 10 %", 0.6, _rising(bi_close=0.1)),
    "effort": JawTask(
        "maximum effort: clenching, then opening",
        1.2,
        {
            "bi_close": [(0.1, 0.0), (0.2, 1.0), (0.5, 1.0), (0.6, 0.0)],
            "bi_open": [(0.7, 0.0), (0.8, 1.0), (1.1, 1.0), (1.2, 0.0)],
        },
    ),
    "cycles": JawTask(
        "opening and closing twice",
        2.0,
        {
            name: [(t + c, u) for t in (0.1, 1.0) for c, u in corners]
            for name, corners in (
                ("bi_ad", [(0.0, 0.0), (0.15, 0.4), (0.35, 0.4), (0.45, 0.0)]),
                ("bi_my", [(0.0, 0.0), (0.15, 0.3), (0.35, 0.3), (0.45, 0.0)]),
                ("bi_ip", [(0.0, 0.0), (0.15, 0.3), (0.35, 0.3), (0.45, 0.0)]),
                ("bi_t", [(0.0, 0.02), (0.1, 0.0), (0.35, 0.0), (0.55, 0.08), (0.8, 0.02)]),
                ("bi_m", [(0.0, 0.02), (0.1, 0.0), (0.4, 0.0), (0.6, 0.12), (0.8, 0.02)]),
                ("bi_mp", [(0.0, 0.02), (0.1, 0.0), (0.4, 0.0), (0.6, 0.1), (0.8, 0.02)]),
            )
        },
    ),
    "chew": JawTask("chewing a morsel on the left", 1.0, _CHEWING, morsel="L", series=True),
    "swallow": JawTask(
        "swallowing, suprahyoid muscles for 0.5 s",
        1.5,
        {
            "bi_close": [(0.0, 0.0), (0.2, 0.05)],
            "bi_suprahyoid": [(0.3, 0.0), (0.5, 0.1), (0.8, 0.1), (1.0, 0.0)],
        },
    ),
    "pull": JawTask(
        "pull on the incisor, muscles inactive", 2.0, load=(0.0, 0.0, -4.56), settles=True
    ),
}
"""Tasks by name. Source: Stavness et al. 2006, section 3.1; Hannam et al. 2008; levels not stated there
are ours."""


def task_of(name: str) -> JawTask:
    """Task of a name, or JawError."""
    if name not in JAW_TASKS:
        raise JawError(f"no task is called {name!r}, expected one of {', '.join(JAW_TASKS)}")
    return JAW_TASKS[name]


MORSEL_SIDES = ("L", "R", "none")
"""Sides of a morsel."""


def with_series(
    name: str, series: str | os.PathLike[str] | None, *, morsel: str | None = None
) -> tuple[JawTask, dict[str, object]]:
    """Task of a name, and its excitations as an option of `run_task` if they are read from a folder.

    `morsel` is one of `MORSEL_SIDES`. By default the side is that of the series, or of the task
    without series. Raises JawError if the series do not state the side, the side is unknown, or the
    task has no morsel.
    """
    task = task_of(name)
    if morsel is not None and morsel not in MORSEL_SIDES:
        raise JawError(f"morsel = {morsel!r}, expected one of {', '.join(MORSEL_SIDES)}")
    if morsel is not None and task.morsel is None:
        raise JawError(f"the task {name!r} has no morsel, expected none or the task 'chew'")
    if not task.series or series is None:
        if morsel not in (None, task.morsel):
            raise JawError(
                f"the excitations of the task {name!r} are those of a morsel on the side "
                f"{task.morsel!r}, expected no other side without the setting series=FOLDER"
            )
        return task, {}
    side = morsel or morsel_side(series)
    if side is None:
        raise JawError(
            f"{series} does not state the side of the morsel, as lbitecant.txt or rbitecant.txt do: "
            "specify the setting morsel=L, R or none"
        )
    where = {"L": " on the left", "R": " on the right", "none": ", without a morsel"}[side]
    title = f"chewing{'' if side == 'none' else ' a morsel'}{where}"
    task = replace(task, title=title, morsel=None if side == "none" else side)
    return task, {"excitation": read_probes(series, duration=task.duration)}


def turned_head(degrees: float, centre: Floats) -> "HeadTurn":
    """Backward rotation of the head about a point over `TASK_RISE`, for `jaw_scene`."""
    return HeadTurn(np.radians(degrees), centre)


@dataclass(frozen=True, eq=False)
class HeadTurn:
    """Smooth rotation [rad] of the skull about x through a centre [m], which lifts what is in front."""

    angle: float
    centre: Floats

    def __call__(self, t: float) -> tuple[Floats, Floats]:
        """Position and quaternion at a time [s]."""
        s = min(max(t / TASK_RISE, 0.0), 1.0)
        half = 0.5 * self.angle * s * s * (3.0 - 2.0 * s)
        c, n = np.cos(2.0 * half), np.sin(2.0 * half)
        y, z = -self.centre[1], -self.centre[2]
        turned = np.array([-self.centre[0], c * y - n * z, n * y + c * z])
        return self.centre + turned, np.array([np.cos(half), np.sin(half), 0.0, 0.0])
