"""Generated jaw model of the person of a face."""

from collections.abc import Mapping
from dataclasses import asdict, fields

import numpy as np
import xarray as xr
from numpy.typing import NDArray

import sim
from emgface.anatomy.jaw.exciters import exciters_of
from emgface.anatomy.jaw.model import JawBody, build_jaw
from emgface.anatomy.jaw.template.bones import BoneSurface, surfaces
from emgface.anatomy.jaw.template.joints import joints, springs
from emgface.anatomy.jaw.template.landmarks import landmarks
from emgface.anatomy.jaw.template.measures import JAW_NORMS, jaw_measures
from emgface.anatomy.jaw.template.muscles import MIRROR, MUSCLE_GROUPS, muscle_lines
from emgface.face.template.arches import dental_arches
from emgface.face.template.measures import Measures
from emgface.face.template.volunteers import preset_measures, random_measures

Floats = NDArray[np.float64]

MASSES = {"jaw": 0.2, "hyoid": 0.01, "thyroid": 0.024, "cricoid": 0.023}
"""Masses with the soft tissue that moves along, of an adult man [kg] (Stavness et al. 2006, section
2.2); others scale with the cube of the size of the face."""
BODY_DAMPING = 10.0, 1e-4
"""Damping of every body by the tissue about it, of translation [kg/s] and rotation [kg m^2/s] (as
there)."""
CERVICAL = -12e-3, 2e-3
"""Centre of the rotation of the head behind and above the condyles [m]: the joint of skull and
atlas."""


def template_jaw(
    *,
    measures: Mapping[str, float] | None = None,
    preset: str = "adult",
    seed: int | None = None,
    name: str = "",
) -> xr.Dataset:
    """Generate jaw, hyoid and larynx of the person whose face has the same preset, seed and measures.

    Parameters
    ----------
    measures : mapping, optional
        Measures of the face or of the jaw that replace those of the preset or of the random volunteer
        [m]; `emgface.anatomy.jaw.template.JAW_NORMS` describes those of the jaw.
    preset, seed
        As `emgface.face.template.template_face`.
    name : str
        Name of the model; default: preset and seed.

    Returns
    -------
    xarray.Dataset
        Of schema jaw_model, origin "generated", in the frame of the generated face: y = 0 at the
        tragia, z = 0 between the lips. It is exactly symmetric also for an asymmetric face. The
        measures of the jaw are attributes.

    Raises
    ------
    JawError
        A measure does not exist or is out of bounds, or the condyles do not fit the face.
    FaceError
        A measure of the face is impossible, or the preset unknown.

    Notes
    -----
    Sources: `emgface.anatomy.jaw.template.measures` (norms), `muscles` (attachments and strength).
    """
    given = dict(measures or {})
    own = {field.name for field in fields(Measures)}
    drawn = preset_measures(preset) if seed is None else random_measures(seed, preset=preset)
    face = drawn.with_values({k: v for k, v in given.items() if k in own})
    jaw = jaw_measures(face, preset, {k: v for k, v in given.items() if k not in own})
    arches = dental_arches(face)
    places = landmarks(face, jaw, arches)
    shapes = surfaces(places, jaw, arches)
    muscles = muscle_lines(places)
    scale = jaw.condyle_distance / (1e-3 * _norm("condyle_distance"))
    return build_jaw(
        bodies=_bodies(shapes, scale),
        muscles=muscles,
        springs=springs(places, jaw),
        joints=joints(places, jaw),
        points=_points(places),
        exciters=exciters_of([m.name for m in muscles], MUSCLE_GROUPS),
        surfaces=[(s.body, s.points, s.triangles) for s in shapes],
        name=name
        or f"template jaw ({preset}" + ("" if seed is None else f", volunteer {seed}") + ")",
        origin="generated",
        source="emgface.anatomy.jaw.template",
        attrs={
            "preset": preset,
            "seed": "" if seed is None else seed,
            **{f"measure_{key}": value for key, value in asdict(jaw).items()},
        },
    )


def _norm(name: str) -> float:
    return next(norm.men[0] for norm in JAW_NORMS if norm.name == name)


def _points(places: Mapping[str, Floats]) -> dict[str, tuple[str, Floats]]:
    middle = np.array([0.0, 1.0, 1.0])
    points = {
        "lower_incisor": ("jaw", places["incisor"]),
        "upper_incisor": ("skull", places["upper_incisor"]),
        "hyoid": ("hyoid", places["hyoid"]),
        "thyroid": ("thyroid", places["notch"]),
        "head_centre": ("skull", places["condyle"] * middle + [0.0, *CERVICAL]),
    }
    for name, landmark in (("condyle", "condyle"), ("bite", "molar")):
        points |= {
            f"{name}{side}": ("jaw", places[landmark] * mirror) for side, mirror in MIRROR.items()
        }
    return points


def _bodies(shapes: list[BoneSurface], scale: float) -> list[JawBody]:
    """Bodies with the stated masses, uniformly distributed within the first surface of each."""
    bodies = [JawBody("skull", moves=False), JawBody("sternum", moves=False)]
    for name, adult in MASSES.items():
        shape = next(s for s in shapes if s.body == name)
        unit = sim.body_of_surface(name, shape.points, shape.triangles.astype(np.int64), 1.0)
        mass = adult * scale**3
        assert unit.inertia is not None  # the surface gave it
        inertia = np.array(unit.inertia) * mass / unit.mass
        inertia[0, 1:] = inertia[1:, 0] = 0.0  # exactly symmetric, as the surface is up to rounding
        centre = np.array(unit.centre) * [0.0, 1.0, 1.0]
        bodies.append(JawBody(name, mass, centre, inertia, BODY_DAMPING))
    return bodies
