"""Results of one face or trial that meet another face or trial, at every public function."""

import inspect
import warnings

import numpy as np
import pytest
import xarray as xr

import emgface as ef
from emgface.errors import EmgfaceError, FaceError, FeatureWarning
from emgface.face.identity import DIGEST, FACE_ATTRIBUTE
from emgface.inverse.calibration import over_session
from emgface.muscles import LIP_MARKERS
from emgface.recordings.findings import findings_in
from emgface.run.digest import dataset_digest
from emgface.schema.netcdf import read_netcdf, write_netcdf
from emgface.signals.activation import feature_range
from emgface.signals.parameters import SignalChain
from tests.inverse.recordings import recording_of
from tests.inverse.test_calibration import known

CHOICES = {
    "accuracy": "published",
    "sigma_max": 50e3,
    "contact": {"method": "none"},
    "gravity": False,
}
OF_A_FACE = ("activation", "branch", "calibration", "compare", "motion", "settled", "trajectory")
"""Names of parameters that take what was computed from a face."""

MEETINGS = {
    ("score", "trajectory"): "found",
    ("show", "compare"): "found",
    ("simulate", "activation"): "found",
    ("invert", "calibration"): "found",
    ("simulate", "settled"): "refused",
}
"""Parameters of public functions that meet a face, or a result of one."""

ELSEWHERE = {
    ("simulate", "branch"): "bound to its scene: tests/face/test_waypoints.py",
    ("show", "activation"): "meets the motion of a trial: below",
    ("sound", "motion"): "uses the motion alone",
}


def test_every_parameter_that_takes_a_result_of_a_face_is_listed():
    parameters = {
        (name, parameter)
        for name in ef.__all__
        if inspect.isfunction(getattr(ef, name))
        for parameter in inspect.signature(getattr(ef, name)).parameters
        if parameter in OF_A_FACE
    }
    assert parameters - {("simulate", "activation")} >= {*MEETINGS} - {("simulate", "activation")}
    assert parameters == {*MEETINGS, *ELSEWHERE}


@pytest.fixture(scope="module")
def other(coarse):
    """Face of the same name, a millionth larger."""
    return coarse.assign(position=coarse["position"] * (1.0 + 1e-6))


@pytest.fixture(scope="module")
def trial(coarse):
    return recording_of(coarse)


@pytest.fixture(scope="module")
def drive(trial):
    short = trial["true_activation"].rename(time_true="time").sel(time=slice(0.4, 0.8))
    keep = ("volunteer", "instruction", "repetition")
    about = {key: trial.attrs[key] for key in keep} | {"origin": "simulated"}
    return (
        short.rename("activation")
        .to_dataset()
        .drop_vars("channel", errors="ignore")
        .assign_attrs(about)
    )


@pytest.fixture(scope="module")
def motions(coarse, other, drive):
    return tuple(ef.simulate(drive, face, **CHOICES) for face in (coarse, other))


