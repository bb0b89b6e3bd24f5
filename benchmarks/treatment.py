"""Acceptance checks of virtual treatment: volumes, closure, symmetry, trends, random plans.

    python -m benchmarks treatment
    python -m benchmarks treatment --only slit --only volume
    python -m benchmarks treatment --only random --plans 200
    python -m benchmarks treatment --only trends --face reference.nc --no-contact
    python -m benchmarks treatment --specification --kept checks.json

`--specification` runs checks 1 to 8 of the specification and prints them as one table. With `--kept`,
the rows of complete checks are kept in a file, and a repeated command computes only the others, as long
as the code has not changed. Every check prints what it measured and what is required. The faces are
generated, coarse unless stated. Simulated data; a research model, not validated on patients.
"""

import inspect
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np
import typer
import xarray as xr
from numpy.typing import NDArray
from scipy.spatial import KDTree

import emgface as ef
import sim
from benchmarks.random_plans import random
from benchmarks.report import Row
from benchmarks.resected_jaws import jaw
from benchmarks.slit import slit
from emgface.api.given import simulation_of, study_of
from emgface.errors import EmgfaceError
from emgface.face.contact import contact_pairings
from emgface.face.file import load_face
from emgface.face.lip_shape import lip_rim
from emgface.face.motion import settle_face, simulate_face
from emgface.face.template import template_face
from emgface.files import write_text
from emgface.run.digest import code_version
from emgface.treatment.motions import compared_motions, gestures
from emgface.treatment.outcomes import OUTCOMES, outcome_table, smile_asymmetry
from emgface.treatment.pressure import PressureHeld, pressure_held
from emgface.treatment.sampled_volume import sampled_volume

Floats = NDArray[np.float64]

MIRROR = np.array([-1.0, 1.0, 1.0])


def wedge(**given: Any) -> dict[str, Any]:
    """Plan of one wedge of the lower lip."""
    step = {"kind": "wedge", "shape": "V", "width": 12.0, "height": 11.0} | given
    return {"step": [step]}


def parameters(**given: Any) -> Any:
    """Parameters of draft accuracy."""
    return simulation_of(study_of(None).simulation, "draft", given)


def motion(face: xr.Dataset, name: str, **given: Any) -> xr.Dataset:
    """Motion of a face under the gesture of a name."""
    p = parameters(**given)
    return simulate_face(face, gestures(face)[name], p, settled=settle_face(face, p))


def volume() -> list[Row]:
    """Removed volume against that sampled in the untreated elements, and mass."""
    rows: list[Row] = []
    for resolution in ("coarse", "medium"):
        face = template_face(resolution=resolution)
        for shape in ("V", "W", "shield", "rectangle"):
            for method in ("conforming", "elements"):
                plan = wedge(shape=shape, width=14.0, place=0.46, method=method, scar=False)
                try:
                    treated = ef.treat(face, plan)
                except EmgfaceError as error:
                    label = f"{resolution}, {shape}, {method}"
                    rows.append((label, str(error), "reported", method == "elements"))
                    continue
                report = _report(treated)
                expected = 1e9 * sampled_volume(face, plan["step"][0])
                error = report["removed_volume_mm3"] / expected - 1.0
                met = abs(error) < 0.02 or method == "elements"
                rows.append(
                    (
                        f"{resolution}, {shape}, {method}: "
                        f"removed {report['removed_volume_mm3']:.0f} mm3",
                        f"{100 * error:+.2f} % of {expected:.0f} mm3",
                        "2 %" if method == "conforming" else "reported",
                        met,
                    )
                )
                masses = [_mass(face), _mass(treated)]
                lost = (masses[0] - masses[1]) / (1040e-9 * report["removed_volume_mm3"]) - 1.0
                rows.append(("   mass that is lost, relative to it", f"{100 * lost:+.3f} %", "2 %",
                             abs(lost) < 0.02))  # fmt: skip
                rows.append(_rebuilt(treated))
    return rows


