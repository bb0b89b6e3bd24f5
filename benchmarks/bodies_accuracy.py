"""Accuracy of rigid bodies: top, pendulum, joints, tissue on a body, orders, error against run time.

    python -m benchmarks bodies_accuracy --out docs/bodies

All motions are simulated and compared with closed forms, or with Euler's equations of the top that
`scipy.integrate` solves. Orders are those of the differences between successive step sizes.
"""

import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import sim
from analysis.figures.style import COLOURS, blank, grid, legend, save, styled
from benchmarks.integrators import EXPLICIT, IMPLICIT
from benchmarks.report import finish, shrink
from benchmarks.stability.rigid_rows import bodies_in_contact, cuboid, plate_on_tissue
from sim.integrators import Integrator
from sim.integrators.stage import Converged
from sim.joints import Revolute
from sim.kinematics import rotations

Floats = NDArray[np.float64]

MOMENTS = np.array([1.0, 2.0, 3.0]) * 1e-4  #: of the top [kg m^2]
SPIN = np.array([0.2, 10.0, 0.1])  #: its initial angular velocity, near the middle axis [rad/s]
G, ARM = 9.81, 0.1
TIGHT = {"tolerance": 1e-12, "residual_tolerance": 1e-10}


def run(
    system: sim.System, start: sim.State, duration: float, steps: int, integrator: Integrator
) -> sim.State:
    """State after some equal steps."""
    return sim.simulate(system, sim.resting(0), duration=duration, every=duration, initial=start,
                        steps=sim.FixedStep(duration / steps), integrator=integrator,
                        probes=())[1]  # fmt: skip


def moving(system: sim.System, *twist: float) -> sim.State:
    """State at rest positions with a twist of the last body."""
    w = np.zeros(system.pattern.n)
    w[-6:] = twist
    return system.kinematics.state(system.rest_state().pose, w, {})


