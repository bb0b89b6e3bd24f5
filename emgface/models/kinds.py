"""Kinds of models (face, jaw, tongue, head): generated, imported, fitted, moved and scored in one way.

A kind is a module with the functions of `Functions` and an entry of `MODEL_KINDS`. Commands and the
functions of ``import emgface as ef`` find it by its name, or by the kind that a file declares.
"""

import inspect
import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Protocol

from emgface.errors import ConfigurationError, listed

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Person:
    """Person of a generated model; `None` is the default of the kind."""

    preset: str = "adult"
    seed: int | None = None
    measures: tuple[str, ...] = ()  #: settings such as ``mouth_width=52mm``
    resolution: str | int | None = None
    parts: tuple[str, ...] | None = None  #: of a head
    contacts: tuple[str, ...] | None = None  #: of a head
    rings: Mapping[str, str] | None = None  #: of orbicularis oris, of a head
    models: Mapping[str, Path] | None = None  #: files of parts of a head in place of generated ones


@dataclass(frozen=True)
class Drive:
    """Input that moves a model (a file, names with levels, or a task), and the options of the motion.

    Attributes
    ----------
    source : a file of excitations, a recording (head), names such as ``bi_GGP=0.3,SL=0.2`` (tongue,
        head), or the name of a task (jaw).
    duration, step : simulated time and largest time step [s].
    accuracy : desired error, such as "0.1 mm".
    settings : parameters of the kind by name.
    recorded : options of a recording: study, strategy, instruction, mapping, reference.
    """

    source: str
    duration: float | None = None
    step: float | None = None
    accuracy: str | None = None
    settings: Mapping[str, str] = field(default_factory=dict[str, str])
    recorded: Mapping[str, Any] = field(default_factory=dict[str, Any])


@dataclass(frozen=True)
class Moved:
    """Motion of a model, sentences about it, and tables with their titles."""

    motion: "xr.Dataset"
    notes: Sequence[str] = ()
    tables: Sequence[tuple[str, "pd.DataFrame"]] = ()


@dataclass(frozen=True)
class Evidence:
    """Inputs to which a model is fitted: landmarks and surfaces of a person.

    Attributes
    ----------
    landmarks, places : files or values of landmarks, and of their places on the model.
    surfaces : files or scans by the name of the part, such as "skin" or "jaw".
    unit : unit of the files that do not state it.
    rim : the surfaces end at the rim of the face, which is then a contour (face).
    noise : standard deviation of a landmark [m].
    thickness : thickness where no data determine it, in standard deviations (face).
    frame : fitted model of the same person: the face of a jaw, the jaw of a tongue.
    before : jaw from which that of `frame` was fitted (tongue).
    courses : tractography by muscle, which replaces the courses of the muscles (face).
    volumes : volume of such a muscle by its name [m3].
    name, simulated : name of the result; the inputs are simulated.
    """

    landmarks: Any = None
    places: Any = None
    surfaces: Mapping[str, Any] = field(default_factory=dict[str, Any])
    unit: str | None = None
    rim: bool = False
    noise: float = 0.8e-3
    thickness: float = 0.0
    frame: Path | None = None
    before: Path | None = None
    courses: Mapping[str, Any] | None = None
    volumes: Mapping[str, float] | None = None
    name: str = "fitted"
    simulated: bool = False


@dataclass(frozen=True)
class FittedModel:
    """Fitted model, sentences about it, and the function that writes its page, if it has one."""

    model: "xr.Dataset"
    notes: Sequence[str]
    report: Callable[[Path], object] | None


class Functions(Protocol):
    """Functions of the module of a kind."""

    def build(self, person: Person) -> Any:
        """Generate the model of a person."""
        ...

    def import_(self, folder: Path, settings: Mapping[str, str]) -> Any:
        """Import the published model from its folder."""
        ...

    def read(self, path: Path) -> Any:
        """Read a model from its file."""
        ...

    def write(self, model: Any, path: Path) -> object:
        """Write the file of a model."""
        ...

    def fit(
        self, model: Any, evidence: Evidence, progress: Callable[[str, int, int], None]
    ) -> FittedModel:
        """Fit a model to a person."""
        ...

    def describe(self, model: Any) -> str:
        """Describe a model in one sentence part: its name, and how many parts it has."""
        ...

    def check(self, model: Any) -> "Sequence[tuple[str, pd.DataFrame]]":
        """Titles and tables of the counts and measures of a model."""
        ...

    def move(self, model: Any, drive: Drive, progress: Progress) -> Moved:
        """Simulate the motion of a model."""
        ...

    def write_motion(self, motion: "xr.Dataset", model: Any, path: Path) -> object:
        """Write the file of a motion."""
        ...

    def table(
        self, model: Any, settings: Mapping[str, str], progress: Progress
    ) -> "tuple[str, pd.DataFrame]":
        """Simulate every task or muscle, and tabulate the outcomes under a title."""
        ...

    def scored(
        self, recording: "xr.Dataset", motion: Path, options: Mapping[str, Any]
    ) -> "tuple[xr.Dataset, Any, str]":
        """Score a motion by a recording: scores, table and a note."""
        ...