def _rebuilt(face: xr.Dataset) -> Row:
    """Orphan nodes, and the surfaces in contact, which are closed or refused with their reason."""
    orphans = face.sizes["node"] - len(
        np.unique(face["connectivity"].values[face["connectivity"] >= 0])
    )
    try:
        pairs, closed = f"{len(contact_pairings(face))} pairings", True
    except EmgfaceError as error:
        pairs, closed = str(error), False
    return ("   nodes without element; contact", f"{orphans}; {pairs}", "0; pairings rebuilt",
            orphans == 0 and closed)  # fmt: skip


def _mass(face: xr.Dataset) -> float:
    from emgface.face.recipe import compose_scene

    scene = compose_scene(face, parameters(contact={"method": "none"}))
    return sum(
        float(t.node_mass(scene.mesh).sum()) for t in scene.terms if isinstance(t, sim.Solid)
    )


def _report(face: xr.Dataset) -> dict[str, Any]:
    return json.loads(face.attrs["treatment"])[-1]["steps"][-1]


def zero() -> list[Row]:
    """A wedge of no size, and a cut without removal."""
    face = template_face(resolution="coarse")
    before = motion(face, "A")
    rows: list[Row] = []
    for what, plan in (("width 0", wedge(width=0.0)), ("height 0", wedge(height=0.0))):
        after = motion(ef.treat(face, plan), "A")
        same = bool((before["position"].values == after["position"].values).all())
        rows.append((f"wedge of {what}: same bits of the motion", str(same), "True", same))
    for place, method in ((0.42, "elements"), (0.5, "conforming"), (0.42, "conforming")):
        step = {"kind": "incision", "place": place, "scar": False, "method": method}
        treated = ef.treat(face, {"step": [step]})
        for name in ("A", "D"):
            first = before if name == "A" else motion(face, name)
            moved = motion(treated, name)["position"].values - first["position"].values
            apart = 1e3 * float(np.linalg.norm(moved, axis=1).max())
            rows.append(
                (f"incision at {place:g} ({method}), {name}: difference of a marker",
                 f"{apart:.4f} mm", "0.05 mm", apart < 0.05)
            )  # fmt: skip
    return rows


def mirror() -> list[Row]:
    """Mirrored plans give mirrored faces and motions."""
    face = template_face(resolution="coarse")
    rows: list[Row] = []
    names = [str(m) for m in face["marker"].values]
    other = [
        names.index(n.replace("left", "RIGHT").replace("right", "left").replace("RIGHT", "right"))
        for n in names
    ]
    for place, gesture in ((0.5, "A"), (0.36, "D")):
        one = ef.treat(face, wedge(place=place))
        two = ef.treat(face, wedge(place=1.0 - place))
        away = KDTree(one["position"].values * MIRROR).query(two["position"].values)[0].max()
        rows.append((f"wedge at {place:g} and its mirror image: nodes", f"{1e3 * away:.2g} mm",
                     "1e-6 m", away < 1e-6))  # fmt: skip
        moved = [
            motion(f, gesture)["position"].transpose("time", "marker", "axis").values
            for f in (one, two)
        ]
        apart = float(np.abs(moved[0][:, other] * MIRROR - moved[1]).max())
        rows.append((f"   motion of {gesture}", f"{1e3 * apart:.2g} mm", "1e-6 m", apart < 1e-6))
    return rows


WIDTHS: Final = (0.0, 8.0, 12.0, 16.0)  #: of the wedges of the trends [mm]
TRENDS: Final = (
    "mouth width", "length of the lower lip margin", "lower vermilion height",
    "pursing, amplitude", "pursing, narrowing", "lip opening", "pursing, protrusion",
)  # fmt: skip
FREE: Final = ("pursing, protrusion",)
"""Outcomes without a required trend: pursed lips of a shorter ring lie further forward."""


def against_width(face: xr.Dataset, *, contact: bool) -> dict[str, Floats]:
    """Outcomes `TRENDS` of a face after wedges of `WIDTHS`, in their units."""
    p = parameters(sigma_max=100e3, **({} if contact else {"contact": {"method": "none"}}))
    drives = gestures(face, ("A", "opening"))
    outcomes: list[dict[str, float]] = []
    for width in WIDTHS:
        treated = ef.treat(face, wedge(width=width, height=12.0))
        table = outcome_table(face, treated, compared_motions(face, treated, drives, p, source=""))
        outcomes.append(dict(zip(table["outcome"], table["after"], strict=True)))
    return {name: np.array([one[name] for one in outcomes]) for name in TRENDS}


