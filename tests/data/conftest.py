"""One small valid dataset of each kind."""

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest
import xarray as xr

from emgface.muscles import AXES, CHANNELS, FACE_MARKERS, LIP_MARKERS, MUSCLES
from emgface.recordings.quality.markers import LAYOUT
from tests.jaw.small import small_jaw
from tests.tongue.small import small_tongue, small_tongue_motion

S = {"units": "s"}
ONE = {"units": "1"}
M = {"units": "m"}


def recording() -> xr.Dataset:
    rng = np.random.default_rng(1)
    emg = rng.normal(scale=1e-4, size=(len(CHANNELS), 512))
    markers = FACE_MARKERS + LIP_MARKERS
    rest = 0.025 * np.array([LAYOUT[name] for name in markers])[:, :, None]
    position = rest + 0.003 * np.sin(0.2 * np.arange(25) + rng.uniform(size=(len(markers), 3, 1)))
    position += 2e-5 * rng.normal(size=position.shape)
    position[2, :, 7:9] = np.nan
    return xr.Dataset(
        {
            "emg": (("channel", "time_emg"), emg, {"units": "V"}),
            "position": (("marker", "axis", "time_marker"), position, M),
        },
        {
            "channel": list(CHANNELS),
            "time_emg": ("time_emg", np.arange(512) / 2048, S),
            "marker": list(markers),
            "axis": list(AXES),
            "time_marker": ("time_marker", np.arange(25) / 100, S),
        },
        {
            "origin": "simulated",
            "volunteer": "V01",
            "instruction": "A",
            "repetition": 1,
            "source": "a test",
            "source_digest": "0" * 64,
        },
    )


def activation() -> xr.Dataset:
    values = np.random.default_rng(2).uniform(size=(len(MUSCLES), 30))
    values[0, 0], values[0, 1] = 0.0, 1.0
    return xr.Dataset(
        {"activation": (("muscle", "time"), values, ONE)},
        {"muscle": list(MUSCLES), "time": ("time", np.arange(30) / 100, S)},
        {
            "origin": "simulated",
            "strategy": "act_rel",
            "volunteer": "V01",
            "instruction": "A",
            "repetition": 2,
            "parameters": '{"window": 0.2}',
        },
    )


def face_model() -> xr.Dataset:
    """Return two elements, a hexahedron and a wedge, that share a face."""
    nodes = [
        [x, y, z] for z in (0.0, 0.01) for x, y in ((0, 0), (0.01, 0), (0.01, 0.01), (0, 0.01))
    ]
    nodes += [[0.02, 0.0, 0.0], [0.02, 0.0, 0.01]]
    direction = np.zeros((20, 3))
    direction[:, 0] = 1.0
    connectivity = [[0, 1, 2, 3, 4, 5, 6, 7], [1, 8, 2, 5, 9, 6, -1, -1]]
    indices = {
        "node_id": ("node", np.arange(1, 11)),
        "connectivity": (("element", "element_node"), np.array(connectivity)),
        "element_id": ("element", np.array([7, 9])),
        "layer": ("element", np.array([0, 2])),
        "fixed": ("node", np.array([1, 2] + [0] * 8)),
        "fibre_of_point": ("fibre_point", np.zeros(3, int)),
        "fibre_muscle": ("fibre", np.array([4])),
        "bundle_muscle": ("bundle_element", np.arange(20)),
        "bundle_index": ("bundle_element", np.arange(20) % 2),
        "marker_node": ("marker", np.arange(10)),
        "lip_opening_node": ("lip", np.array([3, 4])),
    }
    return xr.Dataset(
        {
            "position": (("node", "axis"), np.array(nodes), M),
            "bundle_direction": (("bundle_element", "axis"), direction, ONE),
            "fibre_position": (("fibre_point", "axis"), np.zeros((3, 3)), M),
            "face_marker_position": (("face_marker", "axis"), np.zeros((6, 3)), M),
            **{name: (dims, values, ONE) for name, (dims, values) in indices.items()},
        },
        {
            "axis": list(AXES),
            "muscle": list(MUSCLES),
            "marker": list(LIP_MARKERS),
            "face_marker": list(FACE_MARKERS),
            "lip": ["upper", "lower"],
        },
        {"name": "two elements", "origin": "generated", "source": "a test", "frame": "x right"},
    )


def trajectory() -> xr.Dataset:
    n = 12
    return xr.Dataset(
        {
            "position": (("marker", "axis", "time"), np.full((10, 3, n), 0.02), M),
            "smallest_J": ("time", np.linspace(1.0, 0.8, n), ONE),
            "iterations": ("time", np.arange(n), ONE),
            "lip_opening": ("time", np.linspace(-0.005, 0.01, n), M),
            "elastic_energy": ("time", np.linspace(0, 1e-3, n), {"units": "J"}),
        },
        {
            "marker": list(LIP_MARKERS),
            "axis": list(AXES),
            "time": ("time", np.arange(n) * 0.01, S),
        },
        {"solver": "implicit Euler", "step": 0.01, "sigma_max": 3e5, "run_time_s": 1.5},
    )


