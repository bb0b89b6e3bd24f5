"""Cross-talk of the sEMG: declared matrices, their estimate from trials, and the unmixed activations."""

import numpy as np
import pytest

import sim
from emgface.errors import DataError
from emgface.inverse.assumptions import prior
from emgface.inverse.mixing import estimated_row, in_order_of, read_mixing
from emgface.muscles import MUSCLES
from sim.inverse import MeasuredActivation, Splines, Weights, ends_of_steps, track
from tests.inverse.points import constant_muscles, particle
from tests.inverse.test_track import ENDS, lissajous


def test_a_matrix_is_read_by_names(tmp_path):
    path = tmp_path / "mixing.csv"
    path.write_text("signal,RIS_L,LAO_L,ZYG_L\nZYG_L,0.2,0.1,1\nDAO_R,,0,0\n")
    X = read_mixing(path)
    i = MUSCLES.index("ZYG_L")
    assert X[i, MUSCLES.index("RIS_L")] == 0.2 and X[i, MUSCLES.index("LAO_L")] == 0.1
    assert X.sum() == pytest.approx(20.3) and (np.diag(X) == 1.0).all()
    turned = in_order_of(X, MUSCLES[::-1])
    assert (turned == X[::-1, ::-1]).all()


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("signal,RIS_L\nBUC_L,0.1\n", "row 'BUC_L', expected each of these once: ZYG_L"),
        ("signal,RISORIUS\nZYG_L,0.1\n", "column 'RISORIUS'"),
        (
            "signal,RIS_L\nZYG_L,1.5\n",
            "share 1.5 of RIS_L in the signal over ZYG_L, expected 0 to 1",
        ),
        ("signal,RIS_L,ZYG_L\nZYG_L,0.1,0.8\n", "share 0.8 of ZYG_L in its own signal, expected 1"),
        ("signal,RIS_L\nZYG_L,much\n", "cannot be read as a mixing matrix"),
    ],
)
def test_matrices_that_make_no_sense_are_refused(tmp_path, text, sentence):
    path = tmp_path / "mixing.csv"
    path.write_text(text)
    with pytest.raises(DataError, match=sentence):
        read_mixing(path)


def test_a_known_share_is_estimated_and_an_unknown_one_stays_at_zero():
    rng = np.random.default_rng(0)
    a = np.clip(rng.normal(0.2, 0.2, (400, 4)), 0.0, 1.0)
    a[:, 3] = 0.0  # a muscle that is silent in all trials
    signal = a[:, 0] + 0.3 * a[:, 1] + 0.02 * rng.standard_normal(400)
    row = estimated_row(signal, a, 0.0 * a, 0, np.array([1, 2, 3]), 1.0 / 0.02**2)
    assert row == pytest.approx([1.0, 0.3, 0.0, 0.0], abs=0.02)
    row = estimated_row(signal, a, 0.0 * a + 1.0, 0, np.array([1, 2, 3]), 1.0 / 0.02**2)
    assert row[1] < 0.05  # the motion does not determine the other muscle


def test_mixed_signals_are_unmixed_in_both_forms():
    splines = Splines(0.2, 0.05)
    t = ends_of_steps(20, 0.01)
    X = np.array([[1.0, 0.4], [0.2, 1.0]])
    true = np.random.default_rng(1).uniform(0.1, 0.5, (splines.n, 2))
    signal = splines.basis(t) @ true @ X.T
    precision = prior(splines, t, 1e3, 1e9, 1e3, signal, np.full(2, 1e6), X)
    assert np.linalg.solve(precision.Q, precision.c).reshape(-1, 2) == pytest.approx(true, abs=1e-4)

    system, last = particle(ENDS, constant_muscles(ENDS))
    X = np.eye(16) + 0.2 * np.eye(16, k=1)
    true = np.full(16, 0.3)
    given = sim.Activation(np.zeros(1), (X @ true)[None])
    measured = MeasuredActivation(given, np.full(16, 1e6), X)
    done, _ = track(
        system, [lissajous(last)], duration=0.03, measured=measured, weights=Weights(motion=0.0)
    )
    assert done["activation"].values[:, -1] == pytest.approx(true, abs=1e-4)
    with pytest.raises(sim.ControlError, match="prescribed by an activation with cross-talk"):
        MeasuredActivation(given, np.full(16, np.inf), X)
