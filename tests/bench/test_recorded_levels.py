"""Excitations and parameters of recorded cases of the tongue, without the recordings."""

import numpy as np
import pytest

from benchmarks import tongue
from benchmarks.tongue import parameters_of, recorded, recorded_levels, reference
from emgface.errors import TongueError

CASE = {
    "name": "made up",
    "variant": "line",
    "integrator": "ConstrainedBackwardEuler",
    "gravity": [0.0, 0.0, 0.0],
    "changes_against_the_model_file": ["gravity off"],
}


def excited(*rows):
    """Case with excitations (target, amax, start, ramp)."""
    names = ("target", "amax", "start_s", "ramp_s")
    return CASE | {"excitations": [dict(zip(names, row, strict=True)) for row in rows]}


def test_every_excitation_has_its_own_start_and_ramp():
    """a(t) = amax clip((t - start)/ramp, 0, 1); without a ramp it is constant."""
    time, levels = recorded_levels(
        excited(("GGP", 0.2, 0.0, 0.1), ("SL", 0.4, 0.05, 0.2), ("HG", 0.3, 0.0, 0.0))
    )
    t = np.array([0.0, 0.02, 0.05, 0.1, 0.15, 0.25, 0.4])
    for name, a, start, ramp in (("GGP", 0.2, 0.0, 0.1), ("SL", 0.4, 0.05, 0.2)):
        exact = a * np.clip((t - start) / ramp, 0.0, 1.0)
        np.testing.assert_allclose(np.interp(t, time, levels[name]), exact, atol=1e-15)
    np.testing.assert_allclose(levels["HG"], 0.3)


def test_two_excitations_of_one_target_are_refused():
    with pytest.raises(TongueError, match="excites GGP twice, expected every target once"):
        recorded_levels(excited(("GGP", 0.2, 0.0, 0.1), ("GGP", 0.1, 0.0, 0.1)))


def test_recorded_changes_become_parameters():
    messages = ["activation stiffening of the passive material switched off", "gravity off"]
    p = parameters_of(CASE | {"changes_against_the_model_file": messages})
    assert (p.stiffening, p.gravity, p.incompressibility) == (1.0, False, "hard")
    p = parameters_of(
        CASE
        | {"changes_against_the_model_file": ["hard incompressibility switched off"]}
        | {"gravity": [0.0, 0.0, -9.8]}
    )
    assert (p.stiffening, p.gravity, p.incompressibility) == (10.0, True, "element")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"variant": "fast"}, "because of variant fast"),
        ({"integrator": "Trapezoidal"}, "because of integrator Trapezoidal"),
        ({"gravity": [0.0, 9.8, 0.0]}, "because of gravity"),
        ({"changes_against_the_model_file": ["density doubled"]}, "because of density doubled"),
    ],
)
def test_what_cannot_be_repeated_is_refused(change, said):
    with pytest.raises(TongueError, match=said):
        parameters_of(CASE | change)


def test_absent_recordings_are_named(monkeypatch, tmp_path):
    monkeypatch.setattr(tongue, "SHARED", tmp_path)
    with pytest.raises(TongueError, match="x.json not found: set EMGFACE_SHARED"):
        recorded("x")
    with pytest.raises(TongueError, match="no recorded case  in .*: set EMGFACE_SHARED"):
        reference()
