"""Outcome of the fit of one input: a located error, or a face near to or far from its person.

A face is near its person if the skin is, and if every named point (markers of lips and face, margins
of the lips, tips of nose and chin) is at its place: a mirrored face, or one from exchanged landmarks,
has nearly the same skin, but points elsewhere. A tip is where the skin is most anterior, which is not
determined along a flat chin; the distance of its place from the fitted skin is judged.
"""

import json
from typing import Any, Final

import numpy as np
import xarray as xr

from benchmarks.fit_inputs import Person
from emgface.errors import EmgfaceError
from emgface.face.validity import check_face
from emgface.fit.inputs import points_of_face
from emgface.fit.measures import distances
from emgface.fit.person import fit_face
from emgface.fit.similarity import rigid_of
from emgface.fit.targets import Target, sheets
from emgface.fit.triangulated import Surface

NEAR: Final = "near"
DOUBTED: Final = "doubted"  #: before near or far
REFUSED: Final = "refused"
BAD: Final = ("far", "defect", "unlocated")  #: ends that are a defect: nothing was reported
TIPS: Final = ("pronasale", "pogonion")
SKIN: Final = 1.2  #: mean distance from the skin of the person beyond which a face is far [mm]
POINT: Final = 4.0
"""Distance of a named point from its place beyond which a face is far [mm]: five times the noise."""


def end_of(generic: xr.Dataset, person: Person, marks: Any, skin: Any) -> str:
    """End of a fit and, after a colon, what was measured or reported."""
    try:
        fit = fit_face(generic, marks, skin=skin, simulated=True)
        check_face(fit.face)
    except EmgfaceError as error:
        located = ":" in str(error) and len(str(error)) > 40
        return f"{REFUSED if located else 'unlocated'}: {error}"
    except Exception as error:
        return f"defect: {type(error).__name__}: {error}"
    return judged(fit.face, person, fit.doubts)


def judged(face: xr.Dataset, person: Person, doubts: tuple[str, ...]) -> str:
    """End of a fit that gave a face."""
    skin, point = apart(face, person)
    end = NEAR if skin <= SKIN and point <= POINT else "far"
    heading = f"{DOUBTED}, {end}" if doubts else end
    return f"{heading}: skin {skin:.2f} mm, points {point:.1f} mm{'; '.join(('', *doubts))}"


def apart(face: xr.Dataset, person: Person) -> tuple[float, float]:
    """Mean distance of the skin, and largest of the named points, of a fitted face [mm]."""
    to_face = rigid_of(np.array(json.loads(face.attrs["fit_frame"])))
    skin = person.surface()
    target = Target("skin", sheets(face)["skin"], Surface(to_face(skin.points), skin.triangles))
    wanted, fitted = points_of_face(person.face), points_of_face(face)
    names = sorted(wanted.keys() & fitted.keys())
    there = to_face(person.moved(np.array([wanted[n] for n in names])))
    off = np.linalg.norm(np.array([fitted[n] for n in names]) - there, axis=1)
    own = sheets(face)["skin"].at(face["position"].values).nearest(there).distance
    off = np.where(np.isin(names, TIPS), own, off)
    return distances(target, face["position"].values)["mean"], 1e3 * float(off.max())
