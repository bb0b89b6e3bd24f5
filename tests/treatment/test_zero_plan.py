"""A plan without effect changes no bit of a face, and therefore none of what is computed from it."""

import json
from typing import get_args

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

import emgface as ef
from emgface.api.given import study_of
from emgface.cli import LISTED_COMMANDS, app
from emgface.face.file import load_face, save_face
from emgface.face.simulation_parameters import SimulationParameters
from emgface.inverse.parameters import InverseParameters
from emgface.inverse.run import invert
from emgface.pictures.body import skin_of
from emgface.reduced import training
from emgface.run.store import Store
from emgface.signals.parameters import SignalChain
from emgface.study.file import study_face
from emgface.treatment.motions import compared_motions, gestures
from emgface.treatment.outcomes import movement_table, outcome_table
from emgface.treatment.plan import Plan, Step
from emgface.view.moving import FullMoving
from emgface.view.page import live_page
from tests.inverse.recordings import recording_of
from tests.reduced.test_face import PARAMETERS, SMALL, short
from tests.treatment.plans import QUICK, wedge

ZERO = {
    "wedge": ({"width": 0.0}, {"height": 0.0}, {"width": 0.0, "place": 0.2, "shape": "shield"}),
    "incision": ({"height": 0.0},),
    "palsy": ({"degree": 0.0, "side": "both"},),
}
NONE = {
    "tumour": "its radii are positive",
    "change": "factors of 1 are refused by a sentence",
    "resection": "it applies to a jaw, and has no size",
}
"""Steps of a face by kind with which they change nothing, and why those of other kinds always do."""


@pytest.fixture(scope="module")
def pair(coarse, tmp_path_factory):
    """Files of a face, and of the same after a plan of every kind of step without effect."""
    folder = tmp_path_factory.mktemp("zero")
    steps = [{"kind": kind, **given} for kind, every in ZERO.items() for given in every]
    save_face(coarse, folder / "face.nc")
    lines = [
        "[[step]]\n" + "".join(f"{name} = {json.dumps(value)}\n" for name, value in step.items())
        for step in steps
    ]
    (folder / "plan.toml").write_text("\n".join(lines), encoding="utf-8")
    done(folder, "treat", "plan.toml", "face.nc", "--out", "zero.nc")
    return folder, ("face", "zero")


def done(folder, *words):
    endings = (".nc", ".toml", ".html")
    files = [str(folder / word) if word.endswith(endings) else word for word in words]
    result = CliRunner().invoke(app, files)
    assert result.exit_code == 0, result.output
    return result.output


def stored(path):
    """Content of a file without the time that it took, and without names of files."""
    with xr.open_dataset(path) as dataset:
        kept = {k: v for k, v in dataset.attrs.items() if "run_time" not in k and "made" not in k}
        return dataset.load().drop_attrs(deep=False).assign_attrs(kept)


def simulated(folder, name):
    done(folder, "simulate", "ZYG_L=0.3,ZYG_R=0.2", "--model", f"{name}.nc", "--no-contact",
         "--duration", "0.05", "--out", f"{name}.motion.nc")  # fmt: skip
    return stored(folder / f"{name}.motion.nc")


def reduced(folder, name):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(training, "training_plan", short)
        store = Store(folder / "training")
        reduction = training.reduce_face(load_face(folder / f"{name}.nc"), PARAMETERS, SMALL, store)
    if name == "zero":
        assert {event.outcome for event in store.events} == {"reused"}
    return reduction.assign_attrs(training_time_s=0.0)


def inverted(folder, name):
    face = load_face(folder / f"{name}.nc")
    p = SimulationParameters(solver="linearly_implicit", gravity=False, output=0.04,
                             contact={"method": "none"}, sigma_max=115e3)  # fmt: skip
    inverse = invert(
        recording_of(face), face, p, SignalChain(), InverseParameters(variant="motion")
    )
    return inverse.drop_attrs(deep=False)