@dataclass(frozen=True)
class Kind:
    """Kind of model: its name, the kinds of its files, and the module of its functions."""

    name: str
    model: str
    motion: str
    home: str
    #: options of `Person` that the kind does not have
    without: tuple[str, ...] = ()
    #: options of `Evidence` that the kind does not have
    not_fitted: tuple[str, ...] = ()

    @property
    def functions(self) -> Functions:
        """Functions of the kind, imported when they are used."""
        return import_module(self.home)  # pyright: ignore[reportReturnType]  # a test checks it

    def build(self, person: Person) -> Any:
        """Generate the model of a person; ConfigurationError for options that it does not have."""
        plain = Person()
        given = [name for name in self.without if getattr(person, name) != getattr(plain, name)]
        if given:
            raise ConfigurationError(
                f"a {self.name} has no {listed(given)}, expected only options of its kind: leave it out"
            )
        return self.functions.build(person)

    def fit(
        self, model: Any, evidence: Evidence, progress: Callable[[str, int, int], None]
    ) -> FittedModel:
        """Fit a model to a person; ConfigurationError for inputs that its kind does not have."""
        given = [
            name for name in self.not_fitted if getattr(evidence, name) not in (None, 0.0, False)
        ]
        if given:
            raise ConfigurationError(
                f"the fit of a {self.name} has no {listed(given)}, expected only inputs of its kind: "
                "leave it out"
            )
        return self.functions.fit(model, evidence, progress)


HEAD_INPUTS: Final = ("parts", "contacts", "rings", "models")
OF_FACES: Final = ("courses", "volumes")
MODEL_KINDS: Final[Mapping[str, Kind]] = {
    kind.name: kind
    for kind in (
        Kind(
            "face", "face_model", "trajectory", "emgface.models.face", HEAD_INPUTS, ("frame", "before")
        ),
        Kind(
            "jaw", "jaw_model", "jaw_motion", "emgface.models.jaw", ("resolution", *HEAD_INPUTS),
            ("rim", "thickness", "before", *OF_FACES),
        ),
        Kind(
            "tongue", "tongue_model", "tongue_motion", "emgface.models.tongue", HEAD_INPUTS,
            ("rim", "thickness", "landmarks", "places", *OF_FACES),
        ),
        Kind("head", "head_model", "head_motion", "emgface.models.head"),
    )
}  # fmt: skip


def kind_named(name: str) -> Kind:
    """Return the kind with a name; ConfigurationError if there is none."""
    if name not in MODEL_KINDS:
        raise ConfigurationError(
            f"there is no kind {name!r}, expected one of {', '.join(MODEL_KINDS)}"
        )
    return MODEL_KINDS[name]


def kind_of_model(path: Path) -> Kind:
    """Return the kind of the model in a file, by what the file declares.

    Raises DataError if it cannot be read, ConfigurationError if it is no model.
    """
    return _declared(path, "model")


def kind_of_motion(path: Path) -> Kind:
    """Return the kind of the model whose motion is in a file; errors as of `kind_of_model`."""
    return _declared(path, "motion")


def _declared(path: Path, what: str) -> Kind:
    from emgface.schema.netcdf import kind_of

    declared = kind_of(path)
    matching = next(
        (kind for kind in MODEL_KINDS.values() if getattr(kind, what) == declared), None
    )
    if matching is None:
        expected = ", ".join(getattr(kind, what) for kind in MODEL_KINDS.values())
        raise ConfigurationError(
            f"{path.name} is of the kind {declared or 'unknown'!r}, expected the {what} of a face, jaw, "
            f"tongue or head ({expected}): specify such a file"
        )
    return matching


def chosen(
    function: Callable[..., Any], settings: Mapping[str, str], *names: str
) -> dict[str, Any]:
    """Keyword arguments of a function from settings such as ``{"variant": "larynx"}``.

    Only the parameters `names` may be set. A value has the type of the default; a parameter without
    one is a text. Raises ConfigurationError for an unknown name or a value of another type.
    """
    known = inspect.signature(function).parameters
    options: dict[str, Any] = {}
    for name, text in settings.items():
        if name not in names:
            raise ConfigurationError(
                f"there is no setting {name!r}, expected "
                + (f"one of {', '.join(names)}" if names else "none: leave it out")
            )
        options[name] = _value(name, text, known[name].default)
    return options


