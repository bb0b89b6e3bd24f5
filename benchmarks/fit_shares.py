"""Shares of wrong proportions, and of surfaces of two persons, that a fit doubts before it begins.

Landmarks have 0.8 mm of noise. One axis of the face is scaled by a percentage, up and down, as by a
wrong distance of slices: of the landmarks (and the skin with them, if it is given), or of the skin
alone. Proportions are judged by the landmarks. The inner surface or bone of another person is given
with the skin of the first.
"""

import numpy as np
import pandas as pd
import xarray as xr

from benchmarks.fit_inputs import Person, person_of
from benchmarks.report import markdown, say
from emgface.errors import FitError
from emgface.face.parts import FREE
from emgface.face.template import template_face
from emgface.fit.deform import LANDMARK_NOISE
from emgface.fit.inputs import match, points_of_face
from emgface.fit.person import compared_inputs, scan_of
from emgface.fit.readers.landmarks import landmarks_of
from emgface.fit.similarity import Floats
from emgface.fit.targets import sheets

PERCENT = (0, 5, 10, 15, 20, 25, 30)  #: by which one axis is larger (or landmarks also smaller)
AXES = ("width", "depth", "height")


def shares(persons: int, first: int = 300) -> pd.DataFrame:
    """Print and return the share [1] that is refused or doubted, by what is wrong and by how much."""
    generic = template_face(resolution="coarse")
    group = [person_of(first + k) for k in range(persons)]
    named = points_of_face(generic)
    rows: list[dict[str, object]] = []
    for axis, name in enumerate(AXES):
        scaled: dict[str, object] = {"scaled": "landmarks, with or without skin", "axis": name}
        alone: dict[str, object] = {"scaled": "skin alone", "axis": name}
        for percent in PERCENT:
            wrong = np.ones(3)
            wrong[axis] = 1.0 + percent / 100.0
            own = [noisy(person, k, wrong**s) for k, person in enumerate(group) for s in (1, -1)]
            scaled[f"{percent} %"] = float(np.mean([matched(named, marks) for marks in own]))
            ends = [of_skin(generic, person, k, wrong) for k, person in enumerate(group)]
            alone[f"{percent} %"] = float(np.mean(ends))
        rows += [scaled, alone]
        say(str(rows[-2:]))
    table = pd.DataFrame(rows)
    print(markdown(table, ".2f"), "\n", flush=True)
    for kind in ("inner", "bone"):
        for what, step in (("own", 0), ("of the next person", 1), ("of the ninth person", 9)):
            ends = [
                beneath(generic, person, group[(k + step) % persons], k, kind)
                for k, person in enumerate(group)
            ]
            say(f"{kind} {what}: {np.mean(ends):.2f} of {persons} reported")
    return table


def matched(named: dict[str, Floats], marks: dict[str, Floats]) -> bool:
    """Test whether landmarks are refused or doubted by themselves."""
    try:
        return bool(match(named, landmarks_of(marks), None, LANDMARK_NOISE, "face").notes)
    except FitError:
        return True


def of_skin(generic: xr.Dataset, person: Person, seed: int, factors: Floats) -> bool:
    """Test whether a scaled skin is reported with landmarks that are not scaled."""
    q, triangles = person.face["position"].values, sheets(person.face)["skin"].triangles
    return is_reported(generic, noisy(person, seed, np.ones(3)), {"skin": (q * factors, triangles)})


def beneath(generic: xr.Dataset, person: Person, other: Person, seed: int, kind: str) -> bool:
    """Test whether the skin of one person with the inner surface or bone of another is reported."""
    q, own = person.face["position"].values, sheets(person.face)["skin"]
    inner = sheets(other.face)["inner"].triangles
    if kind == "bone":
        constrained = other.face["fixed"].values != FREE
        inner = inner[constrained[inner].all(axis=1)][:, ::-1]
    given = {"skin": (q, own.triangles), kind: (other.face["position"].values, inner)}
    return is_reported(generic, noisy(person, seed, np.ones(3)), given)


def noisy(person: Person, seed: int, factors: Floats) -> dict[str, Floats]:
    """Landmarks in the frame of the face, with their noise."""
    rng = np.random.default_rng(seed)
    points = points_of_face(person.face)
    return {n: factors * (p + LANDMARK_NOISE * rng.standard_normal(3)) for n, p in points.items()}


def is_reported(generic: xr.Dataset, marks: dict[str, Floats], given: dict[str, object]) -> bool:
    """Test whether inputs are refused or doubted before the fit."""
    try:
        scans = {kind: scan_of(one, None, kind) for kind, one in given.items()}
        return bool(
            compared_inputs(generic, landmarks_of(marks), None, scans, False, LANDMARK_NOISE)[2]
        )
    except FitError:
        return True