def falls(values: Floats, error: float) -> bool:
    """True if values fall in total by more than their error, and none rises by more than it."""
    rises = max(float((values[k:] - v).max()) for k, v in enumerate(values))
    return float(values[-1] - values[0]) < -error and rises <= error


def trends(given: Path | None = None, contact: bool = True) -> list[Row]:
    """Outcomes against the width of the wedge, and closure of 30 and 50 % at 300 kPa.

    A trend is judged against the error by the mesh: the largest difference of a change between two
    widths, between faces of 2448 and 4752 elements, without contact.
    """
    face = template_face(resolution="medium") if given is None else load_face(given)
    values = against_width(face, contact=contact)
    medium, fine = (against_width(template_face(resolution=n), contact=False) for n in (2448, 4752))
    rows: list[Row] = []
    for name in TRENDS:
        away = fine[name] - medium[name]
        error = float(np.ptp(away))
        for what, shown in (("", values), ("   the finer face, without contact", fine)):
            text = ", ".join(f"{v:.2f}" for v in shown[name])
            rows.append((what or f"{name} at 0, 8, 12, 16 mm", f"{text} (error {error:.2f})",
                         "reported" if name in FREE else "falls",
                         name in FREE or falls(shown[name], error)))  # fmt: skip
    for share in (0.3, 0.5):
        rim = face["position"].values[lip_rim(face).lower]
        width = 1e3 * share * float(np.linalg.norm(np.diff(rim, axis=0), axis=1).sum())
        text, met = _closes(face, wedge(width=width, height=14.0))
        rows.append((f"{100 * share:.0f} % of the lower lip, 300 kPa", text, "closes" if share < 0.4
                     else "closes, or a sentence", met or share > 0.4))  # fmt: skip
    return rows


def _closes(face: xr.Dataset, plan: dict[str, Any]) -> tuple[str, bool]:
    try:
        treated = ef.treat(face, plan, sigma_max=300e3)
    except EmgfaceError as error:
        return str(error)[:160], False
    return f"closes, smallest J {_report(treated)['smallest_J']:.2f}", True


def joining() -> list[Row]:
    """Closing with joined and not joined fibres, and a sweep of the stiffness of the scar."""
    face, p = template_face(resolution="coarse"), parameters(sigma_max=100e3)
    rows: list[Row] = []
    gaps, pressures = list[float](), list[PressureHeld]()
    for choice in ("all", "none"):
        treated = ef.treat(face, wedge(rejoin=choice))
        settled = settle_face(treated, p)
        closed = simulate_face(treated, gestures(treated)["closing"], p, settled=settled)
        gaps.append(1e6 * float(closed["mouth_area"].min()))
        pressures.append(pressure_held(treated, p, settled=settled))
    rows.append(("residual gap, joined and not joined", f"{gaps[0]:.2f}, {gaps[1]:.2f} mm2",
                 "larger if not joined", gaps[1] > gaps[0]))  # fmt: skip
    force, pressure = [one.force for one in pressures], [one.pressure for one in pressures]
    text = ", ".join("at least " * one.at_least + f"{one.pressure:.0f}" for one in pressures)
    rows.append(("   force of the closed lips on each other", f"{force[0]:.2f}, {force[1]:.2f} N",
                 "smaller if not joined", force[1] < force[0]))  # fmt: skip
    rows.append(("   pressure held", f"{text} Pa", "smaller if not joined",
                 pressure[1] < pressure[0] and not pressures[1].at_least))  # fmt: skip
    narrowing = next(o for o in OUTCOMES if o.name == "pursing, narrowing")
    sweep = list[float]()
    for stiffness in (1.0, 3.0, 10.0):
        treated = ef.treat(face, wedge(scar={"stiffness": stiffness}))
        pursed = motion(treated, "A", sigma_max=100e3)
        sweep.append(1e3 * narrowing.value(treated, pursed))
    steps = np.diff(sweep)
    rows.append(("pursing, narrowing, for scar 1, 3, 10", ", ".join(f"{v:.3f}" for v in sweep),
                 "monotone", bool((steps > 0).all() or (steps < 0).all())))  # fmt: skip
    return rows


