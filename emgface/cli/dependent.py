"""Options that only another choice gives an effect, refused at one place before a command runs."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import typer

Given = Mapping[str, Any]


@dataclass(frozen=True)
class Dependent:
    """Parameters that have no effect unless a condition on the arguments of their command is met.

    `needs` names the condition in the message. `met` receives the values of all parameters.
    """

    names: tuple[str, ...]
    needs: str
    met: Callable[[Given], bool]


def _given(name: str) -> Callable[[Given], bool]:
    return lambda given: given.get(name) not in (None, False, [], ())


def _not_given(name: str) -> Callable[[Given], bool]:
    return lambda given: not _given(name)(given)


def _is(name: str, *values: str) -> Callable[[Given], bool]:
    return lambda given: given.get(name) in values


def _kind(name: str, *kinds: str) -> Callable[[Given], bool]:
    """The file of a parameter is of one of the kinds, or is refused by its reader later."""

    def met(given: Given) -> bool:
        from emgface.errors import EmgfaceError
        from emgface.schema.netcdf import kind_of

        try:
            return kind_of(given[name]) in kinds
        except EmgfaceError:
            return True

    return met


def _without_mismatch(given: Given) -> bool:
    """The world of simulated volunteers picks up the sEMG by the matrix of cross-talk."""
    from emgface.volunteers.world import world_of

    return world_of(str(given.get("world"))).pick_up == "mapping"


def _table_of_areas(given: Given) -> bool:
    areas = given.get("areas")
    return areas is not None and areas.suffix.lower() != ".nc"


_ROWS = (
    Dependent(("row", "from_lips"), "--areas with a table", _table_of_areas),
    Dependent(("vowel",), "the idealised tract, which --areas replaces", _not_given("areas")),
)
_FOLDS = Dependent(("lung", "tension"), "--source folds", _is("source", "folds"))
_SOUND = Dependent(("source", "lung", "tension"), "a sound to write (--out)", _given("wave"))
_FACES = (
    "recordings plain picture spread both_cuts reduced mapping accuracy sigma_max contact workers"
)

DEPENDENT: Mapping[str, tuple[Dependent, ...]] = {
    "data_files.convert": (Dependent(("notch_width",), "--notch", _given("notch")),),
    "fit.fit": (
        Dependent(("on_face", "noise", "thickness"), "--landmarks", _given("landmarks")),
    ),
    "inverse.run": (
        Dependent(("gain", "delay"), "own values, which --calibration replaces",
                  _not_given("calibration")),
        Dependent(("gain", "delay", "calibration", "mixing"), "a variant that uses the sEMG",
                  lambda given: given.get("variant") != "motion"),
    ),
    "live.live": (
        Dependent(("range_",), "--source", _given("source")),
        Dependent(("mapping",), "--source or --curves",
                  lambda given: _given("source")(given) or _given("curves")(given)),
        Dependent(("port", "open_page"), "a page", _given("page")),
        Dependent(("preset", "resolution"), "a generated face, which that of a file replaces",
                  lambda given: _not_given("model")(given) and _not_given("face")(given)),
    ),
    "models.sweep": (
        Dependent(("parts", "preset", "seed", "resolution"),
                  "a generated head, which that of --head replaces", _not_given("head_path")),
    ),
    "simulate.simulate": (
        Dependent(("check_contact",), "contact, which --no-contact switches off", _given("contact")),
        Dependent(("waypoint_every",), "--waypoints", _given("waypoints")),
        Dependent(("branch_at",), "--branch", _given("branch")),
    ),
    "sound.formants": _ROWS,
    "sound.head": (_SOUND, _FOLDS),
    "sound.muscles": _ROWS,
    "sound.synthesise": (
        *_ROWS, _FOLDS,
        Dependent(("pitch",), "--source rosenberg", _is("source", "rosenberg")),
        Dependent(("seed",), "the noise, which --no-noise switches off", _given("noise")),
    ),
    "sound.trial": (*_ROWS, _SOUND, _FOLDS),
    "treat.compare": (
        Dependent(tuple(_FACES.split()), "two faces, found a jaw",
                  _kind("before", "face_model", "reduced_face")),
        Dependent(("mapping",), "recordings", _given("recordings")),
        Dependent(("both_cuts",), "full order (the face of the other cut has no reduced one)",
                  _not_given("reduced")),
    ),
    "treat.dose": (
        Dependent(("shapes", "shares", "places", "rejoin"), "generated shapes, which --plan replaces",
                  _not_given("plan")),
    ),
    "trial.activate": (
        Dependent(("strategy", "instruction", "study", "missing_side", "missing_muscle", "plot"),
                  "--kind face", _is("kind", "face")),
    ),
    "volunteers.volunteers": (
        Dependent(("cross_talk",), "a world without mismatched pick-up", _without_mismatch),
    ),
    "trial.score": (Dependent(("baseline",), "the motion of a jaw", _kind("motion", "jaw_motion")),),
}  # fmt: skip
"""Dependent parameters of every command, by its module in `emgface.cli` and its function."""


def refuse_without_effect(command: str, given: Given, defaults: Given) -> None:
    """Raise BadParameter for a parameter other than its default that would have no effect.

    `command` is a key of `DEPENDENT`, `given` the values of all parameters, `defaults` those of the
    function, in which required parameters are absent.
    """
    for one in DEPENDENT.get(command, ()):
        idle = [name for name in one.names if _changed(given.get(name), defaults.get(name))]
        if idle and not one.met(given):
            said = " and ".join(option_of(name) for name in idle)
            raise typer.BadParameter(
                f"{said}: no effect without {one.needs}, expected both or neither: "
                "leave it out, or change the other"
            )


def key_of(command: Callable[..., Any]) -> str:
    """Key of a command in `DEPENDENT`."""
    return f"{command.__module__.rpartition('.')[2]}.{command.__name__}"


def option_of(name: str) -> str:
    """Option of a parameter as a user writes it."""
    switches = {"open_page": "--no-open", "contact": "--no-contact", "recordings": "recordings"}
    return switches.get(name, f"--{name.strip('_').replace('_', '-')}")


def _changed(value: object, default: object) -> bool:
    return value != default and value not in (None, [], ())
