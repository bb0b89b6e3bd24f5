"""Training of a reduced face: full-order motions, modes, sampled elements, calibrated error."""

import time
from collections.abc import Callable
from typing import Final

import numpy as np
import xarray as xr

from emgface.face.simulation_parameters import SimulationParameters
from emgface.reduced.full_order import MECHANICAL, TRAINING_STEP, FullOrder, stored_motion
from emgface.reduced.model import (
    Floats,
    ReducedFace,
    mechanics_of,
    training_text,
)
from emgface.reduced.motion import simulate_reduced
from emgface.reduced.parameters import ReductionParameters
from emgface.reduced.plan import TrainingDrive, training_plan
from emgface.reduced.study_plan import sequences_of
from emgface.reduced.trained import (
    changes,
    response_root,
    response_size,
    whitened_size,
    whitening_of,
)
from emgface.run.digest import dataset_digest, text_digest
from emgface.run.store import Store
from emgface.schema.validation import validate
from sim import (
    Activation,
    FixedStep,
    simulate,
)
from sim.reduced import (
    Features,
    FusedEuler,
    ReducedContact,
    coverage_factor,
    fitted_closure,
    mass_modes,
    near_vertices,
    projected,
    reduce_system,
    static_responses,
)
from sim.threads import one_blas_thread

Progress = Callable[[str, int, int], None]


SMALLEST_ESTIMATE: Final = 1e-3
"""Smallest estimate of the error before calibration [m]."""
MOST_SAMPLED_STATES: Final = 300
"""Largest number of training states at which forces are sampled."""
TOUCHED, CLOSE_FACES = 100, 2e-3
"""Number of training states at which points near opposite faces are found, and their distance [m]."""
MARKER_WEIGHT: Final = 1.0
"""Weight of the markers in the norm of the modes, relative to the mass of the tissue."""


@one_blas_thread
def reduce_face(
    face: xr.Dataset,
    parameters: SimulationParameters,
    reduction: ReductionParameters,
    store: Store,
    *,
    progress: Progress | None = None,
) -> xr.Dataset:
    """Train a reduced face for the tissue, muscles and contact of some parameters.

    The motions of the plan are stored, so that an interrupted training resumes and another size of
    the basis needs no new motion. The result is of schema reduced_face.

    Raises
    ------
    SceneError
        The parameters have parts that a reduced face does not support (`sim.reduced.reduce_system`),
        or there are too few snapshots.
    """
    tell = progress or (lambda what, done, total: None)
    full = FullOrder.from_face(face, parameters)
    plan = training_plan(
        full.system.muscles,
        sequences_of(reduction.activations),
        seed=reduction.seed,
        ramps=reduction.ramps,
        sequences=reduction.sequences,
        calibration=reduction.calibration,
    )
    # Unsupported parts are refused before the training.
    none = np.zeros((full.rest.size, 3))
    reduce_system(full.tissue, full.rest, none, 3)
    if full.system.contact is not None:
        ReducedContact(full.system.contact, full.rest, none)
    motions, digests = list[xr.Dataset](), list[str]()
    for k, drive in enumerate(plan):
        tell(drive.label, k, len(plan))
        result = stored_motion(store, full, drive, reduction.every)
        motions.append(result[0])
        digests.append(result[1])
    tell("modes and elements", len(plan), len(plan))
    cost = sum(float(m.attrs.get("cost_s", 0.0)) for m in motions)
    begun = time.process_time()
    data = _reduced(full, reduction, plan, motions)
    data.attrs |= {
        "face_digest": dataset_digest(face),
        "mechanics": mechanics_of(full.parameters),
        "training": training_text(reduction, full.parameters.sigma_max),
        "training_digest": text_digest("".join(digests)),
        "training_seconds": float(sum(d.time[-1] for d in plan)),
        "training_time_s": 0.0,
        "step": TRAINING_STEP,
        "coverage": reduction.coverage,
        "error_factor": 1.0,
        "error_floor": SMALLEST_ESTIMATE,
        "largest_change": 0.0,
        "calibration_rms": 0.0,
        "calibration_largest": 0.0,
        "origin": "simulated",
    }
    _correct(full, data, plan, motions)
    _calibrate(full, data, reduction.coverage, plan, motions)
    spent = cost + time.process_time() - begun
    return validate(data.assign_attrs(training_time_s=spent), "reduced_face")


