"""Motions by a file of excitations last as long as the file, for every kind that is moved by one."""

import numpy as np
import pytest

from emgface.errors import FeatureWarning
from emgface.models.kinds import MODEL_KINDS, Drive, Person

EXCITER = {"jaw": "bi_open", "tongue": "bi_GGP", "head": "bi_GGP"}


@pytest.fixture(scope="module", params=sorted(EXCITER))
def moving(request, tmp_path_factory):
    """Function that moves a model by a file of 0.04 s."""
    kind = MODEL_KINDS[request.param]
    person = Person(contacts=()) if kind.name == "head" else Person()
    model, file = kind.build(person), tmp_path_factory.mktemp("file") / "u.csv"
    file.write_text(f"time,{EXCITER[kind.name]}\n0,0\n0.02,0.01\n0.04,0.01\n")
    return lambda duration: (
        kind.functions.move(model, Drive(str(file), duration=duration), lambda done, total: None)
        .motion["time"]
        .values
    )


def test_every_kind_but_the_face_is_walked():
    assert {*EXCITER, "face"} == {*MODEL_KINDS}


def test_a_motion_lasts_as_long_as_its_file(moving):
    assert moving(None)[-1] == pytest.approx(0.04)


def test_values_that_are_held_after_the_end_of_the_file_are_stated(moving):
    with pytest.warns(
        FeatureWarning, match=r"the excitations end at 0\.04 s: their last values are"
    ):
        assert moving(0.06)[-1] == pytest.approx(0.06)
    assert np.isfinite(moving(0.02)).all()