def spinning(turns: int) -> tuple[pd.DataFrame, Floats, Floats]:
    """Errors of the top after many turns; times, and its angular velocity of three turns."""
    body = sim.Body("top", 0.2, np.diag(MOMENTS))
    system, turn = sim.compile_scene(sim.Scene(sim.NO_TISSUE, (), bodies=(body,))), 0.2 * np.pi
    start, steps = moving(system, 0.0, 0.0, 0.0, *SPIN), 600

    def momentum(state: sim.State) -> tuple[Floats, float]:
        Q = rotations.matrices(state.frames[:, 3:])[0]
        L = Q @ (MOMENTS * (Q.T @ state.twists[0, 3:]))
        return L, float(state.twists[0, 3:] @ L)

    end = run(system, start, turns * turn, turns * steps, sim.RungeKutta4())
    (L0, E0), (L1, E1) = momentum(start), momentum(end)
    times = np.linspace(0.0, 3.0 * turn, 61)
    omega, state = [SPIN], start
    for _ in times[1:]:
        state = run(system, state, times[1], steps // 20, sim.RungeKutta4())
        omega.append(rotations.matrices(state.frames[:, 3:])[0].T @ state.twists[0, 3:])
    exact = euler(times)
    table = pd.DataFrame(
        [
            (f"top, {turns} turns: angular momentum, relative",
             float(np.abs(L1 - L0).max() / np.abs(L0).max())),
            (f"top, {turns} turns: energy, relative", abs(E1 / E0 - 1.0)),
            ("top, 3 turns: angular velocity against Euler's equations, relative",
             float(np.abs(np.array(omega) - exact).max() / 10.0)),
        ],
        columns=["case", "error"],
    )  # fmt: skip
    return table, times, np.array(omega)


def euler(times: Floats) -> Floats:
    """Angular velocity (n, 3) of the top in its axes, from I dw/dt = -w x I w."""

    def rate(t: float, w: Floats) -> Floats:
        return np.cross(MOMENTS * w, w) / MOMENTS

    solution = solve_ivp(rate, (0.0, times[-1]), SPIN, "DOP853", times, rtol=1e-12, atol=1e-14)
    return np.asarray(solution.y.T)


def pendulum() -> tuple[sim.System, float]:
    """Compound pendulum, and its rate sqrt(m g a/I) [rad/s]."""
    bob = cuboid("bob", (0.02, 0.02, 0.04), (-0.01, -0.01, -ARM - 0.02))
    hinge = Revolute("hinge", None, "bob", (0.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    system = sim.compile_scene(bodies_in_contact([bob], [], joints=(hinge,)))
    body = bob[0]
    about = body.inertia[1, 1] + body.mass * ARM**2
    return system, float(np.sqrt(body.mass * G * ARM / about))


def swinging() -> pd.DataFrame:
    """Errors of the pendulum: its period, and the drift of its hinge."""
    system, rate = pendulum()
    omega = 1e-4
    start = moving(system, -ARM * omega, 0.0, 0.0, 0.0, omega, 0.0)
    end = run(system, start, np.pi / rate, 100, sim.RungeKutta4())
    late = 2.0 * float(end.frames[0, 5]) / omega * rate / np.pi
    assert system.rows is not None
    rows = [("pendulum: period, relative", abs(late))]
    fast = moving(system, -ARM * 6.0, 0.0, 0.0, 0.0, 6.0, 0.0)
    for name, integrator, duration in (
        ("linearly implicit Euler", sim.LinearlyImplicitEuler(), 100.0),
        ("RK4", sim.RungeKutta4(), 5.0),
    ):
        end = run(system, fast, duration, int(200 * duration), integrator)
        drift = float(np.abs(system.rows.evaluate(end.pose).c).max())
        rows.append((f"pendulum, {duration:g} s, {name}: drift of the hinge [m, rad]", drift))
    return pd.DataFrame(rows, columns=["case", "error"])


def hanging() -> tuple[pd.DataFrame, Floats, list[Floats]]:
    """Error of the period of a stiff bar of tissue on a hinged body; its angle and shapes."""
    mesh = sim.grid_mesh(
        np.stack(
            np.meshgrid([0.0, 0.004], [0.0, 0.004], np.linspace(0, 0.06, 7), indexing="ij"), -1
        )
    )
    top, pivot = np.flatnonzero(mesh.X[:, 2] == 0.06), np.array([0.002, 0.002, 0.07])
    clamp = sim.Body("clamp", 0.002, np.diag([3.0, 5.0, 4.0]) * 1e-6, (0.002, 0.002, 0.062))
    system = sim.compile_scene(
        sim.Scene(
            mesh,
            (sim.Solid((sim.Material(sim.CoRotational(1e9, 0.3)),)), sim.Gravity((0.0, 0.0, -G))),
            (sim.OnBody("clamp", top),),
            bodies=(clamp,),
            joints=(Revolute("hinge", None, "clamp", pivot, (0.0, 1.0, 0.0)),),
        )
    )
    arm = system.mesh.X - pivot
    inertia = 5e-6 + float(system.node_mass @ (arm[:, 0] ** 2 + arm[:, 2] ** 2))
    rate = np.sqrt(-G * float(system.node_mass @ arm[:, 2]) / inertia)
    omega, free = 4.0, np.setdiff1d(np.arange(mesh.n_nodes), top)
    turning = np.cross([0.0, omega, 0.0], arm)
    w = np.concatenate([turning[free].ravel(), turning[-1], [0.0, omega, 0.0]])
    state = system.kinematics.state(system.rest_state().pose, w, {})
    angle, shapes, n = [0.0], [state.q], 40
    for _ in range(n):
        state = run(system, state, np.pi / rate / n, 4, sim.Trapezoidal(**TIGHT))
        angle.append(2.0 * float(np.arcsin(state.frames[0, 5])))
        shapes.append(state.q)
    times = np.linspace(0.0, np.pi / rate, n + 1)

    def swing(t: float, y: Floats) -> Floats:
        return np.array([y[1], -(rate**2) * np.sin(y[0])])

    exact = solve_ivp(swing, (0.0, times[-1]), [0.0, omega], "DOP853", times, rtol=1e-10).y[0]
    error = float(np.abs(angle - exact).max() / np.abs(exact).max())
    table = pd.DataFrame([("bar of tissue on a hinged body: angle, relative", error)],
                         columns=["case", "error"])  # fmt: skip
    return table, np.column_stack([times, angle, exact]), shapes[::10]


def orders() -> pd.DataFrame:
    """Measured order of each integrator, with a joint and with a contact that slides."""
    swings, _ = pendulum()
    fast = moving(swings, -ARM * 6.0, 0.0, 0.0, 0.0, 6.0, 0.0)
    slides, start = plate_on_tissue()
    rows = []
    for name, kind in {**IMPLICIT, **EXPLICIT}.items():
        integrator = type(kind)(**TIGHT) if isinstance(kind, Converged) else kind
        row: dict[str, object] = {"integrator": name, "declared": kind.order}
        # steps of fourth order that are as short as the others would leave rounding alone
        steps = (40, 80, 160) if kind.order > 2 else (160, 320, 640)
        cases = {"pendulum on a hinge": (swings, fast, 0.1, steps)}
        if name not in EXPLICIT and not isinstance(kind, sim.Trapezoidal):
            cases["plate that slides on tissue"] = (slides, start, 0.008, (16, 32, 64))
        for case, (system, begin, duration, steps) in cases.items():
            ends = [run(system, begin, duration, n, integrator) for n in steps]
            change = [np.linalg.norm(system.kinematics.between(b.pose, a.pose))
                      for a, b in zip(ends, ends[1:], strict=False)]  # fmt: skip
            row[case] = float(np.log2(change[0] / change[1]))
        rows.append(row)
    return pd.DataFrame(rows)


def costs(steps: Sequence[int] = (20, 40, 80)) -> pd.DataFrame:
    """Error of the pendulum's angle after 0.5 s, and processor time per simulated second."""
    system, rate = pendulum()
    start, until = moving(system, -ARM * 6.0, 0.0, 0.0, 0.0, 6.0, 0.0), 0.5

    def swing(t: float, y: Floats) -> Floats:
        return np.array([y[1], -(rate**2) * np.sin(y[0])])

    exact = solve_ivp(swing, (0.0, until), [0.0, 6.0], "DOP853", rtol=1e-12, atol=1e-12).y[0, -1]
    rows = []
    for name, integrator in {**IMPLICIT, "RK4": EXPLICIT["RK4"]}.items():
        if name == "Euler":
            continue
        end = run(system, start, 0.02, 2, integrator)  # prepares the kernels
        for n in steps:
            spent, count = 0.0, 0
            while spent < 0.05:
                before = time.process_time()
                end = run(system, start, until, n, integrator)
                spent, count = spent + time.process_time() - before, count + 1
            spent /= count * until
            angle = 2.0 * np.arctan2(end.frames[0, 5], end.frames[0, 3])
            error = abs((angle - exact + np.pi) % (2.0 * np.pi) - np.pi)
            rows.append({"integrator": name, "step [ms]": 1e3 * until / n, "error [rad]": error,
                         "processor time per second [s]": spent})  # fmt: skip
    return pd.DataFrame(rows)


@styled
def draw(times: Floats, omega: Floats, swing: Floats, shapes: list[Floats], work: pd.DataFrame):
    """Top, bar on a body, and error against run time."""
    figure = blank(10.5, 3.8)
    top, bar, cost = grid(figure, 1, 3)[0]
    exact, handles = euler(times), []
    for i, name in enumerate("123"):
        handles += top.plot(times, exact[:, i], color=COLOURS[i], label=f"axis {name}")
        top.plot(times, omega[:, i], "o", color=COLOURS[i], markersize=2.5)
    top.set(xlabel="time [s]", ylabel="angular velocity [rad/s]", title="Free top; lines: Euler")
    for k, q in enumerate(shapes):
        bar.plot(1e3 * q[:28:, 0], 1e3 * q[:28:, 2], ".", color=COLOURS[k % 7], markersize=4,
                 label=f"{swing[10 * k, 0]:.2f} s")  # fmt: skip
    bar.plot([2.0], [70.0], "k^", markersize=6)
    bar.set(xlabel="x [mm]", ylabel="z [mm]", title="Bar on a hinged body", aspect="equal")
    bar.legend(fontsize=6, loc="upper left")
    for k, (name, own) in enumerate(work.groupby("integrator", sort=False)):
        cost.plot(own["processor time per second [s]"], own["error [rad]"], marker="o",
                  markersize=3, color=COLOURS[k % 7], label=str(name))  # fmt: skip
    cost.set(xscale="log", yscale="log", xlabel="processor time per second [s]",
             ylabel="error of the angle [rad]", title="Pendulum, 0.5 s")  # fmt: skip
    cost.grid(color="0.9", linewidth=0.6)
    cost.legend(fontsize=6)
    legend(figure, handles)
    figure.suptitle("Rigid bodies (simulated)")
    return figure


def main(out: Path | None = None):
    """Measure, print and store."""
    top, times, omega = spinning(1000)
    bar, swing, shapes = hanging()
    finish("accuracy", pd.concat([top, swinging(), bar]), out)
    finish("orders", orders(), out)
    work = costs()
    finish("run_time", work, out)
    if out is not None:
        shrink(save(draw(times, omega, swing, shapes, work), out / "bodies.png"))
