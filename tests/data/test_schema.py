"""Every declaration accepts a valid dataset and reports each fault."""

import json
import re
from collections.abc import Callable

import numpy as np
import pytest
import xarray as xr

from emgface.errors import SchemaError, UnitsError
from emgface.muscles import AXES, CHANNELS, FACE_MARKERS, LIP_MARKERS, MUSCLES
from emgface.schema.migration import MIGRATIONS, migrate
from emgface.schema.netcdf import read_netcdf
from emgface.schema.page import schema_page, study_schema_text
from emgface.schema.validation import declaration, kinds, schema_folder, validate

KINDS = (
    "activation",
    "cube",
    "emg_calibration",
    "face_model",
    "head_model",
    "head_motion",
    "jaw_excitation",
    "jaw_model",
    "jaw_motion",
    "recording",
    "reduced_face",
    "scores",
    "sound",
    "tongue_model",
    "tongue_motion",
    "trajectory",
)
#: names without further values: the parts are groups of the file, and surfaces are those of a part
LISTS = {"head_model": {"part", "contact"}, "head_motion": {"named"}}
Make = Callable[[str], xr.Dataset]


def complaint(dataset: xr.Dataset, kind: str, *, study: bool = False) -> str:
    with pytest.raises(SchemaError) as caught:
        validate(dataset, kind, study=study)
    return str(caught.value)


def test_every_kind_is_declared() -> None:
    assert kinds() == KINDS


@pytest.mark.parametrize("kind", KINDS)
def test_declarations_name_themselves_and_repeat_no_key(kind: str) -> None:
    def once(pairs: list[tuple[str, object]]) -> dict[str, object]:
        names = [name for name, _ in pairs]
        assert len(names) == len(set(names)), f"a key occurs twice among {names}"
        return dict(pairs)

    text = (schema_folder() / f"{kind}.json").read_text(encoding="utf-8")
    content = json.loads(text, object_pairs_hook=once)
    assert content["kind"] == kind == declaration(kind).kind


@pytest.mark.parametrize("kind", KINDS)
def test_dims_have_their_names_declared(kind: str) -> None:
    declared = declaration(kind)
    for name in set(declared.coords) - LISTS.get(kind, set()):
        used = [{*array.dims, array.index_into} for array in declared.variables.values()]
        assert name in set.union(*used)


def test_names_are_those_of_the_study() -> None:
    study = declaration("recording").study
    assert study is not None
    assert study.names == {"channel": CHANNELS, "marker": FACE_MARKERS + LIP_MARKERS}
    for kind in ("recording", "activation", "face_model"):
        assert declaration(kind).coords["muscle"].names == MUSCLES
    face = declaration("face_model").coords
    assert (face["marker"].names, face["face_marker"].names) == (LIP_MARKERS, FACE_MARKERS)
    for kind in ("recording", "face_model", "trajectory"):
        assert declaration(kind).coords["axis"].names == AXES


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("study", [False, True])
def test_a_valid_dataset_passes_unchanged_in_value(valid: Make, kind: str, study: bool) -> None:
    given = valid(kind)
    before = given.copy(deep=True)
    checked = validate(given, kind, study=study)
    xr.testing.assert_identical(given, before)
    xr.testing.assert_equal(checked, given)
    assert checked.attrs["schema"] == kind
    assert checked.attrs["schema_version"] == declaration(kind).version
    named = [name for name in declaration(kind).arrays() if name in checked.variables]
    assert all(checked[name].attrs["long_name"] for name in named)
    xr.testing.assert_identical(validate(checked, kind), checked)


@pytest.mark.parametrize("kind", KINDS)
def test_a_missing_required_variable_is_reported(valid: Make, kind: str) -> None:
    required = [name for name, a in declaration(kind).arrays().items() if a.required]
    for name in required:
        assert re.search(rf"'{name}' is missing", complaint(valid(kind).drop_vars(name), kind))


