"""Checks 1 to 6 of the fit of a person's own anatomy, as rows: check, quantity, measured, wanted, met.

Closed forms and registration; one published face fitted to the other; generated persons fitted to each
other (`benchmarks.fit_persons`); stacks of a phantom combined and labelled; curves of a probe; damaged
inputs. The published faces and the jaw are read from the folder EMGFACE_SHARED.
"""

import csv
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.spatial.transform import Rotation

import sim
from benchmarks.fit_gap import fitted_published
from benchmarks.fit_phantoms import CENTRE, PLANES, RADII, stack
from emgface.face.quality import element_quality
from emgface.fit.images import combined_stacks, region_around
from emgface.fit.materials import Curve, fit_material
from emgface.fit.probing import Block, probe_forces
from emgface.fit.readers.surfaces import read_surface
from emgface.fit.registration import closest_points
from emgface.fit.similarity import Floats, Similarity, similarity, thin_plate
from emgface.fit.targets import Target, sheets
from emgface.fit.triangulated import Surface

DEPTHS: Final = np.linspace(0.3e-3, 1.5e-3, 5)  #: depths of an indentation [m]
SOFT: Final = {"c10": 2500.0, "c20": 1175.0, "kappa": 25e3}
PRESTRESS: Final = (15.9e3, 89.4e3)  #: smallest and largest published tension of the skin [Pa]


@dataclass(frozen=True)
class Row:
    """Quantity of a check: met if measured is at most, or at least, the wanted value."""

    check: int
    quantity: str
    measured: float
    wanted: float
    least: bool = False  #: the wanted value is a lower bound

    @property
    def met(self) -> bool:
        """False for NaN."""
        return bool(self.measured >= self.wanted if self.least else self.measured <= self.wanted)

    def cells(self) -> dict[str, Any]:
        """Cells of the table."""
        sign = "at least" if self.least else "at most"
        return {
            "check": self.check, "quantity": self.quantity, "measured": self.measured,
            "wanted": f"{sign} {self.wanted:g}", "met": "met" if self.met else "MISSED",
        }  # fmt: skip


def shared_models() -> Path:
    """Folder of the published models."""
    return Path(os.environ["EMGFACE_SHARED"]) / "artisynth_models"


def closed_forms(starts: int = 20) -> list[Row]:
    """Check 1: affine fields, a known similarity, and the published motion of the jaw."""
    rng = np.random.default_rng(1)
    at, elsewhere = 0.1 * rng.normal(size=(15, 3)), 0.2 * rng.normal(size=(50, 3))
    A, t = rng.normal(size=(3, 3)), rng.normal(size=3)
    affine = np.abs(thin_plate(at, at @ A.T + t, 1e-3)(elsewhere) - elsewhere @ A.T - t).max()
    R = Rotation.random(random_state=1).as_matrix()
    known = similarity(at, 1.3 * at @ R.T + t)
    off = max(
        abs(known.scale - 1.3), np.abs(known.rotation - R).max(), np.abs(known.shift - t).max()
    )
    bone = read_surface(shared_models() / "face_badin" / "badinjaw.obj", unit="m").surface
    text = (shared_models() / "jaw_tongue_face" / "XBadinJawToSymmetric.txt").read_text()
    rows = np.array([float(v) for v in text.strip(" []\n").split()]).reshape(4, 4)[:3]
    truth = Similarity(1.0, rows[:, :3], 1e-3 * rows[:, 3])
    aim, centre = Surface(truth(bone.points), bone.triangles), bone.points.mean(axis=0)
    turns, shifts = list[float](), list[float]()
    for _ in range(starts):
        axis = rng.standard_normal(3)
        axis *= np.radians(15.0) * rng.random() / np.linalg.norm(axis)
        turn = Rotation.from_rotvec(axis).as_matrix()
        shift = rng.uniform(-1.0, 1.0, 3) * 15e-3 / np.sqrt(3.0)
        start = Similarity(1.0, turn, centre + shift - turn @ centre)
        transform = closest_points(bone, aim, start)
        angle = Rotation.from_matrix(transform.rotation @ truth.rotation.T).magnitude()
        turns.append(float(np.degrees(angle)))
        shifts.append(1e3 * float(np.abs(transform(bone.points) - truth(bone.points)).max()))
    return [
        Row(1, "thin-plate spline of an affine field, error [m]", float(affine), 1e-9),
        Row(1, "similarity of a known motion, error [1, m]", float(off), 1e-12),
        Row(
            1, f"published motion of the jaw, worst of {starts} starts [degrees]", max(turns), 0.05
        ),
        Row(1, f"published motion of the jaw, worst of {starts} starts [mm]", max(shifts), 0.1),
    ]


