"""The seven experiments as sweeps: their runs, what is measured, and what is drawn.

Source: Stavness et al., Coupled biomechanical modeling of the face, section 11.4; labials: the published
input series of the face of that collection.
"""

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import xarray as xr
from scipy.spatial import KDTree

from emgface.anatomy.head.model import Head
from emgface.anatomy.head.sweep import Measure, PlannedRun, Setting, outcomes
from emgface.face.muscle_parameters import SIGMA_MAX
from emgface.face.parts import facets_of
from studies.mechanics.expressions import EXPRESSIONS, landmarks

FACE: Final = Setting(parts=("face",), finer=1150, step=2e-2, gravity=False)
"""Face alone, with contact of lips and teeth."""
LAW: Final = {"sigma_max": SIGMA_MAX}
STIFF: Final = {**LAW, "stiffening": 10.0}
RING: Final = "marginal intermediate peripheral"


@dataclass(frozen=True)
class Experiment:
    """A sweep with its title and section, the columns of its table, and its figure."""

    title: str
    runs: tuple[PlannedRun, ...]
    shown: tuple[str, ...]
    drawn: tuple[str, ...]
    setting: Setting = FACE
    measure: Measure = outcomes


def _stiffening() -> Iterator[PlannedRun]:
    for factor, level in itertools.product((1.0, 3.0, 10.0, 20.0), (0.25, 0.5, 1.0)):
        yield PlannedRun(
            f"factor {factor:g}, OOP {level:g}", {"bi_OOP": level}, {**LAW, "stiffening": factor}
        )


def _shape() -> Iterator[PlannedRun]:
    rings = ("marginal", "intermediate", "peripheral")
    for layer, ring in itertools.product(("deep", "middle", "superficial"), rings):
        yield PlannedRun(
            f"{ring} {layer}", {"bi_OOP": 0.5}, STIFF, rings={"OOP": f"{ring} {layer}"}
        )
    for gaps in (0.2, 0.4):
        words = f"peripheral deep gaps={gaps}"
        yield PlannedRun(words, {"bi_OOP": 0.5}, STIFF, rings={"OOP": words})


def _teeth() -> Iterator[PlannedRun]:
    pairs = {"teeth": ("lip-lip", "lips-teeth"), "no teeth": ("lip-lip",)}
    for factor, level, name in itertools.product((1.0, 10.0), (0.5, 1.0), pairs):
        values = {**LAW, "stiffening": factor}
        yield PlannedRun(
            f"factor {factor:g}, OOP {level:g}, {name}",
            {"bi_OOP": level},
            values,
            contacts=pairs[name],
        )


CLOSING: Final[Mapping[str, tuple[Mapping[str, float], Mapping[str, str]]]] = {
    "none": ({}, {}),
    "superficial": ({"bi_OOP": 0.6}, {"OOP": f"{RING} superficial"}),
    "superficial and marginal": (
        {"bi_OOP": 0.6, "bi_OOM": 0.6},
        {"OOP": f"{RING} superficial", "OOM": "marginal middle"},
    ),
    "deep": ({"bi_OOP": 0.6}, {"OOP": f"{RING} deep"}),
    "marginal": ({"bi_OOM": 0.6}, {"OOM": "marginal middle"}),
}
"""Activated parts of orbicularis oris, and how its two muscles are placed."""
OPENERS: Final = (0.0, 0.05, 0.1, 0.3)


def _closing() -> Iterator[PlannedRun]:
    for (name, (drive, rings)), level in itertools.product(CLOSING.items(), OPENERS):
        jaw = {"bi_open": level} if level else {"bi_close": 0.02}
        yield PlannedRun(
            f"{name}, openers {level:g}", {**drive, **jaw}, LAW, rings=rings, contacts=("lip-lip",)
        )


def _expressions() -> Iterator[PlannedRun]:
    for stiffness, (name, muscles) in itertools.product((1.0, 4.0), EXPRESSIONS.items()):
        drive = {f"bi_{muscle}": level for muscle, level in muscles.items()}
        yield PlannedRun(
            f"{name}, skin x {stiffness:g}", drive, {**LAW, "skin.stiffness": stiffness}
        )


def moved_most(motion: xr.Dataset, head: Head) -> dict[str, Any]:
    """Outcomes, with the displacements of the corners, of the landmark that moves most, and of all."""
    points = landmarks(head.parts["face"])
    q = motion["node_position"].transpose("time", "node", "axis").values
    size = {
        name: 1e3 * float(np.linalg.norm(q[-1, node] - q[0, node])) for name, node in points.items()
    }
    corners = 0.5 * (size.pop("corner_left") + size.pop("corner_right"))
    return {
        **outcomes(motion, head),
        "corners_mm": corners,
        "other_mm": max(size.values()),
        "all_mm": (2.0 * corners + sum(size.values())) / (len(size) + 2),
    }