@pytest.mark.parametrize("kind", KINDS)
def test_each_unit_is_required(valid: Make, kind: str) -> None:
    measured = [name for name, a in declaration(kind).arrays().items() if a.units]
    for name in measured:
        for wrong, phrase in (({}, "has no unit"), ({"units": "inch"}, "is in 'inch'")):
            dataset = valid(kind)
            if name not in dataset.variables:
                continue
            dataset[name].attrs = wrong
            with pytest.raises(UnitsError, match=f"^{name} {phrase}; expected '"):
                validate(dataset, kind)


@pytest.mark.parametrize("kind", KINDS)
def test_each_range_and_each_gap_is_checked(valid: Make, kind: str) -> None:
    tried = 0
    for name, array in declaration(kind).variables.items():
        dataset = valid(kind)
        if array.dtype != "float64" or name not in dataset:
            continue
        first = (0,) * dataset[name].ndim
        for value, low_or_high in ((-1e9, 0), (1e9, 1)):
            bounded = array.range is not None and array.range[low_or_high] is not None
            spoilt = dataset.copy(deep=True)
            spoilt[name].values[first] = value
            if bounded:
                tried += 1
                assert complaint(spoilt, kind).startswith(f"{name} is {value:.6g}")
        spoilt = dataset.copy(deep=True)
        spoilt[name].values[first] = np.nan
        if array.nullable:
            validate(spoilt, kind)
            spoilt[name].values[first] = np.inf
        message = complaint(spoilt, kind)
        assert re.match(rf"{name} has 1 of \d+ values (not finite|infinite)", message)
    assert tried > 0


def test_a_misspelt_variable_is_named_with_the_right_one(trial: xr.Dataset) -> None:
    text = complaint(trial.rename(emg="egm"), "recording")
    assert text == "Variable 'egm' is not defined for kind 'recording'; expected 'emg': rename it."


def test_a_foreign_variable_is_refused_in_a_recording(trial: xr.Dataset) -> None:
    text = complaint(trial.assign(force=("time_emg", np.zeros(512), {"units": "N"})), "recording")
    assert text.startswith(
        "Variable 'force' is not defined for kind 'recording'; expected only emg,"
    )


def test_a_further_variable_needs_a_unit(valid: Make) -> None:
    dataset = valid("trajectory")
    dataset["elastic_energy"].attrs = {}
    with pytest.raises(UnitsError, match="elastic_energy has no unit"):
        validate(dataset, "trajectory")


def test_a_missing_channel_is_named_with_the_label_that_looks_like_it(trial: xr.Dataset) -> None:
    labels = ["OOS_l" if c == "OOS_L" else c for c in CHANNELS]
    general = trial.assign_coords(channel=labels)
    validate(general, "recording")
    text = complaint(general, "recording", study=True)
    assert "channel lacks OOS_L" in text and "'OOS_l' may be 'OOS_L'" in text


def test_missing_markers_are_listed(trial: xr.Dataset) -> None:
    text = complaint(trial.isel(marker=slice(1, 15)), "recording", study=True)
    assert text.startswith("marker lacks forehead_left, lower_lateral_right; a study requires")


@pytest.mark.parametrize("name", ["channel", "time_emg", "marker", "axis", "time_marker"])
def test_a_part_that_is_present_has_its_coordinates(trial: xr.Dataset, name: str) -> None:
    text = complaint(trial.drop_vars(name), "recording")
    assert text.startswith(f"The coordinate {name!r} is missing, found emg, position")


def test_a_part_may_be_absent_unless_for_a_study(trial: xr.Dataset) -> None:
    emg = trial.drop_vars(["position", "marker", "axis", "time_marker"])
    validate(emg, "recording")
    assert "'position' is missing" in complaint(emg, "recording", study=True)
    empty = emg.drop_vars(["emg"])
    assert complaint(empty, "recording").startswith("The recording contains none of emg, position")