def codes_of(call):
    """Codes of this kind that a call warns of, and its result."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        result = call()
    texts = [str(one.message) for one in caught if issubclass(one.category, FeatureWarning)]
    kinds = {", but the face ": "other_face", "states no digest": "face_unknown",
             "was computed from": "other_trial"}  # fmt: skip
    return {code for text in texts for words, code in kinds.items() if words in text}, result


def meet(name, drive, trial, motion, face, settled, made):
    """Call a public function with a result of one face and another, or the same, face."""
    if name == ("score", "trajectory"):
        return ef.score(trial, motion, face=face)
    if name == ("show", "compare"):
        return ef.show(motion, compare=made)
    if name == ("simulate", "activation"):
        inverted = drive.assign_attrs(
            {FACE_ATTRIBUTE: motion.attrs[FACE_ATTRIBUTE], DIGEST: motion.attrs[DIGEST]}
        )
        return ef.simulate(inverted, face, **CHOICES)
    if name == ("invert", "calibration"):
        about = {FACE_ATTRIBUTE: motion.attrs[FACE_ATTRIBUTE], DIGEST: motion.attrs[DIGEST]}
        about["range_parameters"] = feature_range([trial], over_session(SignalChain())).attrs[
            "parameters"
        ]
        return ef.invert(
            trial, face, calibration=known(**about).data, form="step", variant="assisted",
            study={"simulation": CHOICES | {"sigma_max": 1e5}},
        )  # fmt: skip
    return ef.simulate(drive, face, settled=settled, **CHOICES)


@pytest.mark.parametrize("name", MEETINGS, ids=str)
def test_a_result_of_another_face_is_found_and_of_the_same_is_not(
    name, coarse, other, drive, trial, motions
):
    settled = xr.Dataset(
        {"node_position": coarse["position"]},
        attrs={FACE_ATTRIBUTE: motions[0].attrs[FACE_ATTRIBUTE], DIGEST: motions[0].attrs[DIGEST]},
    )
    same = codes_of(lambda: meet(name, drive, trial, motions[0], coarse, settled, motions[0]))[0]
    assert not same
    if MEETINGS[name] == "refused":
        with pytest.raises(FaceError, match="belongs to the face .* with digest"):
            meet(name, drive, trial, motions[0], other, settled, motions[1])
        return
    codes, result = codes_of(
        lambda: meet(name, drive, trial, motions[0], other, settled, motions[1])
    )
    assert codes == {"other_face"}
    if isinstance(result, xr.Dataset):
        assert "other_face" in {one.code for one in findings_in(result)}


def test_files_state_the_digest_of_their_face(coarse, motions, tmp_path):
    write_netcdf(motions[0], tmp_path / "motion.nc", "trajectory")
    stored = read_netcdf(tmp_path / "motion.nc", "trajectory")
    assert stored.attrs[DIGEST] == dataset_digest(coarse) != motions[1].attrs[DIGEST]


def test_files_of_earlier_versions_are_said_not_refused(coarse, trial, motions):
    early = motions[0].copy()
    del early.attrs[DIGEST]
    codes, scores = codes_of(lambda: ef.score(trial, early, face=coarse))
    assert codes == {"face_unknown"} and np.isfinite(scores["shift"])
    early.attrs[FACE_ATTRIBUTE] = "another"
    assert codes_of(lambda: ef.score(trial, early, face=coarse))[0] == {"other_face"}
    del early.attrs[FACE_ATTRIBUTE]
    assert codes_of(lambda: ef.score(trial, early, face=coarse))[0] == {"face_unknown"}


@pytest.mark.parametrize("changed", [{"volunteer": "S02"}, {"repetition": 2}, {"instruction": "A"}])
def test_the_recording_of_another_trial_is_found(changed, coarse, drive, trial, motions):
    codes, scores = codes_of(lambda: ef.score(trial.assign_attrs(changed), motions[0], face=coarse))
    assert codes == {"other_trial"}
    assert "other_trial" in {one.code for one in findings_in(scores)}
    shown = codes_of(lambda: ef.show(motions[0], activation=drive.assign_attrs(changed)))[0]
    assert shown == {"other_trial"}
    assert not codes_of(lambda: ef.show(motions[0], activation=drive))[0]


def test_another_file_is_found_where_no_trial_is_named(coarse, drive, trial):
    bare = [one.drop_attrs(deep=False) for one in (drive, trial)]
    driven = bare[0].assign_attrs(origin="simulated", source_digest="a" * 64)
    motion = ef.simulate(driven, coarse, **CHOICES)
    for digest, expected in (("a" * 64, set()), ("b" * 64, {"other_trial"})):
        given = bare[1].assign_attrs(origin="simulated", source_digest=digest)
        assert codes_of(lambda given=given: ef.score(given, motion, face=coarse))[0] == expected
    assert set(LIP_MARKERS) <= set(motion["marker"].values.tolist())


def test_a_motion_is_shown_with_a_face_only_with_its_recording(motions, coarse):
    with pytest.raises(
        EmgfaceError, match="face of a trajectory has no effect without a recording"
    ):
        ef.show(motions[0], face=coarse)
