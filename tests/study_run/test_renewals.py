"""Renewals of contact rows by default, and in what was written before they were the default."""

import json
from pathlib import Path

import netCDF4
import numpy as np
import pytest
import xarray as xr

from emgface.cli.study_state import _study
from emgface.errors import FaceError
from emgface.face.accuracy import ACCURACY_PRESETS
from emgface.face.integration import INTEGRATORS
from emgface.face.motion import REST_ATTRIBUTE, of_rest, require_rest, settle_face
from emgface.face.recipe import compose_scene
from emgface.face.simulation_parameters import SimulationParameters
from emgface.reduced.full_order import with_steps
from emgface.reduced.model import mechanics_of
from emgface.report.results import open_results, study_cube
from emgface.run.retention import export
from emgface.study.audit import explain, reproduce
from emgface.study.configuration import StudyConfiguration
from emgface.study.file import variants
from sim import ConstraintContact

pytestmark = pytest.mark.filterwarnings("ignore::emgface.errors.FeatureWarning")

ITERATING = ("draft", "study", "reference", "0.2 mm")
EARLIER = ("absent", 0)  #: values in configurations of earlier versions


def renewed(face: xr.Dataset, **values) -> int:
    """Number of renewals in the scene of a face."""
    scene = compose_scene(face, SimulationParameters.model_validate(values))
    (term,) = (term for term in scene.terms if isinstance(term, ConstraintContact))
    return term.renewals


def test_rows_are_renewed_once_by_the_solvers_that_iterate(coarse: xr.Dataset) -> None:
    for accuracy in (*ITERATING, "published"):
        assert renewed(coarse, accuracy=accuracy) == (accuracy in ITERATING), accuracy
    assert set(ACCURACY_PRESETS) == {"draft", "study", "reference", "published", "realtime"}
    assert ACCURACY_PRESETS["realtime"]["solver"] == ACCURACY_PRESETS["published"]["solver"]
    for solver in INTEGRATORS.keys() - {"trapezoidal"}:  # which has no contact
        assert renewed(coarse, solver=solver) == (solver in ("sdirk2", "converged")), solver


def test_a_specified_number_remains_with_another_accuracy(coarse: xr.Dataset) -> None:
    for given, accuracy, wanted in (
        ({}, "published", 0),
        ({"accuracy": "published"}, "draft", 1),
        ({"contact": {"renewals": 0}}, "draft", 0),
        ({"contact": {"renewals": 0}}, "published", 0),
        ({"contact": {"renewals": 2}}, "reference", 2),
    ):
        own = SimulationParameters.model_validate(given).as_accurate(accuracy)
        assert renewed(coarse, **own.model_dump()) == wanted, (given, accuracy)
    training = with_steps(SimulationParameters.model_validate({"contact": {"renewals": 2}}))
    assert training == with_steps(SimulationParameters())


def as_before(folder: Path, stored: object, version: int = 2) -> None:
    """Change the cube of a study to one of an earlier version, with or without the parameter."""
    with netCDF4.Dataset(folder / "cube.nc", "a") as opened:
        whole = json.loads(opened.configuration)
        if stored == "absent":
            del whole["simulation"]["contact"]["renewals"]
        else:
            whole["simulation"]["contact"]["renewals"] = stored
        whole["simulation"]["contact"]["method"] = "constraint"
        whole["simulation"]["solver"] = "sdirk2"
        opened.configuration = json.dumps(whole)
        opened.schema_version = np.int64(version)


READERS = {
    "cube": lambda folder: StudyConfiguration.model_validate_json(
        study_cube(folder).attrs["configuration"]
    ),
    "report": lambda folder: open_results(folder).study,
    "commands": lambda folder: _study(folder, None),
}
"""All that read the configuration of a finished study."""


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("stored", EARLIER)
def test_a_finished_study_keeps_the_value_it_ran_with(
    shown: Path, coarse: xr.Dataset, tmp_path: Path, stored: object, reader: str
) -> None:
    """Also in the variants of an axis that determines the solver."""
    folder = tmp_path / "study"
    export(shown, folder)
    as_before(folder, stored)
    study = READERS[reader](folder)
    axis = {"parameters": ["simulation.accuracy"], "levels": ["study", "draft", "published"]}
    varied = StudyConfiguration.model_validate(study.model_dump() | {"axis": [axis]})
    for one in (study, *(variant.study for variant in variants(varied))):
        assert one.simulation.contact.renewals == 0
        assert renewed(coarse, **one.simulation.model_dump()) == 0


@pytest.mark.parametrize("stored", [None, 0, 1])
def test_a_study_of_this_version_keeps_what_it_specifies(
    shown: Path, tmp_path: Path, stored: int | None
) -> None:
    folder = tmp_path / "study"
    export(shown, folder)
    as_before(folder, stored, version=3)
    assert _study(folder, None).simulation.contact.renewals == stored


def test_an_earlier_study_is_reproduced_and_changes_are_explained(
    shown: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "study"
    export(shown, folder)
    with netCDF4.Dataset(folder / "cube.nc", "a") as opened:
        whole = json.loads(opened.configuration)
        del whole["simulation"]["contact"]["renewals"]
        opened.configuration = json.dumps(whole)
        opened.schema_version = np.int64(2)
    study, store = _study(folder, None), folder / "store"
    for reproduced in reproduce(study, folder, store, report=lambda text: None):
        assert reproduced.differences == [] and reproduced.equal == 5
    sentence = explain(study, folder, store, "S01 B 1 act_rel".split())
    assert "from stage motion on: contact.renewals changed from None to 0" in sentence[0]


@pytest.mark.parametrize("stored", [*EARLIER, 1])
def test_equilibria_of_all_versions_serve_all_numbers_of_renewals(
    coarse: xr.Dataset, stored: object
) -> None:
    accuracies = [
        SimulationParameters.model_validate({"accuracy": a}) for a in ("study", "published")
    ]
    settled = settle_face(coarse, accuracies[0])
    assert len({json.dumps(of_rest(p)) for p in accuracies}) == 1
    own = json.loads(settled.attrs[REST_ATTRIBUTE])
    assert "renewals" not in own["contact"]
    if stored != "absent":
        own["contact"]["renewals"] = stored
    earlier = settled.assign_attrs({REST_ATTRIBUTE: json.dumps(own)})
    for p in accuracies:
        require_rest(earlier, coarse, p)
    own["contact"]["friction"] = 0.3
    with pytest.raises(
        FaceError, match=r"with contact.friction = 0.3, found contact.friction = 0.0"
    ):
        require_rest(settled.assign_attrs({REST_ATTRIBUTE: json.dumps(own)}), coarse, accuracies[0])


def test_an_equilibrium_does_not_depend_on_renewals(coarse: xr.Dataset) -> None:
    rests = [
        settle_face(coarse, SimulationParameters.model_validate({"contact": {"renewals": n}}))
        for n in (0, 2)
    ]
    np.testing.assert_array_equal(*(rest["node_position"].values for rest in rests))


def test_reduced_faces_are_not_bound_to_renewals() -> None:
    made = {
        mechanics_of(SimulationParameters.model_validate({"contact": {"renewals": n}}))
        for n in (None, 0, 1)
    }
    assert len(made) == 1 and "renewals" not in made.pop()
