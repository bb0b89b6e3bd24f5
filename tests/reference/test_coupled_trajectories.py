"""Motions of jaw, hyoid and published tongue compared with those of another simulator.

Four cases of python -m benchmarks tongue_coupled, at most until 0.1 s.
"""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks import tongue_coupled
from benchmarks.__main__ import run
from benchmarks.recorded_bones import CONDYLES, TO_M, sliding_point
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
def test_recorded_forces_balance_on_the_strips_and_at_the_points_of_the_benchmark():
    """Force on the jaw at the end of opening, by the strips below the condyles and by others [N]."""
    case, arrays = tongue_coupled.recorded("jh_open_ad_ip_0.2", "coupled")
    head = recorded_head("jh")
    rigid = head.model["rigid"]
    jaw = next(b for b in rigid["bodies"] if b["name"] == "jaw")
    owner = {m["name"]: m["body"] for m in rigid["markers"]}
    local = {m["name"]: np.array(m["location_body_mm"]) for m in rigid["markers"]}
    pose = {b: arrays["body_pose"][-1, k] for k, b in enumerate(case["bodies"])}

    def turned(body, x):
        w, *v = pose[body][3:]
        return pose[body][:3] + Rotation.from_quat([*v, w]).apply(x)

    def place(name):
        return turned(owner[name], local[name]) if owner[name] in pose else local[name]

    net = np.array([0.0, 0.0, -9.8 * jaw["mass_kg"]])
    for muscle, force in zip(case["muscles"], arrays["muscle_force_N"][-1], strict=True):
        m = next(m for m in rigid["muscles"] if m["name"] == muscle)
        ends = place(m["first"]), place(m["second"])
        pull = force * (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
        net += pull * ((owner[m["first"]] == "jaw") - 1.0 * (owner[m["second"]] == "jaw"))
    points = dict(zip(case["connectors"], arrays["constraint_point_mm"][-1], strict=True))
    q = np.zeros_like(head.start)
    for name in CONDYLES:
        q[head.points[name]] = TO_M @ points[name]
    strips = head.strips(q)

    def residual(left, right):
        total = net.copy()
        for k, name in enumerate(case["connectors"]):
            c = next(c for c in rigid["connectors"] if c["name"] == name)
            chosen = {"LTMJ": left, "RTMJ": right}.get(name)
            normal = (
                c["normal_world_D_z"] if chosen is None else c["planes"][chosen]["normal_world"]
            )
            total += arrays["constraint_force_N"][-1, k] * np.array(normal)
        return np.linalg.norm(total)

    assert strips == (11, 19)
    assert residual(*strips) < 1e-6
    assert min(residual(10, 19), residual(12, 19), residual(11, 18)) > 0.2
    places = [sliding_point(head.model, name) for name in CONDYLES]
    offset = [turned("jaw", x) - points[n] for x, n in zip(places, CONDYLES, strict=True)]
    np.testing.assert_allclose(offset, 0.0, atol=1e-5)


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


def test_a_folder_without_recordings_is_named(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(tongue_coupled, "SHARED", tmp_path)
    with pytest.raises(HeadError, match="contains no recorded case: set EMGFACE_SHARED"):
        main()
    with pytest.raises(SystemExit, match="2"):
        run(["tongue_coupled"])
    assert capsys.readouterr().err.startswith("HeadError: ")