def _value(name: str, text: str, default: object) -> Any:
    if isinstance(default, bool):
        if text.lower() not in ("true", "false"):
            raise ConfigurationError(f"{name} = {text!r}, expected true or false")
        return text.lower() == "true"
    if isinstance(default, int | float):
        try:
            number = type(default)(text)
        except ValueError:
            number = float("nan")
        if not math.isfinite(number):
            raise ConfigurationError(f"{name} = {text!r}, expected a finite number")
        return number
    return text


def parsed(settings: Sequence[str]) -> dict[str, str]:
    """Settings such as ``variant=larynx`` by name.

    Raises ConfigurationError without an equals sign, or for a name that is specified twice.
    """
    values: dict[str, str] = {}
    for one in settings:
        name, sign, value = (part.strip() for part in one.partition("="))
        if not (sign and name and value):
            raise ConfigurationError(
                f"the setting {one!r} is not of the form NAME=VALUE, such as law=hill: correct it"
            )
        if name in values:
            raise ConfigurationError(
                f"{name} is specified twice, as {values[name]} and {value}, expected one value: "
                "leave one out"
            )
        values[name] = value
    return values


def tolerance_of(accuracy: str | None) -> float | None:
    """Desired error [m] of a text such as "0.1 mm"; ConfigurationError for presets, which faces have."""
    from emgface.face.accuracy import desired_error

    tolerance = None if accuracy is None else desired_error(accuracy)
    if accuracy is not None and tolerance is None:
        raise ConfigurationError(
            f"accuracy = {accuracy!r}, expected an error such as '0.1 mm': specify one"
        )
    return tolerance


def error_of(motion: "xr.Dataset", tolerance: float | None) -> str:
    """Sentence on the estimated error, and how to reduce it if it is large."""
    if "numerical_error" not in motion.attrs:
        return (
            "The error of the time steps is not known, because a repetition with shorter steps failed "
            f"({motion.attrs['repetition_failed']}): lower the excitations, or specify another --step."
        )
    error, x = motion.attrs["numerical_error"], motion["position"]
    moved = float(((x - x.isel(time=0)) ** 2).sum("axis").max()) ** 0.5
    text = f"Estimated error of the time steps: {1e3 * error:.2g} mm"
    text += f", {100.0 * error / moved:.2g} % of the motion." if moved > 0.0 else "."
    if tolerance is not None and error > tolerance:
        shortest = 1e3 * motion.attrs["step_s"]
        text += f" It exceeds the desired error even with the shortest steps, {shortest:.2g} ms."
    elif tolerance is None and error > 0.1 * moved:
        text += " It exceeds a tenth of the motion: specify an --accuracy such as '0.1 mm'."
    return text


def refuse_unused(drive: Drive, used: Sequence[str], what: str) -> None:
    """Raise ConfigurationError for options of a recording that have no effect on what moves a model.

    `used` are those that have one; `what` describes the input in the message.
    """
    if idle := [name for name in drive.recorded if name not in used]:
        names = {"normalisation": "clip"}
        said = listed([f"--{names.get(name, name).replace('_', '-')}" for name in idle])
        raise ConfigurationError(
            f"{drive.source} is {what}, to which {said} cannot be applied, expected a recording that "
            "moves a face: simulate it, or omit these options"
        )


def names_file(source: str) -> bool:
    """Return True if what moves a model is a file, and not a task or exciters with levels."""
    # os.path also answers for a text that is too long for the name of a file. A folder in the working
    # folder may have the name of a task; one that is written with its place is meant.
    written = "=" in source or "," in source or not Path(source).suffix
    folder = os.path.isdir(source) and len(Path(source).parts) > 1
    return os.path.isfile(source) or folder or not written


def levels_of(source: str, level: float) -> dict[str, float]:
    """Exciters and levels of a text such as ``bi_GGP=0.3,SL``; none for "rest".

    `level` is that of exciters without one. Raises ConfigurationError for levels outside 0-1.
    """
    levels: dict[str, float] = {}
    for one in () if source == "rest" else source.split(","):
        name, _, text = (part.strip() for part in one.partition("="))
        if name in levels:
            raise ConfigurationError(f"{name} is given twice, expected every exciter once")
        try:
            levels[name] = float(text or level)
        except ValueError:
            levels[name] = float("nan")
        if not name or Path(name).suffix or not 0.0 <= levels[name] <= 1.0:
            raise ConfigurationError(
                f"{one!r}, expected a file of excitations, or names with levels from 0 to 1 such as "
                "bi_GGP=0.3,SL=0.2: correct it"
            )
    return levels