def shown(folder, name):
    done(folder, "show", f"{name}.nc", "--out", f"{name}.html")
    text = (folder / f"{name}.html").read_text(encoding="utf-8")
    return text.replace(f"{name}.nc", "")


def moved_live(folder, name):
    """Page of the live face, and where its skin and markers are after each of two steps."""
    face = load_face(folder / f"{name}.nc")
    skin = skin_of(face)
    moving = FullMoving(face, QUICK, skin, 0.01)
    steps = [moving(np.full(len(moving.muscles), 0.1)) for _ in range(2)]
    page = live_page(face, skin, moving, words="sliders", sliders=True, edits=False)
    return page, [(m.skin.tobytes(), m.markers.tobytes(), m.note) for m in steps]


def sounded(folder, name):
    simulated(folder, name)
    return done(folder, "sound", "trial", f"{name}.motion.nc")


CONSUMERS = {
    "check": lambda folder, name: done(folder, "check", f"{name}.nc").replace(f"{name}.nc", ""),
    "show": shown,
    "simulate": simulated,
    "reduce": reduced,
    "invert": inverted,
    "sound": sounded,
    "treat": lambda folder, name: ef.treat(
        load_face(folder / f"{name}.nc"), wedge(), sigma_max=100e3
    ),
    "live": moved_live,
    "study": lambda folder, name: study_face(
        study_of({"face": {"path": str(folder / f"{name}.nc")}}).face
    ),
}
"""Functions that compute the result of a command from the file of a face, by command."""
BY_MOTION = "compare score volunteers fit tabulate".split()
"""Commands whose faces are read like those of `simulate`; `compare` has its own test below."""
NO_FACE = (
    "map describe inventory features convert cut activate build import segment dose sweep demo record "
    "report schema"
).split()  # fmt: skip


def test_every_kind_of_step_and_every_command_is_classified():
    kinds = {one.model_fields["kind"].default for one in get_args(get_args(Step)[0])}
    assert kinds == {*ZERO, *NONE}
    verbs = {verb for verbs in LISTED_COMMANDS.values() for verb, *_ in verbs}
    assert verbs == {*CONSUMERS, *BY_MOTION, *NO_FACE}


def test_the_face_is_the_same_with_all_its_names(pair, coarse):
    folder, names = pair
    one, two = (stored(folder / f"{name}.nc") for name in names)
    xr.testing.assert_identical(one, two)
    assert list(one.variables) == list(two.variables) and list(one.attrs) == list(two.attrs)
    for kind, every in ZERO.items():
        for given in every:
            assert ef.treat(coarse, Plan(step=[{"kind": kind, **given}])) is coarse


@pytest.mark.filterwarnings("ignore::emgface.errors.FeatureWarning")
@pytest.mark.parametrize("verb", CONSUMERS)
def test_a_command_computes_the_same_bits(pair, verb):
    folder, names = pair
    one, two = (CONSUMERS[verb](folder, name) for name in names)
    if isinstance(one, xr.Dataset):
        xr.testing.assert_identical(one, two)
    else:
        assert one == two and one


def test_the_comparison_states_no_change(pair):
    folder, names = pair
    faces = [load_face(folder / f"{name}.nc") for name in names]
    drives = gestures(faces[0], ("A", "closing"))
    motions = compared_motions(*faces, drives, QUICK, source="")
    table = outcome_table(*faces, motions)
    change = table["change"].to_numpy(float)
    assert set(change[np.isfinite(change)]) == {0.0} and np.isfinite(change).sum() >= 10
    assert not [name for name in table.columns if "lowest" in name or "%" in name]
    assert not motions.notes and not motions.failed
    agreement = movement_table(motions)
    assert set(agreement["amplitude ratio"]) == {1.0}
    np.testing.assert_allclose(agreement["rho"], 1.0, atol=1e-12)