def palsy() -> list[Row]:
    """Asymmetry of the smile against the degree of a weakness of one side."""
    face = template_face(resolution="coarse")
    asymmetry: dict[str, list[float]] = {}
    for side in ("left", "right"):
        asymmetry[side] = []
        for degree in (0.0, 0.25, 0.5, 0.75, 1.0):
            treated = ef.treat(face, {"step": [{"kind": "palsy", "side": side, "degree": degree}]})
            asymmetry[side].append(smile_asymmetry(treated, motion(treated, "D", sigma_max=100e3)))
    left, right = (np.array(asymmetry[s]) for s in ("left", "right"))
    return [
        ("asymmetry of the smile, left 0 to 1", ", ".join(f"{v:.3f}" for v in left), "rises",
         bool((np.diff(left) > 0).all())),
        ("   right side, mirrored", f"{np.abs(left + right).max():.2g}", "1e-6",
         float(np.abs(left + right).max()) < 1e-6),
    ]  # fmt: skip


def compensation() -> list[Row]:
    """Activations of the operated face for the intact motion."""
    from emgface.face.template.gestures import gesture_activation
    from emgface.treatment.compensation import compensated

    face = template_face(resolution="coarse")
    treated = ef.treat(face, wedge(place=0.4))
    rows: list[Row] = []
    for name in ("A", "D"):
        result = compensated(face, treated, gesture_activation(name), parameters(sigma_max=100e3))
        a = result["activation"].values
        last = result.isel(time=-1)
        before, left = (1e3 * float(last[k]) for k in ("uncompensated", "residual"))
        rows.append((f"{name}: rms distance of a marker, same and found activations",
                     f"{before:.3f}, {left:.3f} mm of {1e3 * float(last['motion']):.2f}",
                     "less", left < before))  # fmt: skip
        rows.append(("   activations", f"{a.min():.3f} to {a.max():.3f}", "0 to 1",
                     bool(a.min() >= 0.0 and a.max() <= 1.0)))  # fmt: skip
    return rows


def convergence() -> list[Row]:
    """Changes by a wedge against the resolution of the face, for both methods of cutting.

    Movements without contact, whose cost allows four resolutions. The interval of the finest face
    contains its two methods; a change that does not exceed it is not a result.
    """
    rows: list[Row] = []
    changes: dict[str, dict[str, float]] = {}
    p = parameters(sigma_max=100e3, contact={"method": "none"})
    resolutions = (576, 1200, 2448, 4752)
    for resolution in resolutions:
        face = template_face(resolution=resolution)
        drives = gestures(face, ("A", "D", "opening"))
        for method in ("conforming", "elements"):
            try:
                treated = ef.treat(face, wedge(width=14.0, height=12.0, method=method))
            except EmgfaceError as error:
                rows.append((f"{resolution} elements, {method}", str(error)[:90], "reported", True))
                continue
            table = outcome_table(
                face, treated, compared_motions(face, treated, drives, p, source="")
            )
            changes[f"{resolution} {method}"] = dict(
                zip(table["outcome"], table["change"], strict=True)
            )
    rows.append(("changes by a V of 14 mm", ", ".join(changes), "reported", True))
    for name in next(iter(changes.values())):
        values = [one[name] for one in changes.values()]
        if not np.isfinite(values).any():
            continue
        own = [changes[k][name] for k in changes if k.startswith(str(resolutions[-1]))]
        rows.append((name, ", ".join(f"{v:+.2f}" for v in values)
                     + f"; finest {min(own):+.2f} to {max(own):+.2f}", "reported", True))  # fmt: skip
    return rows


