"""Arguments of the Python functions that have no meaning are refused by name, instead of used."""

import typing

import numpy as np
import pytest
import xarray as xr
from pydantic import BaseModel
from typer.testing import CliRunner

import emgface as ef
import sim
from analysis.align import align
from analysis.errors import TrajectoryError
from analysis.individual import asymmetry
from analysis.noise import marker_noise
from analysis.scores import amplitude_ratio, correlation_3d, rmse, score
from analysis.trajectory import checked
from emgface.choices import Parameters, configure
from emgface.cli import app
from emgface.errors import ConfigurationError, DataError, FeatureWarning, SchemaError
from emgface.face.file import save_face
from emgface.recordings.findings import findings_in
from emgface.signals.activation import feature_range
from emgface.signals.parameters import SignalChain
from emgface.study.configuration import StudyConfiguration

NAMES = [f"{name}_{side}" for side in "LR" for name in "OOS OOI RIS ZYG LLSAN DAO MEN".split()]


def recording(gain: float = 1.0, names=NAMES) -> xr.Dataset:
    rng = np.random.default_rng(3)
    time = np.arange(4096) / 2048
    burst = 0.2 + np.exp(-(((time - 1.0) / 0.3) ** 2))
    emg = rng.normal(size=(len(names), 4096)) * burst * 40e-6 * gain
    coords = {"channel": list(names), "time_emg": ("time_emg", time, {"units": "s"})}
    variable = (("channel", "time_emg"), emg, {"units": "V"})
    return xr.Dataset({"emg": variable}, coords, {"volunteer": "V1", "origin": "measured"})


def numbers(model: type[BaseModel], path: tuple[str, ...] = ()):
    """Path of every parameter of a model that is a number, or a list of numbers."""
    for name, field in model.model_fields.items():
        kind = field.annotation
        kinds = {kind, *typing.get_args(kind)}
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            yield from numbers(kind, (*path, name))
        elif kinds & {int, float} and bool not in kinds:
            yield (*path, name)


@pytest.mark.parametrize("path", list(numbers(StudyConfiguration)), ids=".".join)
@pytest.mark.parametrize("value", [True, False, np.True_])
def test_no_number_of_a_study_may_be_true_or_false(path, value):
    given: object = value
    for name in reversed(path):
        given = {name: given}
    with pytest.raises(ConfigurationError, match=f"{path[-1]} = (True|False), expected a number"):
        configure(StudyConfiguration, given)


def test_switches_and_lists_follow_the_same_rule():
    class Some(Parameters):
        switch: bool = True
        either: bool | int = 1
        pair: tuple[float, float] = (0.0, 1.0)

    assert configure(Some, {"switch": False, "either": True}).switch is False
    with pytest.raises(ConfigurationError, match="pair = .*expected a number"):
        configure(Some, {"pair": [0.0, True]})


@pytest.mark.filterwarnings("ignore::emgface.errors.FeatureWarning")
def test_a_range_that_is_passed_is_used():
    strong = recording(3.0)
    extent = feature_range([strong, recording()], SignalChain())
    alone = ef.activate(recording(), strategy="act_all")["activation"]
    options = {"strategy": "act_all", "normalisation": {"outside": "clip"}}
    for passed in ({"session": extent}, {"reference": extent}):
        within = ef.activate(recording(), **options, **passed)["activation"]
        assert float(within.max()) < float(alone.max()) or not np.allclose(within, alone)
    one = ef.activate(recording(), reference=strong, **options)["activation"]
    several = ef.activate(recording(), reference=[strong], **options)["activation"]
    assert np.array_equal(one, several)
    assert not np.allclose(one, alone)
    with pytest.raises(ConfigurationError, match="normalisation over the trial"):
        ef.activate(recording(), session=extent, normalisation={"reach": "trial"})
    with pytest.raises(ConfigurationError, match="session and of the reference"):
        ef.activate(recording(), session=extent, reference=extent)


@pytest.mark.filterwarnings("ignore::emgface.errors.FeatureWarning")
def test_a_band_may_be_an_array():
    given = ef.activate(recording(), strategy="act_all", band=np.array([20, 400]))
    assert given.equals(ef.activate(recording(), strategy="act_all", band=(20, 400)))