def test_the_axis_keeps_its_names_and_order(trial: xr.Dataset) -> None:
    text = complaint(trial.assign_coords(axis=["z", "y", "x"]), "recording")
    assert text.startswith("axis is z, y, x; expected x, y, z in this order")


def test_dims_out_of_order_are_to_be_transposed(trial: xr.Dataset) -> None:
    wrong = trial.assign(emg=trial["emg"].T)
    expected = "emg has dims (time_emg, channel); expected (channel, time_emg): transpose it."
    assert complaint(wrong, "recording") == expected


def test_time_must_increase_and_names_be_unique(trial: xr.Dataset) -> None:
    time = trial["time_emg"].values.copy()
    time[5] = time[4]
    late = trial.assign_coords(time_emg=("time_emg", time, {"units": "s"}))
    assert "time_emg goes from 0.00195312 to 0.00195312 at sample 5" in complaint(late, "recording")
    double = trial.assign_coords(channel=["OOS_L", *CHANNELS[:-1]])
    assert "channel contains 'OOS_L' more than once" in complaint(double, "recording")


def test_single_precision_and_text_are_refused(trial: xr.Dataset) -> None:
    single = trial.assign(emg=trial["emg"].astype("float32").assign_attrs(units="V"))
    assert complaint(single, "recording").startswith("emg contains float32; expected 64-bit floats")
    text = trial.assign(emg=trial["emg"].astype(str).assign_attrs(units="V"))
    assert complaint(text, "recording").startswith("emg contains <U")


def test_attributes_are_checked(trial: xr.Dataset) -> None:
    assert "'measurd' (did you mean 'measured'?)" in complaint(
        trial.assign_attrs(origin="measurd"), "recording"
    )
    assert "'repetition' is 0; expected at least 1" in complaint(
        trial.assign_attrs(repetition=0), "recording"
    )
    assert "'repetition' is 'one'" in complaint(trial.assign_attrs(repetition="one"), "recording")
    del trial.attrs["origin"]
    assert "'origin' is missing" in complaint(trial, "recording")


def test_a_study_names_its_trials(trial: xr.Dataset) -> None:
    del trial.attrs["volunteer"]
    validate(trial, "recording")
    assert "attribute 'volunteer' is missing" in complaint(trial, "recording", study=True)


def test_another_kind_or_version_is_refused(valid: Make) -> None:
    face = validate(valid("face_model"), "face_model")
    text = "The dataset is of kind 'face_model', expected 'recording': specify the other file."
    assert complaint(face, "recording") == text
    assert "follows version 99" in complaint(face.assign_attrs(schema_version=99), "face_model")
    assert "did you mean 'recording'?" in complaint(face, "recordings")


def test_all_faults_are_reported_at_once(trial: xr.Dataset) -> None:
    trial["position"].attrs["units"] = "mm"
    text = complaint(trial.assign_attrs(origin="x").assign_coords(axis=list("abc")), "recording")
    assert text.startswith("The recording has 3 problems:\n- ")
    assert len(text.splitlines()) == 4


@pytest.mark.parametrize("name", ["connectivity", "bundle_index", "bundle_muscle", "marker_node"])
def test_an_index_stays_within_its_dim(valid: Make, name: str) -> None:
    size = valid("face_model").sizes[str(declaration("face_model").variables[name].index_into)]
    for value in (size, 10_000, -2):
        face = valid("face_model")
        face[name].values[(-1,) * face[name].ndim] = value
        assert re.match(rf"{name} points to \w+ {value} at ", complaint(face, "face_model"))


def test_a_direction_has_length_one(valid: Make) -> None:
    face = valid("face_model")
    face["bundle_direction"].values[3] = 0.5, 0.0, 0.0
    assert complaint(face, "face_model").startswith("bundle_direction has length 0.5 at row 3")


