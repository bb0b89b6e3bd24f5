"""Motions of jaw, hyoid and published tongue compared with those of another simulator.

Four cases of python -m benchmarks tongue_coupled, at most until 0.1 s.
"""

import pytest

from benchmarks import tongue_coupled
from benchmarks.recorded_head import recorded_head
from benchmarks.tongue_coupled import levels, main, repeated
from emgface.errors import HeadError


@pytest.mark.usefixtures("shared")
@pytest.mark.parametrize(
    ("name", "until", "jaw", "tongue"),
    [
        ("jh_rest_gravity", 0.1, 0.01, 0.0),
        ("jh_open_ad_ip_0.2", 0.1, 0.04, 0.0),
        ("jht_element_GGP_0.2_nocontact", 0.05, 0.01, 0.1),
        ("jht_line_GGP_0.2_nocontact", 0.05, 0.01, 0.1),
    ],
)
def test_motions_of_jaw_hyoid_and_tongue(name, until, jaw, tongue):
    """Largest distances of the documented table [mm], rounded up."""
    row = repeated(name, until=until)
    assert row["ends"] == ""
    assert row["until s"] == pytest.approx(until)
    assert float(row["jaw"]) < jaw
    assert float(row.get("tongue", 0.0)) <= tongue


@pytest.mark.usefixtures("shared")
def test_excitations_of_different_exciters_add():
    """A muscle that two exciters contain has the sum of both; unknown exciters are refused."""
    head = recorded_head("jh")
    names = head.system((0, 0)).muscles
    one = {"amax": 0.2, "ramp_s": 0.1, "start_s": 0.0}
    case = {"name": "x", "excitations": [{"target": "bi_ad", **one}, {"target": "lad", **one}]}
    given = levels(case, head, names).values[-1]
    assert given[names.index("lad")] == pytest.approx(0.4)
    assert given[names.index("rad")] == pytest.approx(0.2)
    case["excitations"] = [{"target": "tongue/TRANSm", **one}]
    with pytest.raises(HeadError, match="no exciter 'tongue/TRANSm' of whole muscles"):
        levels(case, head, names)


@pytest.mark.usefixtures("shared")
def test_unknown_cases_and_other_schemes_are_refused(monkeypatch):
    with pytest.raises(HeadError, match="no recorded case jh_rest_graviti, expected some of"):
        main(case=["jh_rest_graviti"])
    case, arrays = tongue_coupled.recorded("jh_rest_gravity", "coupled")
    for key, value in (
        ("integrator", "RungeKutta4"),
        ("changes_against_the_model_file", ["teeth"]),
    ):
        other = case | {key: value}
        monkeypatch.setattr(tongue_coupled, "recorded", lambda *_, other=other: (other, arrays))
        with pytest.raises(HeadError, match="is not known, expected Trapezoidal"):
            repeated("jh_rest_gravity")


def test_a_folder_without_recordings_is_named(monkeypatch, tmp_path):
    monkeypatch.setattr(tongue_coupled, "SHARED", tmp_path)
    with pytest.raises(HeadError, match="contains no recorded case: set EMGFACE_SHARED"):
        main()