def test_repeated_channels_are_named():
    with pytest.raises(SchemaError, match="channel ZYG_L more than once"):
        ef.activate(recording(names=[*NAMES, "ZYG_L"]), strategy="act_all")


@pytest.mark.parametrize("face", [xr.Dataset(), 5, "transposed", "single"])
def test_a_face_that_is_none_is_refused(face):
    if isinstance(face, str):
        whole = ef.face(resolution="coarse")
        face = whole.transpose() if face == "transposed" else whole.astype("float32")
    activation = xr.Dataset(
        {"activation": (("muscle", "time"), np.zeros((1, 2)), {"units": "1"})},
        {"muscle": ["ZYG_L"], "time": ("time", [0.0, 0.1], {"units": "s"})},
    )
    with pytest.raises(DataError):
        ef.simulate(activation, face)


@pytest.mark.parametrize(
    ("levels", "given", "message"),
    [
        ({"X": 0.1}, {}, "no muscle 'X'"),
        ({"ZYG_L": 2.0}, {}, "level of ZYG_L is 2.0"),
        ({"ZYG_L": np.nan}, {}, "level of ZYG_L is nan"),
        ({"ZYG_L": "a"}, {}, "level of ZYG_L is 'a'"),
        ({"ZYG_L": 0.1}, {"duration": 0.0}, "duration is 0 s"),
        (xr.Dataset({"activation": ("time", [0.0])}), {"duration": 1.0}, "whose times are its own"),
    ],
)
def test_levels_of_muscles_are_checked(levels, given, message):
    with pytest.raises(ConfigurationError, match=message):
        ef.simulate(levels, ef.face(resolution="coarse"), **given)


def test_levels_of_muscles_are_those_of_the_command(tmp_path):
    face = tmp_path / "face.nc"
    save_face(ef.face(resolution="coarse"), face)
    options = [
        "--no-contact",
        "--accuracy",
        "draft",
        "--duration",
        "0.05",
        "--out",
        tmp_path / "m.nc",
    ]
    command = ["simulate", "ZYG_L=0.5,ZYG_R=0.25", "--model", face, *options]
    result = CliRunner().invoke(app, list(map(str, command)))
    assert result.exit_code == 0, result.output
    given = {"accuracy": "draft", "duration": 0.05, "contact": {"method": "none"}}
    own = ef.simulate({"ZYG_L": 0.5, "ZYG_R": 0.25}, face, **given)
    np.testing.assert_array_equal(ef.read(tmp_path / "m.nc")["position"], own["position"])


def motion(units: str = "s") -> xr.Dataset:
    rng = np.random.default_rng(0)
    values = rng.normal(size=(2, 3, 20))
    time = ("time", np.arange(20.0), {"units": units})
    coords = {"marker": ["a", "b"], "axis": list("xyz"), "time": time}
    return xr.Dataset({"position": (("marker", "axis", "time"), values, {"units": "m"})}, coords)


@pytest.mark.parametrize(
    ("option", "value"),
    [("form", "x"), ("reference", "last")]
    + [(name, v) for name in ("smallest_motion", "smallest_snr") for v in (-1.0, np.nan, np.inf)],
)
def test_unknown_options_of_a_score_are_refused(option, value):
    with pytest.raises(TrajectoryError, match=f"{option} is"):
        score(motion(), motion(), **{option: value})


@pytest.mark.parametrize("measure", [correlation_3d, rmse, amplitude_ratio])
def test_measures_refuse_other_shapes_and_types(measure):
    position = motion()["position"]
    with pytest.raises(TrajectoryError, match="of type ndarray"):
        measure(position.values, position)
    with pytest.raises(TrajectoryError, match="same markers on both"):
        measure(position, position.isel(marker=0))
    with pytest.raises(TrajectoryError, match="samples over time"):
        measure(position, position, dim="axis")


def test_times_in_other_units_are_refused():
    with pytest.raises(TrajectoryError, match="time is in 'ms'"):
        checked(motion("ms"), "measured")