CHECKS: dict[str, Callable[..., list[Row]]] = {
    "volume": volume,
    "zero": zero,
    "slit": slit,
    "mirror": mirror,
    "trends": trends,
    "joining": joining,
    "palsy": palsy,
    "jaw": jaw,
    "compensation": compensation,
    "convergence": convergence,
    "random": random,
}


SPECIFIED: Final = {
    1: ("volume", "removed volume and mass; mesh, surfaces and contact rebuilt"),
    2: ("zero", "a wedge of no size, and a cut without removal"),
    3: ("slit", "closure of a slit in a stretched sheet"),
    4: ("mirror", "mirrored plans, mirrored motions"),
    5: ("trends", "trends with the width; 30 and 50 % of the lower lip"),
    6: ("joining", "joined and not joined fibres; stiffness of the scar"),
    7: ("jaw", "resected jaws"),
    8: ("compensation", "activations for the intact motion"),
}
"""Check and words of each number of the acceptance checks of the specification."""


CODE: Final = ("sim", "emgface.face", "emgface.treatment", "emgface.anatomy", "benchmarks")
"""Packages that determine the rows of the checks."""


def kept_rows(path: Path, code: str) -> dict[str, list[Row]]:
    """Rows of complete checks in a file, by check; none if they are those of other code."""
    stored: dict[str, Any] = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    rows = stored.get("rows", {}) if stored.get("code") == code else {}
    return {name: [(a, b, c, bool(met)) for a, b, c, met in every] for name, every in rows.items()}


def specification_table(rows: dict[str, list[Row]]) -> str:
    """Table in Markdown of the checks 1 to 8: criterion, measured, required and met."""
    lines = ["| check | criterion | measured | required | met |", "|---|---|---|---|---|"]
    for number, (name, words) in SPECIFIED.items():
        if name not in rows:
            lines.append(f"| {number} | {words} | not computed | | no |")
        for what, measured, required, met in rows.get(name, []):
            verdict = "reported" if required == "reported" else ("yes" if met else "**no**")
            lines.append(f"| {number} | {what.strip()} | {measured} | {required} | {verdict} |")
    return "\n".join(lines)


def main(
    only: Annotated[list[str] | None, typer.Option(help="Check to run; repeatable.")] = None,
    plans: Annotated[int, typer.Option(help="Number of random plans.")] = 20,
    seed: Annotated[int, typer.Option(help="Seed of the random plans.")] = 0,
    specification: Annotated[
        bool, typer.Option("--specification", help="Checks 1 to 8 of the specification as a table.")
    ] = False,
    kept: Annotated[
        Path | None, typer.Option(help="File with the rows of complete checks (json).")
    ] = None,
    face: Annotated[
        Path | None, typer.Option(help="Face of the trends (netCDF); default: a generated one.")
    ] = None,
    contact: Annotated[
        bool, typer.Option("--contact/--no-contact", help="Trends with contact.")
    ] = True,
) -> None:
    given = {"plans": plans, "seed": seed, "given": face, "contact": contact}
    listed = only or ([name for name, _ in SPECIFIED.values()] if specification else [*CHECKS])
    code = f"{code_version(CODE)} {given}"  # rows of other options are other rows
    done = {} if kept is None else kept_rows(kept, code)
    for name in listed:
        check = CHECKS[name]
        if name in done:
            rows = done[name]
        else:
            own = {k: v for k, v in given.items() if k in inspect.signature(check).parameters}
            start = time.process_time()
            rows = check(**own)
            rows.append(
                ("   processor time", f"{time.process_time() - start:.0f} s", "reported", True)
            )
            done[name] = [(a, b, c, bool(met)) for a, b, c, met in rows]
            if kept is not None:
                write_text(kept, json.dumps({"code": code, "rows": done}, indent=1))
        print(f"\n{name}: {(check.__doc__ or '').splitlines()[0]}")
        for what, measured, required, met in rows:
            print(f"  {what:62s} {measured}   [{required}] {'' if met else 'MISSED'}", flush=True)
    if specification:
        print("\n" + specification_table(done))
    missed = sum(not met for name in listed for *_, met in done[name])
    print(f"\n{missed} requirements missed; simulated, research model, not validated on patients.")
