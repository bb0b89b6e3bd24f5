"""Numbers and repeated names given to commands, checked at one place before a command runs."""

import inspect
import math
from collections.abc import Callable, Mapping
from functools import wraps
from typing import Any

import typer

from emgface.cli.dependent import key_of, refuse_without_effect
from emgface.cli.written import spare_inputs

HUGE = float(2**63 - 1)
_TIME, _FRACTION, _COUNT, _SEED = (0.0, 1e5), (0.0, 1.0), (0, 1_000_000), (0, HUGE)

LIMITS: Mapping[str, tuple[float, float]] = {
    "activation": _FRACTION, "after": (-1e5, 1e5), "band": (0.0, 1e6), "before": (-1e5, 1e5),
    "branch_at": _TIME, "calibration": _COUNT, "count": _COUNT, "cross_talk": _FRACTION,
    "delay": (-10.0, 10.0), "draws": _COUNT, "duration": (1e-9, 1e5), "electrode_failure": _FRACTION,
    "elements": _COUNT,
    "emg_weight": (0.0, 1e6), "end": (-1e6, 1e6), "gain": (1e-9, 1e9),
    "lung": (0.0, 1e5), "modes": _COUNT, "n": _COUNT,
    "noise": (0.0, 1e3), "notch": (0.0, 1e6), "notch_width": (0.0, 1e6), "offset": (-1e7, 1e7),
    "person": _SEED, "persons": _COUNT, "pitch": (1e-3, 1e5), "port": (0, 65_535),
    "rate": (1e-3, 1e7), "repetition": _COUNT, "repetitions": _COUNT, "run": _COUNT,
    "seconds": _TIME, "sections": (1, 100_000), "seed": _SEED, "sequences": _COUNT,
    "sigma_max": (0.0, 1e9), "solver_threads": (1, 4096), "spacing": (1e-3, 1e3), "start": (-1e6, 1e6),
    "step": (1e-9, 10.0), "tension": (1e-3, 1e3), "thickness": (-3.0, 3.0),
    "waypoint_every": (1e-9, 1e5),
    "workers": (0, 100_000),
}  # fmt: skip
"""Smallest and largest value of every option and argument that is a number, in its own unit.

They exclude what no physical quantity or count can be; commands refuse more, with their own messages.
"""


ONCE = (
    "contact", "course", "label", "part_file", "ring", "settings", "surfaces", "unit", "volume",
    "without",
)  # fmt: skip
"""Repeatable options in which every name may occur once; values may follow an equals sign."""


MARK = "checks_numbers"
"""Attribute of commands that are checked."""


def guard(app: typer.Typer) -> None:
    """Check the values of all commands of an application, including those of its groups."""
    for command in app.registered_commands:
        if command.callback is not None:
            command.callback = checked(command.callback)
    for group in app.registered_groups:
        if group.typer_instance is not None:
            guard(group.typer_instance)


def checked(command: Callable[..., Any]) -> Callable[..., Any]:
    """Return a command that refuses wrong numbers, idle options, and to write what it reads."""
    if getattr(command, MARK, False):
        return command

    parameters = inspect.signature(command).parameters.values()
    defaults = {p.name: p.default for p in parameters if p.default is not p.empty}

    @wraps(command)
    def run(*args: Any, **values: Any) -> Any:
        given = inspect.signature(command).bind(*args, **values).arguments
        for name, value in given.items():
            refuse(name, value)
        spare_inputs(given)
        refuse_without_effect(key_of(command), {**defaults, **given}, defaults)
        return command(*args, **values)

    setattr(run, MARK, True)  # noqa: B010  # functions declare no attributes
    return run


def refuse(name: str, value: object) -> None:
    """Raise BadParameter for a number outside its limits, or for a repeated name of a list."""
    option = f"--{name.replace('_', '-')}"
    for one in value if isinstance(value, list | tuple) else (value,):
        if isinstance(one, bool) or not isinstance(one, int | float):
            continue
        least, most = LIMITS.get(name, (-math.inf, math.inf))
        if not (math.isfinite(one) and least <= one <= most):
            raise typer.BadParameter(
                f"{option} {one:g}: expected a number from {least:g} to {most:g}"
            )
    if name in ONCE and isinstance(value, list):
        names = [str(one).partition("=")[0].strip() for one in value]
        twice = sorted({one for one in names if names.count(one) > 1})
        if twice:
            raise typer.BadParameter(
                f"{option} {twice[0]} is given twice, expected every name once"
            )
