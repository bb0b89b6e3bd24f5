"""Checks of the fit of a face to a person: a table of six, damaged inputs, a published face, worth.

    python -m benchmarks fit --only checks
    python -m benchmarks fit --only damaged --inputs 300
    python -m benchmarks fit --only sound --persons 40
    python -m benchmarks fit --only shares --persons 40
    python -m benchmarks fit --only published
    python -m benchmarks fit --only gap
    python -m benchmarks fit --only worth --persons 20 --workers 2

Simulated persons; the published faces are read from the folder EMGFACE_SHARED.
"""

import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import pandas as pd
import typer
import xarray as xr

import sim
from benchmarks import fit_checks
from benchmarks.fit_ends import BAD, NEAR, end_of
from benchmarks.fit_gap import fitted_published, gap
from benchmarks.fit_inputs import DAMAGES, damaged, person_of
from benchmarks.fit_persons import between_persons, thickness_coverage
from benchmarks.fit_shares import shares
from benchmarks.fit_worth import CONDITIONS, worth
from benchmarks.report import finish, say
from emgface.api.given import simulation_of, study_of
from emgface.errors import EmgfaceError
from emgface.face.recipe import compose_scene
from emgface.face.template import template_face
from emgface.fit.carry import carry
from emgface.fit.deform import LANDMARK_NOISE

LEVELS = {"OOP_L": 0.5, "OOP_R": 0.5}


def damaged_inputs(inputs: int, first: int = 0) -> int:
    """Print how fits of damaged inputs end, by kind; return the number of silent or wrong ends."""
    generic, person = template_face(resolution="coarse"), person_of(5)
    ends: dict[str, Counter[str]] = {d.__name__: Counter() for d in DAMAGES}
    bad = 0
    for number in range(first, first + inputs):
        name, marks, points, triangles = damaged(person, number)
        start = time.process_time()
        end = end_of(generic, person, marks, (points, triangles))
        bad += end.startswith(BAD)
        ends[name][end.partition(":")[0]] += 1
        say(f"{number} {name}: {end}, {time.process_time() - start:.1f} s")
    for name, counted in ends.items():
        say(f"  {name:20s} " + ", ".join(f"{n} {end}" for end, n in sorted(counted.items())))
    say(f"{inputs} damaged inputs, {bad} without a located error, a doubt or a near face [0]")
    return bad


def sound_inputs(persons: int) -> int:
    """Print how fits of undamaged inputs end; return how many are refused, doubted or far."""
    generic, bad = template_face(resolution="coarse"), 0
    for k in range(persons):
        person, rng = person_of(300 + k), np.random.default_rng(k)
        marks = {
            n: p + LANDMARK_NOISE * rng.standard_normal(3) for n, p in person.landmarks.items()
        }
        skin = person.surface()
        end = end_of(generic, person, marks, (skin.points, skin.triangles))
        bad += not end.startswith(f"{NEAR}:")
        say(f"person {k + 1}: {end}")
    say(f"{persons} sound inputs, {bad} refused, doubted or with a face far from the person [0]")
    return bad


def moved(face: xr.Dataset, steps: int = 4) -> np.ndarray:
    """Displacements (n_nodes, 3) [m] in equilibrium under `LEVELS`, without contact and gravity."""
    given = {"sigma_max": 300e3, "gravity": False, "contact": {"method": "none"}}
    p = simulation_of(study_of(None).simulation, "draft", given)
    system = sim.compile_scene(replace(compose_scene(face, p), damping=None))
    full = np.array([LEVELS.get(str(m), 0.0) for m in face["muscle"].values])
    state, work = system.rest_state(), sim.Workspace(system)
    for k in range(1, steps + 1):
        state, _ = sim.Static().step(system, state, system.control(k / steps * full), 1.0, work)
    return state.q - face["position"].values


