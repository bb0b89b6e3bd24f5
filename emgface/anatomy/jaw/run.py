"""Motion of a jaw under excitations: simulation and its labelled result."""

from collections.abc import Callable, Mapping

import numpy as np
import xarray as xr

import sim
from emgface.anatomy.jaw.model import Floats
from emgface.anatomy.jaw.probes import Lines, Resistance
from emgface.anatomy.jaw.scene import JawScene, jaw_scene
from emgface.anatomy.jaw.series import Excitation, duration_of
from emgface.anatomy.jaw.tasks import JawTask, turned_head
from emgface.anatomy.step_error import Jumps, order_of_steps, with_step_error
from emgface.errors import JawError
from emgface.muscles import AXES
from emgface.schema.validation import validate
from sim.integrators import Integrator
from sim.probes import Probe
from sim.scene import Term

JAW_STEP, JAW_OUTPUT = 1e-3, 5e-3
"""Time step and time between outputs [s]."""
REST_SPEED = 1e-5
"""Speed of every point below which a jaw is at rest [m/s]."""
LONGER = 8
"""Largest ratio of the duration of a task that ends at rest to the stated one."""


def simulate_jaw(
    jaw: xr.Dataset,
    excitation: Excitation,
    *,
    duration: float,
    law: str = "peck",
    head: float = 0.0,
    load: tuple[float, float, float] = (0.0, 0.0, 0.0),
    morsel: str | None = None,
    resistance: float = 35.0,
    step: float = JAW_STEP,
    output: float = JAW_OUTPUT,
    integrator: Integrator | None = None,
    check: bool = True,
    tolerance: float | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> xr.Dataset:
    """Simulate a jaw.

    Parameters
    ----------
    jaw : xarray.Dataset
        A jaw_model.
    excitation : Excitation
    duration : float
        [s]
    law : str
        Muscle law, one of `emgface.anatomy.jaw.scene.LAWS`.
    head : float
        Backward rotation of the head [degrees].
    load : (3,) constant force on the lower incisor [N].
    morsel : str, optional
        Side of a morsel between the teeth, "L" or "R".
    resistance : float
        Largest elastic force of the morsel [N].
    step, output : float
        Time step and time between outputs [s].
    integrator : optional
        `sim.LinearlyImplicitEuler` by default.
    check : bool
        Whether the motion is repeated with half the step to estimate its error
        (`emgface.anatomy.step_error`), the variable ``numerical_error``.
    tolerance : float, optional
        Desired error [m]; steps are halved until the estimated error is at most this, or 2^-6 of
        `step`.
    progress : callable, optional
        As of `sim.simulate`, of the motion with the first step.

    Returns
    -------
    xarray.Dataset
        Of schema jaw_motion.

    Raises
    ------
    JawError
        An exciter or the law is unknown, or the step is too long: where active muscles make the jaw
        unstable, the matrix of a long step is indefinite, and the motion after it is wrong.
    SimulationError
        As `sim.simulate`.
    """
    activation, negative = excitation.activation(jaw)
    turn = (
        turned_head(head, jaw["point_position"].sel(point="head_centre").values) if head else None
    )

    eaten = list[sim.Crushable]()

    def further(points: Mapping[str, int]) -> tuple[Term, ...]:
        terms = list[Term]()
        if any(load):
            force = np.array(load, dtype=np.float64)[None]
            terms.append(sim.NodeLoad(np.array([points["lower_incisor"]]), force))
        if morsel is not None:
            bite = jaw.sel(joint=f"bite_{morsel}")
            place, normal = bite["joint_origin"].values, bite["joint_normal"].values
            point = points[f"bite_{morsel}"]
            eaten.append(sim.Crushable(point, place, normal, force_max=resistance))
        return (*terms, *eaten)

    parts = jaw_scene(jaw, law=law, head=turn, terms=further)
    system = sim.compile_scene(parts.scene)
    order = list(system.muscles)
    given = activation.reindex(muscle=order).fillna(0.0)  # springs and dampers are never active
    drive, effort = sim.Activation(excitation.time, given.values.T), (sim.Iterations(), Jumps())
    probes = (*_probes(parts), *(Resistance(term) for term in eaten), *effort)
    scheme = sim.LinearlyImplicitEuler() if integrator is None else integrator

    def run(h: float, whole: bool = True) -> xr.Dataset:
        motion, _ = sim.simulate(
            system,
            drive,
            duration=duration,
            steps=sim.FixedStep(h),
            every=output,
            integrator=scheme,
            probes=probes if whole else (_markers(parts), *effort),
            progress=progress if h == step else None,
        )
        _require_followed(motion, h)
        return motion

    if check or tolerance is not None:
        # longer steps may be too long for the muscles
        motion = with_step_error(run, step, output, order_of_steps(scheme), tolerance, shorter=True)
    else:
        motion = run(step)
    motion = motion.drop_vars([v.name for probe in effort for v in probe.variables()])
    excitations = drive.at_all(motion["time"].values)
    active = [order.index(str(m)) for m in jaw["muscle"].values]
    motion["activation"] = (("muscle", "time"), excitations.T[active], {"units": "1"})
    motion["muscle_force"] = (("muscle", "time"), _forces(parts, motion), {"units": "N"})
    motion = motion.drop_vars("muscle_rate")
    if morsel is not None:
        motion.attrs["morsel"] = morsel
    motion = motion.assign(drawn(jaw, parts.bodies))
    motion.attrs |= {
        "origin": "simulated",
        "jaw": jaw.attrs["name"],
        "law": law,
        "head_rotation_deg": float(head),
        "clipped_excitation": negative,
    }
    if excitation.recorded_start is not None:
        motion.attrs["recorded_start"] = excitation.recorded_start
    return validate(motion, "jaw_motion")


def run_task(jaw: xr.Dataset, task: JawTask, **options: object) -> xr.Dataset:
    """Simulate a task; options as of `simulate_jaw`, with ``excitation`` for a task with series.

    Exciters that the model lacks, such as those of muscles below a fixed hyoid, are left out; the
    attribute ``absent_exciters`` names them. The duration of a task that ends at rest is doubled until
    no point is faster than `REST_SPEED`, up to `LONGER` times, unless a duration is specified; its
    attribute ``end_speed`` is the largest speed at the end [m/s].
    """
    excitation = options.pop("excitation", None) or task.excitations()
    assert isinstance(excitation, Excitation)
    known, absent = excitation.known_to(jaw)
    given = {
        "excitation": known,
        "duration": task.duration,
        "head": task.head,
        "load": task.load,
        "morsel": task.morsel,
    } | options
    if task.settles and "duration" not in options:
        given["duration"] = _until_rest(jaw, given, task.duration)
    motion = simulate_jaw(jaw, **given)  # pyright: ignore[reportArgumentType]
    if task.settles:
        motion.attrs["end_speed"] = end_speed(motion)
    motion.attrs["absent_exciters"] = ", ".join(absent)
    return motion


def _until_rest(jaw: xr.Dataset, given: Mapping[str, object], duration: float) -> float:
    """Duration after which a jaw is at rest [s], or the longest one."""
    bare = {**given, "check": False, "tolerance": None, "progress": None}
    for longer in range(LONGER.bit_length() - 1):
        motion = simulate_jaw(jaw, **bare | {"duration": 2**longer * duration})  # pyright: ignore
        if end_speed(motion) < REST_SPEED:
            return 2**longer * duration
    return LONGER * duration


def end_speed(motion: xr.Dataset) -> float:
    """Largest mean speed of a point during the last output interval [m/s]."""
    x = motion["position"].isel(time=[-2, -1]).transpose("time", "marker", "axis").values
    took = float(np.diff(motion["time"].values[-2:])[0])
    return float(np.linalg.norm(x[1] - x[0], axis=1).max() / took)


def run_excitation(
    jaw: xr.Dataset, excitation: Excitation, *, duration: float | None = None, **options: object
) -> xr.Dataset:
    """Simulate a jaw until the last instant of excitations; options as of `simulate_jaw`."""
    given = options | {"duration": duration_of(excitation, JAW_OUTPUT, duration)}
    return simulate_jaw(jaw, excitation, **given)  # pyright: ignore[reportArgumentType]


def _probes(parts: JawScene) -> tuple[Probe, ...]:
    ends = np.array([line.ends for line in parts.muscles.values()])
    joints = tuple(joint.name for joint in parts.scene.joints)
    return (
        sim.Frames(parts.bodies),
        *((sim.Reactions(joints),) if joints else ()),
        _markers(parts),
        Lines(ends, tuple(parts.muscles)),
    )


def _markers(parts: JawScene) -> Probe:
    return sim.Markers(np.array(list(parts.points.values())), tuple(parts.points))


def _require_followed(motion: xr.Dataset, step: float) -> None:
    bad = np.flatnonzero(motion["indefinite"].values > 0.0)
    if len(bad):
        t = float(motion["time"][bad[0]])
        raise JawError(
            f"steps of {1e3 * step:g} ms are too long before {t:.4g} s, where the active muscles make "
            "the jaw unstable and the matrix of a step indefinite: choose shorter ones, such as "
            f"{250.0 * step:g} ms"
        )


def _forces(parts: JawScene, motion: xr.Dataset) -> Floats:
    """Tension of every muscle over time [N]."""
    rows = (motion[name].values for name in ("muscle_length", "muscle_rate", "activation"))
    return np.array(
        [line.tension(*own) for line, *own in zip(parts.muscles.values(), *rows, strict=True)]
    )


def drawn(jaw: xr.Dataset, bodies: tuple[str, ...]) -> dict[str, object]:
    """Surfaces and muscles of a model, with the bodies of a motion; -1 for bodies that stay."""
    number = {name: k for k, name in enumerate(bodies)}
    moving = np.array([number.get(str(name), -1) for name in jaw["body"].values], dtype=np.int32)
    one = {"units": "1"}
    variables: dict[str, object] = {
        "muscle_force_max": jaw["muscle_force_max"],
        "muscle_position": jaw["muscle_position"],
        "muscle_body": (("muscle", "end"), moving[jaw["muscle_body"].values], one),
    }
    if "surface_position" in jaw:
        variables |= {name: jaw[name] for name in ("surface_position", "surface_triangle")}
        variables["surface_body"] = ("vertex", moving[jaw["surface_body"].values], one)
    return variables


__all__ = [
    "AXES",
    "JAW_OUTPUT",
    "JAW_STEP",
    "REST_SPEED",
    "drawn",
    "end_speed",
    "run_excitation",
    "run_task",
    "simulate_jaw",
]
