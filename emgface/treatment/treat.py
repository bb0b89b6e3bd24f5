"""Treatment of a face: the steps of a plan in their order, each on the result of the last."""

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.spatial import KDTree

from emgface.errors import FaceError, JawError, TreatmentError
from emgface.face.contact_parameters import NO_CONTACT, ContactParameters
from emgface.face.identity import TREATED, treatments, with_treatment
from emgface.face.lip_shape import lip_opening
from emgface.face.quality import element_centres, element_quality
from emgface.face.recipe import compose_scene, element_order
from emgface.face.simulation_parameters import SimulationParameters
from emgface.face.surface import element_faces, face_areas
from emgface.face.template.measures import MM
from emgface.face.validity import check_face
from emgface.treatment.changes import apply_change, apply_palsy, with_factor, with_share
from emgface.treatment.closure import Closed, Progress, drawn_together, relaxed, ties
from emgface.treatment.earlier import SUTURED, earlier_cuts, plan_again
from emgface.treatment.excise import Wound, excise
from emgface.treatment.lengths import Lengths
from emgface.treatment.outline import Outline, outline_of, wedge_around
from emgface.treatment.plan import (
    CUTS,
    NOT_VALIDATED,
    WEDGE_NUMBERS,
    Change,
    Incision,
    Palsy,
    Plan,
    Resection,
    Step,
    Tumour,
    Wedge,
)
from emgface.treatment.rebuild import rebuilt
from emgface.treatment.resection import resect
from sim.elements import HEX8, WEDGE6

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Report = dict[str, Any]


def treat_face(
    face: xr.Dataset,
    plan: Plan,
    parameters: SimulationParameters | None = None,
    *,
    folder: Path = Path(),
    progress: Progress | None = None,
) -> xr.Dataset:
    """Apply the steps of a plan to a face, and return the treated face.

    The result is a face_model, with the plan and the report of every step in the attribute
    ``treatment`` (JSON) and the digest of the untreated face in ``parent``; a plan without effect
    returns the face itself. The report of a tumour contains the wedge around it (`applied_plan`).
    `parameters` are those of the tissue that is closed (default: those of a simulation); later runs with
    other parameters find their own equilibrium. `folder` contains the surfaces of tumours.

    Raises TreatmentError, naming the step and the reason, if a step is not possible, and FaceError if
    the face lacks what any treatment requires, such as a mouth.
    """
    parameters = parameters or SimulationParameters()
    if message := plan_again(face, plan):
        raise TreatmentError("repeated", message)
    treated, reports = face, list[Report]()
    for number, step in enumerate(plan.step, 1):
        own, report = step, Report()
        try:
            if isinstance(step, Tumour):
                own = wedge_around(treated, step, folder)
                report = {name: getattr(own, name) for name in WEDGE_NUMBERS}
            result, done = _APPLY[type(own)](treated, own, parameters, progress)
            treated = result if result is treated else _valid(result, own)
            report |= done
            if isinstance(step, Lengths) and (doubts := step.doubts()):
                report["doubts"] = list(doubts)
        except FaceError as error:
            message = f"step {number} ({step.kind}) of {plan.name!r}: {error}"
            message += earlier_cuts(treated, own, [*treatments(face), _entry(plan, reports)])
            if isinstance(error, TreatmentError):
                raise TreatmentError(error.reason, message) from error
            raise FaceError(message) from error  # the face lacks what any treatment requires
        reports.append({"step": number, "kind": step.kind, **report})
    if treated is face:
        return face
    name = f"{face.attrs['name']}, {TREATED}: {plan.name}"
    return with_treatment(face, treated.assign_attrs(name=name), _entry(plan, reports))


def _valid(face: xr.Dataset, step: Step) -> xr.Dataset:
    """Return a face after a step; TreatmentError if it is no valid face."""
    try:
        return check_face(face)
    except FaceError as error:
        if isinstance(step, CUTS) and "inverted at rest" in str(error):
            raise TreatmentError(
                "folds",
                "the closure folds elements at the suture, expected none to be inverted: choose a "
                f"smaller width, another shape, or a finer face ({error})",
            ) from error
        raise TreatmentError(
            "invalid", f"the face after the step is not valid ({error}): change its place or size"
        ) from error


def _entry(plan: Plan, reports: list[Report]) -> Report:
    return {"plan": plan.model_dump(mode="json"), "steps": reports, "note": NOT_VALIDATED}