def between_published() -> list[Row]:
    """Check 2: the reference fitted to the other published face, by 30 landmarks and two surfaces."""
    fit, truth = fitted_published(0)
    face, q = fit.source, fit.face["position"].values
    table = fit.distance[fit.distance["stage"] == "relaxed"].set_index("surface")
    quality = element_quality(q, face["connectivity"].values)
    before = element_quality(face["position"].values, face["connectivity"].values)
    with (shared_models() / "face_reference" / "derived" / "lip_ring_nodes.csv").open() as stream:
        lips = np.array([int(r["node"]) - 1 for r in csv.DictReader(stream) if int(r["ring"]) <= 5])
    skin = sheets(face)["skin"]
    mouth = skin.triangles[np.isin(skin.triangles, lips).all(axis=1)]
    lip = Target("lips", skin, Surface(truth, mouth))
    near = lip.surface.nearest(q[lips])
    inside = ~lip.surface.at_border(near)
    least = "smallest scaled Jacobian less that of the source"
    return [
        *(
            Row(2, f"{name}: mean distance [mm]", float(table.loc[name, "mean"]), 0.2)
            for name in table.index
        ),
        *(
            Row(2, f"{name}: 95 % of distances [mm]", float(table.loc[name, "q95"]), 0.7)
            for name in table.index
        ),
        Row(2, "lips: mean distance [mm]", 1e3 * float(near.distance[inside].mean()), 0.12),
        Row(
            2,
            "node to node, median [mm]",
            1e3 * float(np.median(np.linalg.norm(q - truth, axis=1))),
            1.9,
        ),
        Row(2, "elements with an inverted corner", float((quality.smallest_det <= 0.0).sum()), 0.0),
        Row(2, "hexahedra below 0.1", float((quality.scaled_jacobian < 0.1).sum()), 0.0),
        Row(
            2, least, float(quality.scaled_jacobian.min() - before.scaled_jacobian.min()), 0.0, True
        ),
    ]


def stacks_and_labels() -> list[Row]:
    """Check 4: three stacks of a phantom, with slices of 2 mm and moved between scans."""
    import SimpleITK

    rng, places = np.random.default_rng(3), np.vstack([np.eye(3), [1.0, 1.0, 0.0]])
    marks = CENTRE + 0.04 * places
    stacks, given, truth = list[Any](), list[Mapping[str, Any]](), list[tuple[Floats, Floats]]()
    for k, axes in enumerate(PLANES.values()):
        turn = Rotation.from_rotvec(0.05 * rng.standard_normal(3)).as_matrix() if k else np.eye(3)
        shift = 2e-3 * rng.standard_normal(3) if k else np.zeros(3)
        stacks.append(stack(np.array([0.32e-3, 0.32e-3, 2e-3]), axes, (turn, shift), seed=k)[0])
        noisy = marks @ turn.T + shift + 0.05e-3 * rng.standard_normal(marks.shape)
        given.append({f"f{i}": p for i, p in enumerate(noisy)})
        truth.append((turn, shift))
    image, motions = combined_stacks(stacks, given, 0.6e-3)
    inner = CENTRE + rng.uniform(-1.0, 1.0, (200, 3)) * RADII
    off = [
        1e3 * float(np.linalg.norm(motion(inner @ turn.T + shift) - inner, axis=1).mean())
        for motion, (turn, shift) in zip(motions[1:], truth[1:], strict=True)
    ]
    values = SimpleITK.GetArrayFromImage(image)
    index = np.argwhere(np.ones_like(values))[:, ::-1]
    D = np.array(image.GetDirection()).reshape(3, 3) * np.array(image.GetSpacing())
    points = 1e-3 * (index @ D.T + np.array(image.GetOrigin())).reshape(*values.shape, 3)
    parts = {
        "tongue": (0.6 * RADII, CENTRE + [0.0, 0.004, -0.003]),
        "airway": (0.25 * RADII, CENTRE + [0.005, -0.02, 0.012]),
    }
    rows = [Row(4, "registration of the stacks, worst error at other points [mm]", max(off), 0.2)]
    for name, (radii, centre) in parts.items():
        true = np.linalg.norm((points - centre) / radii, axis=-1) < 1.0
        clicks = centre + 0.7 * radii * np.concatenate([np.eye(3), -np.eye(3)])
        labelled = _labelled(image, clicks)
        dice = 2.0 * float((labelled & true).sum()) / float(labelled.sum() + true.sum())
        rows.append(Row(4, f"Dice of the {name}, {len(clicks)} clicks", dice, 0.95, True))
    return rows