def test_integers_of_any_width_become_the_declared_one(valid: Make) -> None:
    face = valid("face_model")
    assert face["connectivity"].dtype == np.int64
    checked = validate(face, "face_model")
    assert (checked["connectivity"].dtype, checked["layer"].dtype) == (np.int32, np.int8)
    face["node_id"].values[0] = 2**40
    assert "beyond int32" in complaint(face, "face_model")


def test_status_has_a_fixed_form(valid: Make) -> None:
    cube = valid("cube")
    cube["status"].values[0, 0, 0, 0] = "crashed"
    assert complaint(cube, "cube").startswith("status contains 'crashed'; expected ok|missing|excl")


def test_an_unknown_muscle_is_named(valid: Make) -> None:
    data = valid("activation").assign_coords(muscle=["ZIG_L", *MUSCLES[1:]])
    assert "contains 'ZIG_L' (did you mean 'ZYG_L'?)" in complaint(data, "activation")


# versions


def test_a_cube_of_version_1_is_read_as_one_of_the_present_version(valid: Make, tmp_path) -> None:
    """A file of version 1 written by xarray keeps its values."""
    old = valid("cube").assign_attrs(schema="cube", schema_version=1)
    old["status"].attrs["long_name"] = "ok, missing, or failed"
    old.to_netcdf(tmp_path / "cube.nc")
    dataset = read_netcdf(tmp_path / "cube.nc", "cube")
    assert dataset.attrs["schema_version"] == declaration("cube").version == 3
    assert dataset.attrs["migrated_from"] == 1
    assert "excluded" in dataset["status"].attrs["long_name"]
    for name in old.data_vars:
        np.testing.assert_array_equal(dataset[name].values, old[name].values)


def test_versions_are_migrated_one_by_one_or_refused_by_name(valid: Make) -> None:
    steps = {
        ("scores", 1): lambda d: d.rename(rmse="error"),
        ("scores", 2): lambda d: d.assign(error=1e3 * d["error"]),
        ("scores", 4): lambda d: d,
    }
    old = valid("scores").assign_attrs(schema_version=1)
    new = migrate(old, "scores", 3, migrations=steps)
    np.testing.assert_array_equal(new["error"], 1e3 * old["rmse"])
    assert (new.attrs["schema_version"], new.attrs["migrated_from"]) == (3, 1)
    assert migrate(old, "scores", 1) is old and "rmse" in old
    refused = {
        1: "cannot be migrated",
        6: "newer package",
        0: "cannot be migrated",
        "x": "cannot be migrated",
    }
    for version, why in refused.items():
        said = f"version {version} .*{why}"
        with pytest.raises(SchemaError, match=said):
            migrate(old.assign_attrs(schema_version=version), "scores", 5, migrations=steps)


def test_the_unsigned_opening_of_older_trajectories_is_dropped(
    valid: Callable[[str], xr.Dataset],
) -> None:
    old = valid("trajectory").assign_attrs(schema_version=1)
    new = migrate(old, "trajectory", declaration("trajectory").version)
    assert "lip_opening" in old and "lip_opening" not in new
    xr.testing.assert_equal(new["position"], old["position"])


def test_every_version_before_the_present_one_has_its_migration() -> None:
    known = {(kind, v) for kind in kinds() for v in range(1, declaration(kind).version)}
    assert set(MIGRATIONS) == known


# the page and the schema of a study


def test_the_page_is_up_to_date_and_names_everything(root) -> None:
    page = schema_page()
    written = (root / "docs" / "data_schema.md").read_text(encoding="utf-8")
    assert written == page, "run: emgface schema --out docs/data_schema.md"
    for kind in KINDS:
        declared = declaration(kind)
        for name in (*declared.arrays(), *declared.attrs):
            assert f"| `{name}`" in page


def test_the_schema_of_a_study_file_is_up_to_date() -> None:
    written = (schema_folder() / "study.json").read_text(encoding="utf-8")
    text = "run: emgface schema --study --out data_schema/study.json"
    assert written == study_schema_text(), text
    schema = json.loads(written)
    assert schema["properties"]["simulation"] and schema["version"] == 1