def treat_jaw(jaw: xr.Dataset, plan: Plan) -> xr.Dataset:
    """Apply a plan of resections to a jaw model; JawError if a step is of another kind."""
    if message := plan_again(jaw, plan):
        raise JawError(message)
    treated, reports = jaw, list[Report]()
    for number, step in enumerate(plan.step, 1):
        if not isinstance(step, Resection):
            raise JawError(
                f"step {number} ({step.kind}) of {plan.name!r} applies to a face, and the model is a "
                "jaw: expected steps of the kind 'resection'"
            )
        treated, report = resect(treated, step)
        reports.append({"step": number, "kind": step.kind, **report})
    if treated is jaw:
        return jaw
    return with_treatment(jaw, treated, _entry(plan, reports))


def _cut(
    face: xr.Dataset,
    step: Wedge | Incision,
    parameters: SimulationParameters,
    progress: Progress | None,
) -> tuple[xr.Dataset, Report]:
    """Excise, close and scar; a step of no size changes nothing."""
    if (isinstance(step, Wedge) and 0.0 in (step.width, step.height)) or (
        isinstance(step, Incision) and step.height == 0.0
    ):
        return face, {"effect": "none: the size is 0"}
    outline = outline_of(face, step)
    try:
        closed, report = _unfolded(face, step, outline, parameters, progress, keep_markers=True)
    except FaceError as first:
        if step.method == "elements" or isinstance(step, Incision):
            raise
        try:
            closed, report = _unfolded(
                face, step, outline, parameters, progress, keep_markers=False
            )
        except FaceError:
            raise first from None
    return closed, {"removed_share_of_margin": outline.share, **report}


def _unfolded(
    face: xr.Dataset,
    step: Wedge | Incision,
    outline: Outline,
    parameters: SimulationParameters,
    progress: Progress | None,
    *,
    keep_markers: bool,
) -> tuple[xr.Dataset, Report]:
    """Close a wound, and again with the elements divided whose corners the closure has folded."""
    fans: frozenset[int] = frozenset()
    while True:
        wound = excise(face, outline, step.lip, step.method, fans, keep_markers=keep_markers)
        closed, report = _sutured(face, step, wound, parameters, progress)
        folded = _folded(closed["position"].values, closed["connectivity"].values, wound)
        if folded <= fans:
            _valid(closed, step)  # folds that no division removes are refused
            return closed, report
        fans |= folded


def _folded(position: Floats, connectivity: Integers, wound: Wound) -> frozenset[int]:
    """Nodes of a wound at which an element of the closed face has an inverted corner."""
    nodes: set[int] = set()
    for kind, chosen in ((HEX8, connectivity[:, 6] >= 0), (WEDGE6, connectivity[:, 6] < 0)):
        own = np.flatnonzero(chosen)
        corners = position[connectivity[own, : kind.n_nodes]]
        det = np.linalg.det(np.einsum("eni,pnj->epij", corners, kind.dN_corners))
        element, corner = np.nonzero(det <= 0.0)
        nodes.update(wound.connectivity[own[element], corner].tolist())
    return frozenset(nodes)


def _sutured(
    face: xr.Dataset,
    step: Wedge | Incision,
    wound: Wound,
    parameters: SimulationParameters,
    progress: Progress | None,
) -> tuple[xr.Dataset, Report]:
    """Face whose wound is closed, at rest, with its scar."""
    p = parameters.model_copy(update={"gravity": False, "contact": NO_CONTACT})
    same = ties(wound.pairs, len(wound.position))
    opened, at = rebuilt(face, wound, np.arange(len(wound.position)), wound.position)
    met = wound.position.copy()
    local = at >= 0
    joined = np.full(opened.sizes["node"], -1)
    joined[at[local]] = at[same[local]]
    aim = wound.position.copy()
    aim[wound.pairs] = wound.aims[:, None]
    open_aim = opened["position"].values.copy()
    open_aim[at[local]] = aim[local]
    open_scene = compose_scene(opened, p)
    try:
        drawn = drawn_together(open_scene, joined, open_aim, progress=progress)
    except FaceError:  # some wounds close along straight paths only
        drawn = drawn_together(open_scene, joined, progress=progress)
    met[local] = drawn[at[local]]
    tied, number = rebuilt(face, wound, same, _mean(met, same))
    suture = np.unique(number[wound.pairs[:, 0]])
    F0 = centre_stretch(wound.stress_free, wound.position, wound.connectivity)
    before = _unstretched(tied, F0)
    side = _one_side(wound)[element_order(tied).face_index]

    closed, closing = _at_rest(tied, before, parameters, side, suture)
    report: Report = {"closing_force_N": closing.force}
    scarred, scar_report = _scarred(closed, face, step, suture, wound)
    if scarred is not closed:
        closed, closing = _at_rest(scarred, before, parameters, side, suture)
    report |= scar_report
    closed = closed.assign(_sutures(face, number, suture, closing.traction[suture]))
    area = _wall_area(closing.position, wound, number)
    stress = np.linalg.norm(closing.traction[suture], axis=1).sum() / area if area else 0.0
    quality = element_quality(face["position"].values, face["connectivity"].values)
    return closed, {
        SUTURED: 1e9 * wound.removed,
        "volume_before_mm3": 1e9 * float(quality.volume.sum()),
        "widest_gap_mm": 1e3 * _gap(wound),
        "mean_suture_stress_Pa": float(stress),
        "imbalance_N": closing.imbalance,
        "smallest_J": closing.smallest_J,
        "moved_markers": closed.attrs.pop("moved_markers", ""),
        **report,
    }