def _labelled(image: Any, clicks: Floats, margin: float = 5e-3) -> Any:
    """Voxels of the region around clicks in the part of an image around them."""
    import SimpleITK

    at = np.array([image.TransformPhysicalPointToIndex((1e3 * p).tolist()) for p in clicks])
    more = np.ceil(1e3 * margin / np.array(image.GetSpacing())).astype(int)
    low = np.maximum(at.min(axis=0) - more, 0)
    high = np.minimum(at.max(axis=0) + more + 1, image.GetSize())
    part = SimpleITK.RegionOfInterest(image, (high - low).tolist(), low.tolist())
    mask = np.zeros(image.GetSize()[::-1], dtype=bool)
    own = tuple(slice(int(a), int(b)) for a, b in zip(low[::-1], high[::-1], strict=True))
    mask[own] = region_around(part, clicks.tolist())
    return mask


def probe_curves(repeats: int = 40) -> list[Row]:
    """Check 5: indentation and in-plane curves of known parameters with 3 % noise."""
    block = Block(elements=8)

    def model(directions: tuple[str, ...]) -> Callable[[Mapping[str, float]], dict[str, Floats]]:
        def forces(p: Mapping[str, float]) -> dict[str, Floats]:
            law = sim.MooneyRivlin(p.get("c10", SOFT["c10"]), p.get("c20", SOFT["c20"]))
            material = sim.Material(law, sim.QuadraticBulk(p.get("kappa", SOFT["kappa"])))
            tension = p.get("prestress", 0.0), p.get("across", 0.0)
            return probe_forces(block, material, dict.fromkeys(directions, DEPTHS), tension)

        return forces

    def fitted(
        truth: Mapping[str, float],
        start: Mapping[str, float],
        directions: tuple[str, ...],
        seed: int,
    ):
        rng, own = np.random.default_rng(seed), model(directions)
        curves = {
            name: Curve(DEPTHS, f * (1.0 + 0.03 * rng.standard_normal(len(f))))
            for name, f in own(truth).items()
        }
        return fit_material(own, start, curves)

    start = {"c10": 1000.0, "c20": 1000.0, "kappa": 1e5}
    two = fitted(SOFT, start, ("inward", "along"), 1)
    one = fitted(SOFT, start, ("inward",), 1)
    rows = [
        Row(5, "misfit of two curves over their rms force [1]", two.nrmse, 0.12),
        Row(
            5,
            "parameters identified by two directions, of 3",
            float(two.parameters["identified"].sum()),
            3.0,
            True,
        ),
        Row(
            5,
            "one indentation is said to identify kappa (0: no)",
            float(one.parameters.loc["kappa", "identified"]),
            0.0,
        ),
        *probe_coverage(repeats),
    ]
    for tension in PRESTRESS:
        fit = fitted({**SOFT, "prestress": tension, "across": tension},
                       {"prestress": 3e4, "across": 3e4}, ("along", "across"), 2)  # fmt: skip
        off = max(abs(fit[name] / tension - 1.0) for name in ("prestress", "across"))
        rows.append(
            Row(5, f"tension {tension / 1e3:g} kPa from two directions, error [1]", off, 0.1)
        )
    return rows


def probe_coverage(repeats: int) -> list[Row]:
    """Share of the intervals of 90 % with the truth: stretch of a strip, a law in closed form."""
    stretch, truth = np.linspace(1.05, 1.5, 12), {"c10": 2500.0, "c20": 1175.0}

    def strip(p: Mapping[str, float]) -> dict[str, Floats]:
        i1 = stretch**2 + 2.0 / stretch - 3.0
        return {"along": 2e-6 * (stretch - stretch**-2) * (p["c10"] + 2.0 * p["c20"] * i1)}

    clean, inside = strip(truth)["along"], list[bool]()
    for seed in range(repeats):
        rng = np.random.default_rng(seed)
        force = clean + 0.03 * clean.max() * rng.standard_normal(len(clean))
        curves = {"along": Curve(1e-3 * (stretch - 1.0), force)}
        table = fit_material(strip, {"c10": 1000.0, "c20": 1000.0}, curves).parameters
        inside += [
            bool(table.loc[k, "lower"] < v < table.loc[k, "upper"]) for k, v in truth.items()
        ]
    share = float(np.mean(inside))
    return [
        Row(
            5,
            f"coverage of intervals of 90 %, {repeats} repeats: distance from 0.9",
            abs(share - 0.9),
            0.05,
        )
    ]


def damaged(count: Callable[[int], int], inputs: int) -> list[Row]:
    """Check 6: ends of damaged inputs that are neither a located error nor a face near the person."""
    return [Row(6, f"silent or wrong ends of {inputs} damaged inputs", float(count(inputs)), 0.0)]