def published(further: int = 0) -> float:
    """Fit the reference to the other published face; rms difference of its markers under OOP [mm].

    Both carry the muscles of the reference, so that the difference is that of the geometry alone.
    `further` nodes of the rings of the lips are landmarks in addition to the 30.
    """
    fit, truth = fitted_published(further)
    nodes = fit.face["marker_node"].values
    one, two = (moved(f)[nodes] for f in (fit.face, carry(fit.source, truth).face))
    apart = 1e3 * float(np.sqrt((np.linalg.norm(one - two, axis=1) ** 2).mean()))
    size = 1e3 * np.linalg.norm(two, axis=1)
    q = fit.face["position"].values
    print(
        f"{30 + further} landmarks: markers under OOP 0.5 at 300 kPa differ by {apart:.2f} mm rms "
        f"[0.3], of {size.min():.1f} to {size.max():.1f} mm; nodes by "
        f"{1e3 * np.median(np.linalg.norm(q - truth, axis=1)):.2f} mm (median)",
        flush=True,
    )
    return apart


def six_checks(which: Iterable[int], persons: int, inputs: int, out: Path | None) -> None:
    """Print rows and time of every check when it ends, then the table; store it as ``checks.csv``.

    A check that fails, such as one without the published faces, is a row that is not met.
    """
    run: dict[int, Callable[[], list[fit_checks.Row]]] = {
        1: fit_checks.closed_forms,
        2: fit_checks.between_published,
        3: lambda: between_persons(moved, persons),
        4: fit_checks.stacks_and_labels,
        5: fit_checks.probe_curves,
        6: lambda: fit_checks.damaged(damaged_inputs, inputs),
    }
    rows: list[fit_checks.Row] = []
    for number in which:
        start = time.process_time()
        try:
            check_rows = run[number]()
        except (EmgfaceError, KeyError, OSError, ImportError) as error:
            check_rows = [fit_checks.Row(number, f"not measured: {error!r}", float("nan"), 0.0)]
        for row in check_rows:
            say(" | ".join(str(cell) for cell in row.cells().values()))
        say(f"check {number}: {time.process_time() - start:.0f} s of processor time")
        rows += check_rows
    finish("checks", pd.DataFrame([row.cells() for row in rows]), out)


def main(
    only: Annotated[
        list[str] | None,
        typer.Option(help="checks, damaged, sound, shares, published, gap, thickness or worth."),
    ] = None,
    check: Annotated[
        list[int] | None, typer.Option(help="Number of a check, by default all.")
    ] = None,
    inputs: Annotated[int, typer.Option(help="Number of damaged inputs.")] = 36,
    first: Annotated[int, typer.Option(help="Number of the first of them.")] = 0,
    persons: Annotated[int, typer.Option(help="Number of simulated persons.")] = 20,
    instructions: Annotated[str, typer.Option(help="Their instructions, such as BD.")] = "BD",
    condition: Annotated[
        list[str] | None, typer.Option(help=f"Worth in one of: {'; '.join(CONDITIONS)}.")
    ] = None,
    workers: Annotated[int, typer.Option(help="Number of processes.")] = 1,
    out: Annotated[Path, typer.Option(help="Folder of table and figure.")] = Path("docs/fit"),
    work: Annotated[
        Path | None, typer.Option(help="Folder that keeps motions, to resume a run.")
    ] = None,
) -> None:
    if only and "checks" in only:
        six_checks(check or range(1, 7), persons, inputs, out if check is None else None)
    if only and "worth" in only:
        with tempfile.TemporaryDirectory() as temporary:
            folder = work or Path(temporary)
            worth(persons, tuple(instructions), out, folder, workers, condition or ())
    if only and "thickness" in only:
        say(str(thickness_coverage(persons).cells()))
    if not only or "damaged" in only:
        damaged_inputs(inputs, first)
    if only and "sound" in only:
        sound_inputs(persons)
    if only and "shares" in only:
        shares(persons)
    if not only or "published" in only:
        for further in (0, 12, 40):
            try:
                published(further)
            except EmgfaceError as error:  # landmarks far from a similarity are refused
                print(f"{30 + further} landmarks: {error}", flush=True)
    if not only or "gap" in only:
        gap(moved)