def _sutures(
    face: xr.Dataset, number: Integers, suture: Integers, traction: Floats
) -> dict[str, Any]:
    """Variables of the nodes of a new suture, after those of earlier ones that are left.

    `number` are the new numbers of the nodes. The forces of an earlier suture are those of its closure.
    """
    node, force, of_cut = suture, traction, np.zeros(len(suture), dtype=np.int32)
    if "suture_node" in face:
        old, first = np.unique(number[face["suture_node"].values], return_index=True)
        first = first[(old >= 0) & ~np.isin(old, suture)]
        before = (
            face["suture_cut"].values
            if "suture_cut" in face
            else np.zeros_like(face["suture_node"])
        )
        node = np.concatenate([number[face["suture_node"].values[first]], node])
        force = np.concatenate([face["suture_traction"].values[first], force])
        of_cut = np.concatenate([before[first], of_cut + before.max() + 1])
    return {
        "suture_node": ("suture", node.astype(np.int32), {"units": "1"}),
        "suture_traction": (("suture", "axis"), force, {"units": "N"}),
        "suture_cut": ("suture", of_cut.astype(np.int32), {"units": "1"}),
    }


def _at_rest(
    face: xr.Dataset,
    before: Floats,
    parameters: SimulationParameters,
    side: NDArray[np.bool_],
    suture: Integers,
) -> tuple[xr.Dataset, Closed]:
    """Face in equilibrium without gravity, its lips in contact if they would pass each other."""
    p = parameters.model_copy(update={"gravity": False, "contact": NO_CONTACT})
    start = face["position"].values
    here = carried(face, before)
    state = relaxed(compose_scene(here, p), start, side, suture)
    if "lip_opening_node" in face and lip_opening(face, state.position) < 0.0:
        p = p.model_copy(update={"contact": ContactParameters(between=("lips",))})
        with suppress(FaceError):  # a wound of some layers has no surface for contact
            state = relaxed(compose_scene(here, p), start, side, suture)
    moved = face.assign(position=(("node", "axis"), state.position, {"units": "m"}))
    return carried(moved, before), state


def _unstretched(face: xr.Dataset, F0: Floats) -> Floats:
    """Fibre directions (rows, 3) of a face in its stress-free state, whose stretch is F0 (elements,)."""
    directions = face["bundle_direction"].values[..., None]
    own = np.linalg.solve(F0[face["bundle_index"].values], directions)
    return np.asarray(own[..., 0], dtype=np.float64)


def _rested(face: xr.Dataset, parameters: SimulationParameters) -> xr.Dataset:
    """Face with a residual stress, in equilibrium again after its stiffness has changed.

    The forces on the suture remain those of the closure.
    """
    if "stress_free_position" not in face:
        return face
    free, position = face["stress_free_position"].values, face["position"].values
    before = _unstretched(face, centre_stretch(free, position, face["connectivity"].values))
    none = np.zeros(face.sizes["element"], dtype=bool)
    return _at_rest(face, before, parameters, none, np.empty(0, dtype=np.int64))[0]


def _mean(position: Floats, same: Integers) -> Floats:
    """Positions in which all nodes that are the same have their mean."""
    total, count = np.zeros_like(position), np.bincount(same, minlength=len(same))
    np.add.at(total, same, position)
    return (total / np.maximum(count, 1)[:, None])[same]


def _gap(wound: Wound) -> float:
    a, b = wound.position[wound.pairs.T]
    return float(np.linalg.norm(a - b, axis=1).max(initial=0.0))


def carried(face: xr.Dataset, before: Floats) -> xr.Dataset:
    """Face with fibre directions that are `before` (rows, 3) in its stress-free state."""
    free = face["stress_free_position"].values
    position, connectivity = face["position"].values, face["connectivity"].values
    F0 = centre_stretch(free, position, connectivity)[face["bundle_index"].values]
    direction = np.einsum("rij,rj->ri", F0, before)
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return face.assign(bundle_direction=(("bundle_element", "axis"), direction, {"units": "1"}))


