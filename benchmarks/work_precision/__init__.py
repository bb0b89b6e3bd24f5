"""Error and run time of integrators, steps, tolerances, linear solvers, meshes and volume treatments.

Models are pointwise, element, nodal or hard; "refined:" before them denotes the mesh with every
element divided into eight. All settings are measured for the first model, and with --full for all
of them. Instructions are A to F. --processor measures processor time.
"""

from pathlib import Path

from benchmarks.report import face_of, finish, say
from benchmarks.work_precision.measure import measure, worst
from benchmarks.work_precision.models import MODELS, Model
from emgface.face.contact_parameters import NO_CONTACT
from emgface.face.simulation_parameters import SimulationParameters


def main(
    out: Path = Path("bench"),
    face: Path | None = None,
    instruction: list[str] = ["A", "D", "E"],  # noqa: B006
    model: list[str] = [m.name for m in MODELS],  # noqa: B006
    processor: bool = False,
    full: bool = False,
) -> None:
    """Measure, print and store errors of time stepping, error control and discretisation."""
    measured = measure(
        face_of(face),
        SimulationParameters(sigma_max=100e3, contact=NO_CONTACT),
        instructions=instruction,
        models=[Model.named(name) for name in model],
        full=full,
        processor=processor,
        repeats=2,
    )
    say(f"U = {1e3 * measured.unit:.1f} ms (one factorisation and one solution)")
    finish("work-precision", worst(measured.stepping), out)
    say(f"models against {measured.finest}")
    finish("discretisation", measured.models, out)
    controlled = measured.stepping.dropna(subset="requested mm")
    if len(controlled):
        finish("error-control", controlled, out)