def _with_purpose(
    plan: list[TrainingDrive], motions: list[xr.Dataset], purpose: str
) -> list[tuple[TrainingDrive, xr.Dataset]]:
    """Drives of a purpose with their motions, with the activation that was used."""
    pairs = zip(plan, motions, strict=True)
    return [
        (drive.scaled(m.attrs["scale"]), m)
        for drive, m in pairs
        if drive.purpose == purpose and m.attrs["scale"] > 0.0
    ]


def _reduced(
    full: FullOrder,
    reduction: ReductionParameters,
    plan: list[TrainingDrive],
    motions: list[xr.Dataset],
) -> xr.Dataset:
    """Modes, chosen elements, and the range of the training."""
    system, rest, mass = full.tissue, full.rest, full.tissue.node_mass
    training = [m for _, m in _with_purpose(plan, motions, "training")]
    moved = np.concatenate([m["node_position"].values for m in training]) - rest
    levels = np.concatenate([m["activation"].values for m in training])
    responses = static_responses(system, rest)
    n = reduction.modes + reduction.omitted
    weight = mass.copy()
    nodes = full.face["marker_node"].values.astype(np.int64)
    weight[nodes] += MARKER_WEIGHT * mass.sum() / len(nodes)
    modes, values = mass_modes(np.concatenate([moved, responses]), mass, n, weight)
    whole = reduce_system(system, rest, modes, reduction.modes)
    at = np.linspace(0, len(moved) - 1, min(MOST_SAMPLED_STATES, len(moved))).astype(int)
    y = np.ascontiguousarray(projected(moved[at], mass, modes)[:, : reduction.modes])
    _, sample = whole.sampled_at(
        y,
        levels[at],
        tolerance=reduction.sample_tolerance,
        most=reduction.elements,
        seed=reduction.seed,
    )
    root = whitening_of(levels)
    response = response_root(responses, weight)
    displacements = [
        m["node_position"].values - rest for _, m in _with_purpose(plan, motions, "calibration")
    ]
    sizes, rms, largest = _projection_errors(
        full, modes, np.concatenate(displacements), reduction.modes
    )
    data = xr.Dataset(
        {
            "node_rest": (("node", "axis"), rest, {"units": "m"}),
            "modes": (
                ("node", "axis", "mode"),
                modes.reshape(*rest.shape, n),
                {"units": "kg^-1/2"},
            ),
            "sampled_element": ("sample", sample.elements, {"units": "1"}),
            "sampled_weight": ("sample", sample.weights, {"units": "1"}),
            "activation_whitening": (("muscle", "muscle_of"), root, {"units": "1"}),
            "activation_response": (("muscle", "muscle_of"), response, {"units": "m"}),
            "singular_value": ("snapshot", values, {"units": "m kg^1/2"}),
            "basis_size": ("size", sizes, {"units": "1"}),
            "projection_rms": ("size", rms, {"units": "m"}),
            "projection_largest": ("size", largest, {"units": "m"}),
        },
        coords={"axis": list("xyz"), "muscle": list(system.muscles)},
        attrs={"moving": reduction.modes, "sample_error": sample.error},
    )
    contact = full.system.contact
    if contact is not None:
        some = np.linspace(0, len(moved) - 1, min(TOUCHED, len(moved))).astype(int)
        near = near_vertices(contact, rest + moved[some], CLOSE_FACES)
        data["contact_slot"] = "contact_point", near, {"units": "1"}
    return data.assign_attrs(largest_distance=float(whitened_size(levels, root).max()))


def _steps(drive: TrainingDrive) -> Floats:
    """Changes of the activation in each step of a drive that begins at rest."""
    ends: Floats = TRAINING_STEP * np.arange(
        1, round(float(drive.time[-1]) / TRAINING_STEP) + 1, dtype=np.float64
    )
    return changes(ends, Activation(drive.time, drive.values).at_all(ends), TRAINING_STEP)