def centre_stretch(free: Floats, position: Floats, connectivity: Integers) -> Floats:
    """F0 (elements, 3, 3) at the centres, from the stress-free state to the face."""
    F0 = np.tile(np.eye(3), (len(connectivity), 1, 1))
    wedge = connectivity[:, 6] < 0
    for kind, chosen in ((HEX8, ~wedge), (WEDGE6, wedge)):
        dN = kind.dN.mean(axis=0)
        rows = connectivity[chosen, : kind.n_nodes]
        after = np.einsum("eai,aj->eij", position[rows], dN)
        F0[chosen] = after @ np.linalg.inv(
            np.einsum("eai,aj->eij", free[chosen, : kind.n_nodes], dN)
        )
    return F0


def _one_side(wound: Wound) -> NDArray[np.bool_]:
    """Mask of the elements at the first nodes of the pairs.

    In an incision, both edges have the same nodes; the side is then that of the middle of the element.
    """
    left, right = wound.pairs.T
    if (left == right).all():
        points = wound.position[left]
        across = np.linalg.svd(points - points.mean(axis=0))[2][2]
        centres = element_centres(wound.position, wound.connectivity)
        return np.asarray((centres - points.mean(axis=0)) @ across > 0.0)
    own = np.setdiff1d(left, right)
    touching = np.isin(wound.connectivity, own) & (wound.connectivity >= 0)
    return np.asarray(touching.any(axis=1))


def _wall_area(position: Floats, wound: Wound, number: Integers) -> float:
    """Area of the sutured surface: faces between two elements with sutured nodes only [m^2]."""
    rows = np.where(wound.connectivity < 0, -1, number[wound.connectivity])
    faces, _ = element_faces(rows)
    mine = faces[np.isin(faces, number[wound.pairs[:, 0]]).all(axis=1)]
    shared, count = np.unique(np.sort(mine, axis=1), axis=0, return_counts=True)
    twice = {tuple(row) for row in shared[count == 2].tolist()}
    walls = {tuple(sorted(row)): row for row in mine.tolist() if tuple(sorted(row)) in twice}
    return float(face_areas(position, np.array([*walls.values()])).sum()) if walls else 0.0


def _scarred(
    closed: xr.Dataset, face: xr.Dataset, step: Any, suture: Integers, wound: Wound
) -> tuple[xr.Dataset, Report]:
    """Stiffen the scar, and remove the muscle in it and at the ends of fibres not joined."""
    position = closed["position"].values
    centres = element_centres(position, closed["connectivity"].values)
    points = position[suture] if wound.line is None else wound.line
    away = np.asarray(KDTree(points).query(centres)[0])
    scar = away <= MM * step.scar.radius if step.scar else np.zeros(len(away), dtype=bool)
    if step.scar and scar.any():
        closed = with_factor(closed, np.where(scar, step.scar.stiffness, 1.0))
    names = [str(m) for m in closed["muscle"].values]
    gone = np.setdiff1d(np.arange(face.sizes["element"]), wound.parent)
    hit = np.isin(face["bundle_index"].values, np.union1d(gone, wound.parent[wound.changed]))
    severed = {names[m] for m in face["bundle_muscle"].values[hit]}
    apart = sorted(name for name in severed if not step.joins(name))
    element, muscle = closed["bundle_index"].values, closed["bundle_muscle"].values
    off = scar[element]
    ends = away <= MM * step.retraction
    off |= ends[element] & np.isin(muscle, [names.index(name) for name in apart])
    if off.any():
        closed = with_share(closed, np.where(off, 0.0, 1.0))
    return closed, {
        "severed_muscles": sorted(severed),
        "not_joined": apart,
        "scar_elements": int(scar.sum()),
    }


def _change(
    face: xr.Dataset, step: Change, parameters: SimulationParameters, _: Any
) -> tuple[xr.Dataset, Report]:
    changed, report = apply_change(face, step)
    return _rested(changed, parameters), report


def _palsy(
    face: xr.Dataset, step: Palsy, parameters: SimulationParameters, _: Any
) -> tuple[xr.Dataset, Report]:
    return apply_palsy(face, step)


def _resection(
    face: xr.Dataset, step: Resection, parameters: SimulationParameters, _: Any
) -> tuple[xr.Dataset, Report]:
    raise TreatmentError(
        "other model",
        "a resection applies to a jaw model, and the model is a face: expected the file of a jaw "
        "(emgface build jaw)",
    )


_APPLY: Final[dict[type, Callable[..., tuple[xr.Dataset, Report]]]] = {
    Wedge: _cut,
    Incision: _cut,
    Change: _change,
    Palsy: _palsy,
    Resection: _resection,
}
"""Function that applies each kind of step; a new kind is a class of the plan and an entry."""