@pytest.mark.parametrize("kind", [object, complex, bool, str])
@pytest.mark.parametrize("which", ["time", "values"])
def test_an_activation_has_real_numbers(kind, which):
    given = {"time": np.array([0.0, 1.0]), "values": np.array([[0.0], [1.0]])}
    given[which] = given[which].astype(kind)
    with pytest.raises(sim.ControlError, match="real numbers"):
        sim.Activation(**given)


def test_an_activation_of_whole_numbers_is_read_as_real_ones():
    given = sim.Activation(np.array([0, 2]), np.array([[0], [1]]))
    assert given.values.dtype == np.float64
    assert given.at(1.0).tolist() == [0.5]


def test_a_table_without_labels_keeps_its_first_sample(tmp_path):
    (tmp_path / "t.csv").write_text("0.5,1.25\n0.75,-1.5\n")
    sidecar = tmp_path / "t.toml"
    sidecar.write_text('schema = "recording"\n[emg]\nfile = "t.csv"\nunit = "uV"\nrate = 2000.0\n')
    with pytest.raises(DataError, match="begins with the numbers 0.5, 1.25"):
        ef.read(sidecar)
    sidecar.write_text(sidecar.read_text() + 'columns = ["left", "right"]\n')
    assert ef.read(sidecar)["emg"].values.tolist() == [[0.5e-6, 0.75e-6], [1.25e-6, -1.5e-6]]


@pytest.mark.filterwarnings("ignore::emgface.errors.FeatureWarning")
def test_an_instruction_that_contradicts_the_recording_is_a_finding():
    stated = recording().assign_attrs(instruction="A")
    with pytest.warns(FeatureWarning, match="recorded as instruction 'A', but 'B' was specified"):
        activation = ef.activate(stated, strategy="act_rel", instruction="B")
    assert activation.attrs["instruction"] == "B"
    assert "instruction" in [finding.code for finding in findings_in(activation)]
    for given in ({"instruction": "A"}, {}):
        same = ef.activate(stated, strategy="act_rel", **given)
        assert "instruction" not in [finding.code for finding in findings_in(same)]
    unstated = ef.activate(recording(), strategy="act_rel", instruction="B")
    assert "instruction" not in [finding.code for finding in findings_in(unstated)]


@pytest.mark.parametrize("name", ["strategy", "instruction"])
def test_empty_names_are_not_the_default(name):
    with pytest.raises(ConfigurationError, match=name):
        ef.activate(recording().assign_attrs(instruction="A"), **{name: ""})


def moving_markers(kind: str = "float64", clock: object = None) -> xr.DataArray:
    time = np.arange(200) / 100 if clock is None else clock
    wave = 5e-3 * np.sin(np.arange(200) / 30) * np.ones((2, 3, 1))
    coords = {"marker": ["a", "b"], "axis": list("xyz"), "time": time}
    return xr.DataArray(
        wave.astype(kind), coords, dims=("marker", "axis", "time"), attrs={"units": "m"}
    )


DATES = np.datetime64("2026-01-01") + np.arange(200).astype("timedelta64[ms]") * 10


@pytest.mark.parametrize("odd", [moving_markers("complex128"), moving_markers("U9")])
@pytest.mark.parametrize(
    "use",
    [
        lambda x: align(x, moving_markers()),
        lambda x: align(moving_markers(), x),
        lambda x: score(x, moving_markers()),
        lambda x: correlation_3d(x, moving_markers()),
        lambda x: amplitude_ratio(moving_markers(), x),
        lambda x: rmse(x, moving_markers()),
        asymmetry,
        marker_noise,
    ],
)
def test_positions_that_are_no_real_numbers_are_refused(use, odd):
    with pytest.raises(TrajectoryError, match=f"type {odd.dtype}, expected real numbers"):
        use(odd)


@pytest.mark.parametrize("use", [lambda x: align(x, moving_markers()), asymmetry, marker_noise])
def test_dates_are_no_time_of_markers(use):
    with pytest.raises(TrajectoryError, match="datetime64.*, expected real numbers"):
        use(moving_markers(clock=DATES))
