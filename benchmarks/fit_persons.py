"""Check 3 of a fit: generated persons fitted to the next one, and where their motions differ.

The markers of a fitted face under orbicularis oris 0.5 are compared with those of the person's own mesh,
whose nodes correspond. One ingredient of the fitted face at a time is replaced by that of the person.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from benchmarks.fit_checks import Row
from benchmarks.fit_inputs import MOTION, Person, person_of
from benchmarks.report import markdown, say
from emgface.errors import EmgfaceError
from emgface.face.template import template_face
from emgface.face.template.grid import LAYER_COUNT
from emgface.fit.carry import carry
from emgface.fit.inputs import points_of_face
from emgface.fit.person import Fitted, fit_face
from emgface.fit.similarity import Floats, similarity

Moves = Callable[[xr.Dataset], Floats]

WANTED = 0.3  #: difference of the markers [mm]
DETAILED = 6  #: number of persons with all ingredients, which take two thirds of the time
BEYOND, LENGTH = 1.5e-3, 30e-3
"""Deviation along each axis, and length, of the smooth field of persons outside the family [m]."""


def between_persons(moved: Moves, persons: int, resolution: str = "coarse") -> list[Row]:
    """Rows of check 3; the table of all ingredients is printed."""
    base = moved(template_face(resolution=resolution))
    differences: list[dict[str, float]] = []
    for k in range(persons):
        differences.append(of_person(moved, base, k, resolution, detailed=k < DETAILED))
        say(f"person {k + 1}: " + ", ".join(f"{n} {v:.2f}" for n, v in differences[-1].items()))
    table = pd.DataFrame(differences)
    summary = pd.DataFrame(
        {"markers [mm rms]": table.columns, "mean": table.mean().values,
         "smallest": table.min().values, "largest": table.max().values,
         "persons": table.count().values, "within 0.3 mm": (table <= WANTED).sum().values}
    )  # fmt: skip
    print(markdown(summary, ".2f"), "\n", flush=True)
    own = table["fitted"]
    return [
        Row(3, f"markers of {persons} persons, mean of the rms [mm]", float(own.mean()), WANTED),
        Row(3, "the same, largest person [mm]", float(own.max()), WANTED),
        Row(3, "share of persons nearer than the generic face", float((own < table["generic"]).mean()),
            1.0, True),
    ]  # fmt: skip


def of_person(
    moved: Moves, base: Floats, k: int, resolution: str, *, detailed: bool
) -> dict[str, float]:
    """Differences of the markers [mm rms] of person k, fitted to the next, by what is compared."""
    one, other = person_of(100 + k, resolution), person_of(101 + k, resolution)
    nodes, wanted = one.face["marker_node"].values, other.face["position"].values
    own = moved(other.face)[nodes]

    def apart(field: Floats, there: Floats = own) -> float:
        return _rms(field[nodes] - there)

    plain = without_measures(one.face)
    fit = fitted_to(one.face, other)
    q = in_frame(fit, wanted)
    layers = true_layers(other.face, q)
    rows = {
        "generic": apart(base),
        "unfitted": apart(moved(one.face)),
        "fitted": apart(moved(carry(fit.face, q).face)),
        "fitted, true depth of the layers": apart(moved(carry(fit.face, layers).face)),
        "fitted without measures": _difference(moved, plain, other, own),
    }
    if not detailed:
        return rows
    rows["fitted to the skin only"] = _difference(moved, one.face, other, own, ("skin",))
    rows["fitted nodes, the rest true"] = apart(moved(carry(other.face, q).face))
    rows["true nodes, the rest fitted"] = apart(moved(carry(fit.face, wanted).face))
    alone = fitted_to(plain, other)
    rows["without measures: fitted nodes, the rest true"] = apart(
        moved(carry(other.face, in_frame(alone, wanted)).face)
    )
    mixed = carry(one.face, wanted).face
    rows["without measures: true nodes"] = apart(moved(mixed))
    mixed["fixed"] = other.face["fixed"]
    rows["without measures: true nodes and attachments"] = apart(moved(mixed))
    mixed = other.face.assign(fixed=one.face["fixed"])
    rows["without measures: true nodes and muscles"] = apart(moved(mixed))
    far = beyond(other, k)
    there = moved(far.face)[nodes]
    for name, face in (("fitted", one.face), ("fitted without measures", plain)):
        rows[f"outside the family: {name}"] = _difference(moved, face, far, there)
    return rows


def true_layers(face: xr.Dataset, q: Floats) -> Floats:
    """Nodes q (n, 3) with the shares of the layers in the thickness of a generated face [m]."""
    shape = int(face.attrs["rays"]), int(face.attrs["rings"]) + 1, LAYER_COUNT + 1, 3
    own, new = face["position"].values.reshape(shape), q.reshape(shape).copy()
    depth = np.linalg.norm(own - own[:, :, :1], axis=-1, keepdims=True)
    share = depth / depth[:, :, -1:]
    return (new[:, :, :1] + share * (new[:, :, -1:] - new[:, :, :1])).reshape(-1, 3)


def without_measures(face: xr.Dataset) -> xr.Dataset:
    """Face that states no measures, whose fit is a deformation alone."""
    kept = {k: v for k, v in face.attrs.items() if not k.startswith("measure_")}
    copied = face.copy()
    copied.attrs = kept
    return copied


def fitted_to(
    face: xr.Dataset, other: Person, names: tuple[str, ...] = ("skin", "inner")
) -> Fitted:
    """Fit of a face to landmarks and surfaces of a person."""
    scans = {name: other.surface(name) for name in names}
    given: dict[str, Any] = {name: (s.points, s.triangles) for name, s in scans.items()}
    return fit_face(face, other.landmarks, rim="inner" in names, simulated=True, **given)


def in_frame(fit: Fitted, wanted: Floats) -> Floats:
    """Nodes of a fitted face in the frame of nodes (n, 3) of the person, by a rigid motion [m]."""
    q = fit.face["position"].values
    return similarity(q, wanted, scaled=False)(q)


def beyond(person: Person, seed: int) -> Person:
    """Person deformed by a smooth random field, who is not of the family of the generated faces."""
    rng = np.random.default_rng(seed)
    X = person.face["position"].values
    waves, phase = rng.standard_normal((200, 3)) / LENGTH, rng.uniform(0.0, 2.0 * np.pi, 200)
    field = np.cos(X @ waves.T + phase) @ rng.standard_normal((200, 3)) * np.sqrt(2.0 / 200.0)
    face = carry(person.face, X + BEYOND * field).face
    marks = {name: p @ MOTION[0].T + MOTION[1] for name, p in points_of_face(face).items()}
    return Person(face, marks)


def _difference(
    moved: Moves,
    face: xr.Dataset,
    other: Person,
    own: Floats,
    names: tuple[str, ...] = ("skin", "inner"),
) -> float:
    try:
        fit = fitted_to(face, other, names)
    except EmgfaceError as error:
        say(f"no face: {error}")
        return float("nan")
    q = in_frame(fit, other.face["position"].values)
    return _rms(moved(carry(fit.face, q).face)[face["marker_node"].values] - own)


def _rms(apart: Floats) -> float:
    return 1e3 * float(np.sqrt((apart**2).sum(axis=1).mean()))


def thickness_coverage(persons: int, resolution: str = "coarse") -> Row:
    """Share of the columns whose thickness lies in the interval of 90 % of a fit to the skin alone."""
    generic, shares = template_face(resolution=resolution), []
    for k in range(persons):
        other = person_of(200 + k, resolution)
        thickness = fitted_to(generic, other, ("skin",)).thickness
        nodes = other.face["position"].values
        skin, inner = nodes[thickness["node"]], nodes[thickness["inner_node"]]
        true = 1e3 * np.linalg.norm(skin - inner, axis=1)
        shares.append(float(((thickness["low"] <= true) & (true <= thickness["high"])).mean()))
        say(f"person {k + 1}: {shares[-1]:.3f} of {len(true)} thicknesses within their intervals")
    say(f"smallest {min(shares):.3f}; {sum(s >= 0.9 for s in shares)} of {persons} at least 0.9")
    mean = float(np.mean(shares))
    return Row(3, f"thicknesses of {persons} persons within intervals of 90 %", mean, 0.9, True)
