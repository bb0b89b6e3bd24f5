"""Code path and number of threads of the direct solver, and their mention in results."""

import ctypes

import numpy as np
import pytest

import sim
from sim.linear import pardiso, pardiso_is_available
from sim.linear.pardiso import AUTO, AVX2, NOTE, STRICT, thread_count
from tests.verification.test_same_bits import CONVERGED, block, drive

needs_pardiso = pytest.mark.skipif(
    not pardiso_is_available(), reason="pypardiso is not installed for this platform"
)


class Processor:
    """MKL on a processor that supports some branches; records the one that is set."""

    def __init__(self, supported: set[int]) -> None:
        self.supported, self.branch = supported, 0

    def MKL_CBWR_Set(self, branch: ctypes.c_int) -> int:  # noqa: N802  # name of MKL
        if branch.value not in self.supported:
            return -3
        self.branch = branch.value
        return 0


@pytest.mark.parametrize(
    "supported, branch", [({AVX2 | STRICT, AUTO, 3}, AVX2 | STRICT), ({AUTO, 3}, AUTO)]
)
def test_the_code_path_is_that_of_the_processor(supported, branch):
    mkl = Processor(supported)
    pardiso._fix_code_path(mkl)
    assert mkl.branch == branch


@needs_pardiso
def test_the_loaded_library_has_no_slower_path():
    mkl = pardiso._new_solver(pardiso.SYMMETRIC_POSITIVE_DEFINITE).libmkl
    assert mkl.MKL_CBWR_Get(ctypes.c_int(-1)) in (AUTO, AVX2 | STRICT)


def run(count: int, linear: str = "auto"):
    system, seen = block("nodal"), set()
    work = sim.Workspace(system, linear)
    trajectory, state = sim.simulate(
        system,
        drive(system, 0.05),
        duration=0.05,
        integrator=CONVERGED,
        work=work,
        solver_threads=count,
        progress=lambda *_: seen.add(thread_count()),
    )
    return trajectory, state, seen


@needs_pardiso
def test_threads_are_used_and_stated_in_the_result():
    one, at_one, seen = run(1)
    assert seen == {1} and one.attrs["solver_threads"] == 1 and "note" not in one.attrs
    two, at_two, seen = run(2)
    assert seen == {2} and two.attrs["solver_threads"] == 2
    assert two.attrs["note"] == NOTE.format(2)
    assert thread_count() == 1
    np.testing.assert_allclose(at_two.q, at_one.q, rtol=0.0, atol=1e-9)


@needs_pardiso
def test_threads_reach_the_library(monkeypatch):
    asked = []
    inner = pardiso._on_threads

    def recorded(mkl, count):
        asked.append(count)
        return inner(mkl, count)

    monkeypatch.setattr(pardiso, "_on_threads", recorded)
    run(2)
    assert set(asked[1:]) <= {1, 2} and 2 in asked


def test_a_solver_without_threads_refuses_them():
    with pytest.raises(sim.SceneError, match="has one thread"):
        run(2, "superlu")
    with pytest.raises(sim.SceneError, match="expected a whole number of at least 1"):
        run(0)
    assert thread_count() == 1