def _coupling() -> Iterator[PlannedRun]:
    drives: dict[str, dict[str, float]] = {
        "rest": {},
        "GGP 0.5": {"bi_GGP": 0.5},
        "HG 0.5": {"bi_HG": 0.5},
        "STY 0.5": {"bi_STY": 0.5},
        "GH and MH 0.5": {"bi_GH": 0.5, "bi_MH": 0.5},
        "openers 0.2": {"bi_open": 0.2},
    }
    for name, drive in drives.items():
        yield PlannedRun(name, drive, contacts=())


LABIALS: Final[Mapping[str, Mapping[str, float]]] = {
    "rest": {},
    "closure": {"LLSAN": 0.36, "MEN": 0.2, "OOM": 0.3, "OOP": 1.0, "RIS": 0.2},
    "fricative": {"LLSAN": 0.36, "MEN": 0.26, "OOP": 1.0, "RIS": 0.26},
    "approximant": {"OOP": 0.3},
}
"""Published levels; those of muscles that the generated face lacks (LLS, lower OOM) are left out."""


OWN_LABIALS: Final[Mapping[str, Mapping[str, float]]] = {
    "own closure": {"OOP": 0.6, "MEN": 0.2},
    "own fricative": {"MEN": 0.6, "RIS": 0.2, "LLSAN": 0.05},
    "own approximant": {"OOP": 0.045},
}
"""Levels found by trial for the generated face; the closure has a superficial peripheral ring."""


def _labials() -> Iterator[PlannedRun]:
    for name, levels in (LABIALS | OWN_LABIALS).items():
        rings = {"OOP": "peripheral superficial"} if name == "own closure" else {}
        yield PlannedRun(name, {f"bi_{m}": level for m, level in levels.items()}, LAW, rings=rings)


MIDLINE: Final = 6e-3  #: largest distance from the midline of incisors, and of the lip at them [m]


def with_teeth(motion: xr.Dataset, head: Head) -> dict[str, float]:
    """Outcomes, with the distance of the margin of the lower lip from the upper incisors."""
    nodes = np.unique(facets_of(head.parts["face"], "lower_lip_margin"))
    margin = motion["node_position"].transpose("time", "node", "axis").values[-1, nodes]
    teeth = head.shell("maxilla").points
    near = [x[np.abs(x[:, 0]) < MIDLINE] for x in (margin, teeth)]
    away = np.asarray(KDTree(near[1]).query(near[0])[0]).min()
    return {**outcomes(motion, head), "lower_to_teeth_mm": 1e3 * float(away)}


_LIPS: Final = ("opening_mm", "area_mm2", "width_mm", "protrusion_mm", "corner_in_mm")
_SPEED: Final = ("smallest_J", "speed_mm_s")

EXPERIMENTS: Final[Mapping[str, Experiment]] = {
    "stiffening": Experiment(
        "1 Stress stiffening (11.4.1, Fig. 11.10)",
        tuple(_stiffening()),
        (*_LIPS, *_SPEED),
        ("protrusion_mm", "opening_mm", "area_mm2"),
    ),
    "shape": Experiment(
        "2 Depth and ring of orbicularis oris (11.4.2, Fig. 11.11)",
        tuple(_shape()),
        (*_LIPS, *_SPEED),
        ("protrusion_mm", "opening_mm", "area_mm2"),
    ),
    "teeth": Experiment(
        "3 Teeth (11.4.3, Fig. 11.12)",
        tuple(_teeth()),
        (*_LIPS, *_SPEED),
        ("protrusion_mm", "opening_mm", "area_mm2"),
    ),
    "closing": Experiment(
        "4 Closing with an open jaw (11.4.4, Fig. 11.13)",
        tuple(_closing()),
        ("lower_incisor_up_mm", "opening_mm", "area_mm2", "upper_up_mm", "lower_up_mm", *_SPEED),
        ("lower_incisor_up_mm", "opening_mm", "area_mm2"),
        Setting(parts=("face", "jaw"), step=2e-2),
    ),
    "expressions": Experiment(
        "5 Expressions (11.4.5, Figs 11.14 and 11.15)",
        tuple(_expressions()),
        ("corners_mm", "other_mm", "all_mm", "corner_up_mm", "corner_in_mm", "area_mm2", *_SPEED),
        ("corners_mm", "other_mm", "all_mm"),
        measure=moved_most,
    ),
    "coupling": Experiment(
        "6 Jaw and tongue (11.3)",
        tuple(_coupling()),
        (
            *(
                f"{point}_{way}_mm"
                for point in ("lower_incisor", "hyoid", "tip", "back")
                for way in ("forward", "up")
            ),
            "speed_mm_s",
        ),
        ("lower_incisor_forward_mm", "lower_incisor_up_mm", "back_forward_mm"),
        Setting(parts=("jaw", "tongue", "hyoid"), finer=980, step=2e-2),
    ),
    "labials": Experiment(
        "7 Labials (published input series)",
        tuple(_labials()),
        ("opening_mm", "area_mm2", "protrusion_mm", "lower_to_teeth_mm", *_SPEED),
        ("opening_mm", "area_mm2", "lower_to_teeth_mm"),
        measure=with_teeth,
    ),
}
