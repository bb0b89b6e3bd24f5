"""Bodies, joints, attachments, contact: required and measured values (``--table`` prints them).

Motion, elimination, momentum, orders of integrators, rest and sliding of bodies in contact, and thin
bodies that move fast.
"""

from collections.abc import Iterator

import numpy as np
import pandas as pd
import pytest

import sim
from benchmarks.bodies_accuracy import hanging, run, spinning, swinging
from benchmarks.bodies_accuracy import orders as accuracy_orders
from benchmarks.stability.rigid_rows import tower
from sim.integrators import INTEGRATORS
from tests.contact import test_bodies_in_contact, test_fast_and_short_steps
from tests.kinematics import test_joints, test_motion, test_multibody, test_volumes
from tests.specification import Result, limited

Results = Iterator[Result]
SHORTER = 4  #: factor by which steps are shorter than in the tests of orders
CONVERGED = sim.ConvergedEuler, sim.Trapezoidal, sim.Sdirk2


def _off(computed: np.ndarray, exact: np.ndarray) -> float:
    return float(np.abs(computed - exact).max() / np.abs(exact).max())


def free_and_joined() -> Results:
    """Top, pendulum, drift and redundancy of joints, and the bar of tissue.

    `benchmarks.bodies_accuracy` turns the top a thousand times, which takes half an hour.
    """
    limits = 1e-10, 1e-10, 1e-8, 1e-6, 1e-9, 1e-9, 1e-3
    table = pd.concat([spinning(20)[0], swinging(), hanging()[0]])
    for (case, error), limit in zip(table.itertuples(index=False), limits, strict=True):
        yield limited(str(case), float(error), limit)
    worst, _ = test_multibody.drift_of_a_chain()
    yield limited("chain of two joints, 100 s: drift", float(max(worst)), 1e-9, " m")


def attached() -> Results:
    """Attachments, elimination and momentum."""
    start, free, led = test_motion.attached_and_led()
    apart = float(np.abs(led - free).max() / np.abs(free - start).max())
    yield limited("tissue on a body against its motion prescribed, relative", apart, 1e-10)
    for kind, pairs in (
        ("joints", test_volumes.rows_and_saddle()),
        ("a joint and contacts", test_bodies_in_contact.contact_and_saddle()),
    ):
        for what, (computed, exact) in zip(("velocities", "forces"), pairs, strict=True):
            name = f"{kind} eliminated against the dense saddle system: {what}, relative"
            yield limited(name, _off(computed, exact), 1e-9)
    for cls in (*CONVERGED, sim.LinearlyImplicitEuler, sim.LinearlyImplicitTrapezoidal):
        before, after = test_motion.momentum_of_a_free_compound(cls)
        name = f"momentum of tissue and two joined bodies, {cls.__name__}, relative"
        yield limited(name, _off(after, before), 1e-10)


def orders() -> Results:
    """Measured orders of integrators, within 0.1 of the declared ones."""

    def line(case: str, cls: type, order: float) -> Result:
        declared = float(getattr(cls, "order", np.nan))
        met = abs(order - declared) <= 0.1
        return Result(f"order, {case}: {cls.__name__}", f"{declared:g}", f"{order:.2f}", met)

    for cls in INTEGRATORS:
        order = test_motion.order_with_rotation_and_attachments(cls, SHORTER)
        yield line("rotation" + ", attachments" * (cls.stability != "conditional"), cls, order)
    for cls in CONVERGED:
        yield line("joints and tissue", cls, test_joints.order_with_joints_and_tissue(cls)[0])
    table = accuracy_orders()
    for case in table.columns[2:]:
        for name, declared, order in table[["integrator", "declared", case]].itertuples(
            index=False
        ):
            if np.isfinite(order):
                met = abs(order - declared) <= 0.1
                yield Result(f"order, {case}: {name}", f"{declared:g}", f"{order:.2f}", met)


def touching() -> Results:
    """Stack, block on an incline, and thin plates that move fast."""
    system = sim.compile_scene(tower(5))
    start = system.rest_state()
    end = run(system, start, 10.0, 100, sim.LinearlyImplicitEuler())
    drift = float(np.abs(end.frames - start.frames).max())
    yield limited("stack of five boxes, 10 s: drift [m, rad]", drift, 1e-11)
    for degrees, friction in ((20.0, 0.5), (35.0, 0.5)):
        for cls in test_bodies_in_contact.EULER_AND_CONVERGED:
            end, wanted = test_bodies_in_contact.on_an_incline(degrees, friction, cls())
            error = abs(float(end.twists[0, 0]) - 0.05 * wanted)
            name = f"block on {degrees:g} degrees, friction {friction}, {cls.__name__}: speed"
            yield limited(name, error, 1e-8, " m/s")
    passed = refused = 0
    for kind in ("body", "shell", "tissue"):
        for cls in test_fast_and_short_steps.INTEGRATORS:
            for thick, speed in test_fast_and_short_steps.PLATES:
                try:
                    left = test_fast_and_short_steps.left_behind(kind, cls(), thick, speed)
                    passed += left > 1e-5
                except sim.NotConverged:
                    refused += 1
    text = f"{passed}, {refused} refused"
    yield Result("thin plates that pass through a block, of 60", "0", text, passed == 0)


KNOWN = (
    "momentum of tissue and two joined bodies, LinearlyImplicit*",
    "order, pendulum on a hinge: RK4",
)
"""Lines that are not met: linearly implicit steps keep momentum to the order of the step only."""


@pytest.mark.slow
@pytest.mark.parametrize("check", [free_and_joined, attached, orders, touching])
def test_required_values_are_met(check, specified) -> None:
    specified(check(), KNOWN)