def scores() -> xr.Dataset:
    rho = np.linspace(-1, 1, 10)
    rho[3] = np.nan
    return xr.Dataset(
        {
            "rho": ("marker", rho, ONE),
            "amplitude_ratio": ("marker", np.full(10, 0.8), ONE),
            "rmse": ("marker", np.full(10, 1e-3), M),
            "shift": ((), -0.04, S),
        },
        {"marker": list(LIP_MARKERS)},
        {"strategy": "act_3", "volunteer": "Müller, Ä", "origin": "simulated"},
    )


def cube() -> xr.Dataset:
    trial = ("volunteer", "instruction", "repetition", "strategy")
    shape = (2, 3, 1, 2)
    rho = np.random.default_rng(3).uniform(-1, 1, (*shape, 10))
    rho[1, 2, 0, 1] = np.nan
    status = np.full(shape, "ok", dtype=object)
    status[1, 2, 0, 1] = "failed:InvertedElement"
    reason = np.full(shape, "", dtype=object)
    reason[1, 2, 0, 1] = "element 5 at 0.3 s, σ_max 90 kPa"
    return xr.Dataset(
        {
            "rho": ((*trial, "marker"), rho, ONE),
            "amplitude_ratio": ((*trial, "marker"), np.abs(rho), ONE),
            "rmse": ((*trial, "marker"), np.abs(rho) * 1e-3, M),
            "status": (trial, status),
            "reason": (trial, reason),
            "shift": (trial, np.full(shape, 0.1), S),
            "sigma_max": (trial, np.full(shape, 3e5), {"units": "Pa"}),
            "steps": (trial, np.full(shape, 160.0), ONE),
            "run_time": (trial, np.full(shape, 12.5), S),
        },
        {
            "volunteer": ["V01", "V02"],
            "instruction": ["A", "B", "C"],
            "repetition": [1],
            "strategy": ["act_all", "act_rel"],
            "marker": list(LIP_MARKERS),
        },
        {"origin": "simulated"},
    )


def sound() -> xr.Dataset:
    time, samples = ("time", [0.0, 0.1], S), ("time_sound", np.arange(5) / 44_100.0, S)
    formants = (("time", "formant"), np.array([[500.0, 1500.0], [480.0, np.nan]]), {"units": "Hz"})
    return xr.Dataset(
        {
            "area": (("time", "section"), np.full((2, 4), 3e-4), {"units": "m2"}),
            "length": ("time", [0.17, 0.18], M),
            "formant_frequency": formants,
            "formant_bandwidth": (formants[0], 0.1 * formants[1], {"units": "Hz"}),
            "sound": ("time_sound", np.zeros(5), {"units": "Pa"}),
            "glottal_flow": ("time_sound", np.zeros(5), {"units": "m3 s-1"}),
        },
        {"time": time, "time_sound": samples, "formant": ("formant", [1, 2], ONE)},
        {"origin": "simulated"},
    )


@cache
def jaw_made_once() -> xr.Dataset:
    return small_jaw()


def jaw_model() -> xr.Dataset:
    return jaw_made_once().copy(deep=True)


def jaw_motion() -> xr.Dataset:
    time = {"time": ("time", [0.0, 0.005], S)}
    still = np.broadcast_to([[[1.0], [0.0], [0.0], [0.0]]], (1, 4, 2))
    return xr.Dataset(
        {
            "body_position": (("body", "axis", "time"), np.zeros((1, 3, 2)), M),
            "body_quaternion": (("body", "part", "time"), still, ONE),
            "position": (("marker", "axis", "time"), np.zeros((1, 3, 2)), M),
            "activation": (("muscle", "time"), np.zeros((1, 2)), ONE),
            "muscle_length": (("muscle", "time"), np.full((1, 2), 0.05), M),
            "muscle_force": (("muscle", "time"), np.zeros((1, 2)), {"units": "N"}),
        },
        {
            "axis": list(AXES),
            "part": ["w", "x", "y", "z"],
            "body": ["jaw"],
            "marker": ["lower_incisor"],
            "muscle": ["sm_L"],
            **time,
        },
        {"origin": "simulated", "jaw": "small", "law": "peck"},
    )


def reduced_face() -> xr.Dataset:
    modes = (("node", "axis", "mode"), np.zeros((4, 3, 3)), {"units": "kg^-1/2"})
    return xr.Dataset(
        {
            "node_rest": (("node", "axis"), np.zeros((4, 3)), M),
            "modes": modes,
            "sampled_element": ("sample", np.array([3]), ONE),
            "sampled_weight": ("sample", np.array([8.0]), ONE),
            "activation_whitening": (("muscle", "muscle_of"), np.eye(1), ONE),
            "activation_response": (("muscle", "muscle_of"), np.eye(1), M),
            "singular_value": ("snapshot", np.array([1e-4]), {"units": "m kg^1/2"}),
            "basis_size": ("size", np.array([3]), ONE),
            "projection_rms": ("size", np.array([1e-4]), M),
            "projection_largest": ("size", np.array([1e-3]), M),
        },
        {"axis": list(AXES), "muscle": ["ZYG_L"]},
        {
            **dict.fromkeys(("face_digest", "mechanics", "training", "training_digest"), ""),
            **dict.fromkeys(("step", "sample_error", "error_factor", "error_floor"), 1e-5),
            **dict.fromkeys(("calibration_rms", "calibration_largest", "largest_distance"), 1e-3),
            "largest_change": 1e-3,
            **dict.fromkeys(("training_seconds", "training_time_s"), 10.0),
            "coverage": 0.95,
            "moving": 3,
            "origin": "simulated",
        },
    )


