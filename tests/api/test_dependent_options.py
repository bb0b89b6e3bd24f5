"""Options that another choice leaves without effect are refused, in every command and function."""

import inspect
from pathlib import Path

import numpy as np
import pytest
import typer
import xarray as xr

import emgface as ef
from emgface.cli import app
from emgface.cli.dependent import DEPENDENT, key_of, refuse_without_effect
from emgface.cli.written import WRITTEN_OPTIONS
from emgface.errors import ConfigurationError
from emgface.models.kinds import MODEL_KINDS, Drive, Person
from tests.api.test_command_numbers import commands
from tests.api.test_given_in_memory import made

COMMANDS = {key_of(callback): callback for _, callback in commands(app)}
NAMES = [
    (key, one, name) for key, every in DEPENDENT.items() for one in every for name in one.names
]

WITHOUT = {
    "the idealised tract, which --areas replaces": {"areas": Path("areas.csv")},
    "--source folds": {"source": "rosenberg", "wave": Path("a.wav")},
    "own values, which --calibration replaces": {"calibration": Path("c.nc")},
    "a variant that uses the sEMG": {"variant": "motion"},
    "a page": {"page": False},
    "a generated face, which that of a file replaces": {"face": Path("face.nc")},
    "a generated head, which that of --head replaces": {"head_path": Path("head.nc")},
    "contact, which --no-contact switches off": {"contact": False},
    "the noise, which --no-noise switches off": {"noise": False},
    "generated shapes, which --plan replaces": {"plan": Path("plan.toml")},
    "--kind face": {"kind": "jaw"},
    "a world without mismatched pick-up": {"world": "mismatched"},
    "full order (the face of the other cut has no reduced one)": {"reduced": [Path("a.nc")]},
}
"""Arguments with which the options have no effect, by what they need; none if it is a lone option."""

WITHOUT["--areas with a table"] = {"areas": Path("areas.nc")}
WITH = {
    "--areas with a table": {"areas": Path("areas.csv")},
    "--notch": {"notch": 50.0},
    "--landmarks": {"landmarks": Path("landmarks.csv")},
    "--course": {"course": ["ZYG_L=a.trk"]},
    "--source": {"source": "a.nc"},
    "--source or --curves": {"curves": Path("a.nc")},
    "--waypoints": {"waypoints": Path("w")},
    "--branch": {"branch": Path("b")},
    "--source rosenberg": {"source": "rosenberg"},
    "a sound to write (--out)": {"wave": Path("a.wav"), "source": "folds"},
    "recordings": {"recordings": Path("r")},
    "a world without mismatched pick-up": {"world": "matched"},
}
"""Arguments with which they have one; none if that is the default."""

KIND_OF_FILE = {
    "two faces, found a jaw": ("before", "jaw_model"),
    "the motion of a jaw": ("motion", "trajectory"),
}


def defaults_of(callback):
    every = inspect.signature(callback).parameters.values()
    return {p.name: p.default for p in every if p.default is not p.empty}


def other(value):
    if isinstance(value, bool):
        return not value
    if isinstance(value, int | float):
        return value + 1
    return "other"


@pytest.fixture
def jaw_or_motion(tmp_path):
    def write(kind):
        path = tmp_path / f"{kind}.nc"
        xr.Dataset(attrs={"schema": kind, "schema_version": 1}).to_netcdf(path)
        return path

    return write


@pytest.mark.parametrize(("key", "one", "name"), NAMES, ids=[f"{k} {n}" for k, _, n in NAMES])
def test_an_option_without_effect_is_refused_and_one_with_effect_is_not(
    key, one, name, jaw_or_motion
):
    callback = COMMANDS[key]
    assert name in inspect.signature(callback).parameters
    defaults = defaults_of(callback)
    absent = dict.fromkeys(inspect.signature(callback).parameters, Path("absent.nc"))
    for output in WRITTEN_OPTIONS.keys() & absent.keys():
        absent[output] = Path(f"{output}.csv")
    given = absent | defaults
    idle = WITHOUT.get(one.needs, {})
    if one.needs in KIND_OF_FILE:
        parameter, kind = KIND_OF_FILE[one.needs]
        idle = {parameter: jaw_or_motion(kind)}
    changed = {name: other(defaults.get(name))}
    with pytest.raises(typer.BadParameter, match="no effect without"):
        callback(**given | changed | idle)
    if one.needs not in KIND_OF_FILE:
        every = [d for d in DEPENDENT[key] if name in d.names]
        useful = {k: v for d in every for k, v in WITH.get(d.needs, {}).items()}
        refuse_without_effect(key, given | useful | changed, defaults)


@pytest.mark.parametrize("name", ["strategy", "band", "mapping", "normalisation"])
@pytest.mark.parametrize("kind", ["face", "jaw", "tongue", "head"])
def test_options_of_a_recording_are_refused_for_what_is_none(kind, name):
    drive = Drive("rest", None, None, None, {}, {name: "x"})
    option = "--clip" if name == "normalisation" else f"--{name}"
    with pytest.raises(ConfigurationError, match=f"{option} cannot be applied"):
        MODEL_KINDS[kind].functions.move(None, drive, lambda done, total: None)


@pytest.mark.parametrize("contacts", [(), ("lip-lip",)])
def test_a_face_has_no_contacts_of_a_head(contacts):
    with pytest.raises(ConfigurationError, match="has no contacts"):
        MODEL_KINDS["face"].build(Person(contacts=contacts))


@pytest.mark.parametrize(
    "given",
    [{"band": (20, 400)}, {"feature": "rms"}, {"missing_side": "mirror"}, {"instruction": "B"},
     {"normalisation": {"silent": "zero"}}],
)  # fmt: skip
def test_a_true_activation_takes_no_parameters_of_the_signals(given):
    with pytest.raises(ConfigurationError, match=f"{next(iter(given))} has no effect"):
        ef.activate(made("recording"), strategy="true", **given)


@pytest.mark.parametrize("name", ["recording", "compare", "face"])
def test_what_belongs_to_the_motion_of_a_face_is_not_shown_with_a_face(name):
    face = ef.face(resolution="coarse")
    with pytest.raises(ConfigurationError, match=f"without {name}"):
        ef.show(face, **{name: face})


@pytest.mark.parametrize(
    ("source", "given"),
    [
        ("folds", {"pitch": 200.0}),
        ("rosenberg", {"lung": 800.0}),
        ("rosenberg", {"tension": 1.2}),
        (None, {"duration": 1.0}),
    ],
)
def test_what_a_source_of_sound_does_not_have_is_refused(source, given):
    with pytest.raises(ConfigurationError, match=f"{next(iter(given))} has no effect"):
        ef.sound(source=source, **given)


def test_a_sound_is_no_longer_than_its_motion():
    time = ("time", np.linspace(0.0, 0.5, 6), {"units": "s"})
    coords = {"time": time, "axis": ["x", "y", "z"], "marker": ["corner_left"]}
    motion = xr.Dataset(
        {
            "position": (("marker", "axis", "time"), np.zeros((1, 3, 6)), {"units": "m"}),
            "mouth_area": ("time", np.full(6, 1e-4), {"units": "m2"}),
            "lip_protrusion": ("time", np.zeros(6), {"units": "m"}),
        },
        coords,
    )
    with pytest.raises(ConfigurationError, match="the motion lasts 0.5 s"):
        ef.sound(motion, duration=1.0)