def _projection_errors(
    full: FullOrder, modes: Floats, moved: Floats, most: int
) -> tuple[np.ndarray, Floats, Floats]:
    """Distance of the markers from the span of a growing number of modes."""
    nodes = full.face["marker_node"].values.astype(np.int64)
    y = projected(moved, full.system.node_mass, modes)
    rows = modes.reshape(*full.rest.shape, -1)[nodes]
    sizes = np.unique(np.append(np.arange(6, modes.shape[1], 6), [most, modes.shape[1]]))
    rms, largest = list[float](), list[float]()
    for size in sizes:
        left = moved[:, nodes] - np.einsum("maj,kj->kma", rows[..., :size], y[:, :size])
        distance = np.linalg.norm(left, axis=2)
        rms.append(float(np.sqrt((distance**2).mean())))
        largest.append(float(distance.max()))
    return sizes.astype(np.int64), np.array(rms), np.array(largest)


def marker_errors(
    reduced: ReducedFace, drive: TrainingDrive, motion: xr.Dataset
) -> tuple[Floats, xr.Dataset]:
    """Distance (time, marker) [m] of a reduced motion from that of full order, and the motion."""
    simulated = simulate_reduced(
        reduced,
        Activation(drive.time, drive.values),
        float(drive.time[-1]),
        step=TRAINING_STEP,
        output=TRAINING_STEP,
    )
    position = simulated["position"].transpose("time", "marker", "axis").values
    return np.linalg.norm(position - motion["marker_position"].values, axis=2), simulated


def _correct(
    full: FullOrder, data: xr.Dataset, plan: list[TrainingDrive], motions: list[xr.Dataset]
) -> None:
    """Fit the correction of the markers to the motions of the training."""
    reduced = ReducedFace(data, full.face, full.parameters)
    _, nodes = reduced.nodes
    n = reduced.modes.shape[2] + len(full.system.muscles)
    features, missing = list[Floats](), list[Floats]()
    for drive, motion in _with_purpose(plan, motions, "training"):
        try:
            simulated, _ = simulate(
                reduced.model.system,
                Activation(drive.time, drive.values),
                duration=float(drive.time[-1]),
                integrator=FusedEuler(reduced.contact),
                steps=FixedStep(TRAINING_STEP),
                probes=(reduced.markers, Features(n)),
                initial=reduced.equilibrium,
            )
        except MECHANICAL:
            continue
        whole = motion["node_position"].values[:, nodes]
        stride = round((simulated.sizes["time"] - 1) / len(whole))
        at = slice(stride, stride * len(whole) + 1, stride)
        position = simulated["position"].transpose("time", "marker", "axis").values[at]
        missing.append(whole - position)
        features.append(simulated["feature"].transpose("time", "of_closure").values[at])
    closure = fitted_closure(np.concatenate(features), np.concatenate(missing))
    data["closure_weight"] = (("corrected", "feature"), closure.weights, {"units": "1"})
    data["closure_offset"] = ("corrected", closure.offset, {"units": "m"})


def _calibrate(
    full: FullOrder,
    data: xr.Dataset,
    coverage: float,
    plan: list[TrainingDrive],
    motions: list[xr.Dataset],
) -> None:
    """Set the factor of the estimated error from the motions of the calibration.

    The largest change of a trusted activation is that of the sequences within the resulting bound.
    """
    reduced = ReducedFace(data, full.face, full.parameters)
    errors, estimates, changed = list[Floats](), list[Floats](), list[float]()
    for drive, motion in _with_purpose(plan, motions, "calibration"):
        error, simulated = marker_errors(reduced, drive, motion)
        errors.append(error)
        estimates.append(simulated["reduction_error"].values - SMALLEST_ESTIMATE)
        changed.append(float(response_size(_steps(drive), reduced.trained.response).max()))
    largest, estimate = np.array([e.max(axis=1) for e in errors]), np.array(estimates)
    factor = coverage_factor(largest, estimate, SMALLEST_ESTIMATE, coverage)
    within = (largest <= factor * (estimate + SMALLEST_ESTIMATE)).all(axis=1)
    data.attrs["error_factor"] = factor
    data.attrs["largest_change"] = float(np.array(changed)[within].max(initial=0.0))
    data.attrs["calibration_rms"] = float(np.sqrt(np.mean(np.square(errors))))
    data.attrs["calibration_largest"] = float(largest.max())