def jaw_excitation() -> xr.Dataset:
    time = {"time": ("time", [0.0, 0.005], S)}
    values = (("exciter", "time"), np.full((1, 2), 0.5), ONE)
    return xr.Dataset({"excitation": values}, {"exciter": ["m_L"], **time}, {"origin": "simulated"})


def _array(dims: str, values: Any, units: str, dtype: str = "float64") -> Any:
    return dims.split(), np.asarray(values, dtype=dtype), {"units": units}


def head_model() -> xr.Dataset:
    """Lists of a head of two parts whose tongue has three nodes on the mandible."""
    corners = 0.01 * np.concatenate([np.zeros((1, 3)), np.eye(3)])
    faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
    return xr.Dataset(
        {
            "attachment_pair": _array("attachment", [0, 0, 0], "1", "int32"),
            "attachment_node": _array("attachment", [0, 4, 7], "1", "int32"),
            "shell_bone": _array("shell", [1], "1", "int32"),
            "shell_position": _array("shell_vertex axis", corners, "m"),
            "shell_triangle": _array("shell_face corner", faces, "1", "int32"),
            "triangle_shell": _array("shell_face", [0, 0, 0, 0], "1", "int32"),
            "exciter_gain": _array("exciter muscle", [[1.0, 1.0]], "1"),
        },
        {
            "axis": list("xyz"), "part": ["jaw", "tongue"], "pair": ["tongue-jaw"],
            "contact": ["tongue-teeth"], "shell": ["mandible"], "muscle": ["GGP_L", "GGP_R"],
            "exciter": ["bi_GGP"],
        },
        {"name": "small", "origin": "generated", "frame": "x right, y anterior, z superior"},
    )  # fmt: skip


def head_motion() -> xr.Dataset:
    """Two instants of a tongue of two nodes on a jaw."""
    turned = np.zeros((1, 4, 2))
    turned[:, 0] = 1.0
    return xr.Dataset(
        {
            "node_position": _array("node axis time", np.full((2, 3, 2), 0.02), "m"),
            "tissue_nodes": _array("tissue", [2], "1", "int32"),
            "body_position": _array("body axis time", np.full((1, 3, 2), 0.05), "m"),
            "body_quaternion": _array("body part time", turned, "1"),
            "position": _array("marker axis time", np.full((1, 3, 2), 0.03), "m"),
            "activation": _array("muscle time", [[0.0, 0.5]], "1"),
            "smallest_J": _array("time", [1.0, 0.9], "1"),
        },
        {
            "axis": list("xyz"), "named": ["jaw", "tongue"], "part": list("wxyz"),
            "tissue": ["tongue"], "body": ["jaw"], "marker": ["tip"], "muscle": ["GGP_L"],
            "time": ("time", [0.0, 0.01], {"units": "s"}),
        },
        {"origin": "simulated", "head": "small"},
    )  # fmt: skip


def emg_calibration() -> xr.Dataset:
    """Calibration of two muscles, one of them assumed."""
    return xr.Dataset(
        {
            "gain": _array("muscle", [0.4, 1.0], "1"),
            "delay": _array("muscle", [0.04, 0.04], "s"),
            "error": _array("muscle", [0.1, 0.3], "1"),
            "estimated": _array("muscle", [1, 0], "1", "int64"),
        },
        {"muscle": ["ZYG_L", "OOP_L"]},
        {
            "volunteer": "S01", "trials": 2, "sigma_max": 1e5, "model_error": 0.3,
            "range_parameters": "{}", "origin": "simulated",
        },
    )  # fmt: skip


VALID: dict[str, Callable[[], xr.Dataset]] = {
    "recording": recording,
    "activation": activation,
    "face_model": face_model,
    "trajectory": trajectory,
    "reduced_face": reduced_face,
    "scores": scores,
    "sound": sound,
    "cube": cube,
    "emg_calibration": emg_calibration,
    "head_model": head_model,
    "head_motion": head_motion,
    "jaw_excitation": jaw_excitation,
    "jaw_model": jaw_model,
    "jaw_motion": jaw_motion,
    "tongue_model": small_tongue,
    "tongue_motion": small_tongue_motion,
}


@pytest.fixture
def valid() -> Callable[[str], xr.Dataset]:
    """Return the maker of a valid dataset of a kind."""
    return lambda kind: VALID[kind]()


@pytest.fixture
def trial() -> xr.Dataset:
    """One valid study recording."""
    return recording()
