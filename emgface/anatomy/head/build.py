"""Generated head of a person: its parts, attachments and contact pairs."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from typing import Final

import numpy as np
import xarray as xr

from emgface.anatomy.checked import CHECKS
from emgface.anatomy.head.model import (
    CONTACTS,
    FLOOR_MUSCLES,
    GROUP_SCHEMAS,
    PARTS,
    Head,
    build_lists,
)
from emgface.anatomy.head.scene import TONGUE
from emgface.anatomy.jaw.exciters import exciters_of
from emgface.anatomy.jaw.model import check_jaw
from emgface.anatomy.jaw.template import template_jaw
from emgface.anatomy.jaw.template.muscles import MUSCLE_GROUPS
from emgface.anatomy.tongue.model import attached_nodes
from emgface.anatomy.tongue.template.build import person, template_tongue
from emgface.anatomy.tongue.template.palate import palate
from emgface.errors import HeadError, listed
from emgface.face.parts import MANDIBLE, SKULL, Arch, Integers, arches_of
from emgface.face.quality import element_quality
from emgface.face.template import Measures, template_face
from emgface.face.template.muscles import Ring
from emgface.fit.registration import SmoothMap
from emgface.fit.similarity import similarity

HYOID = ("hyoid", "thyroid", "cricoid")
OWNER: Final = {"face": ("face",), "jaw": ("jaw", "hyoid"), "tongue": ("tongue",)}
"""Parts of a head that a model of a kind contains."""
SAME_FRAME: Final = 1e-6  #: largest difference of two frames that are the same [m, 1]


def build_head(
    parts: Sequence[str] = PARTS,
    *,
    preset: str = "adult",
    seed: int | None = None,
    measures: Mapping[str, float] | None = None,
    resolution: str | int = "coarse",
    tongue_resolution: str | int | None = None,
    contacts: Sequence[str] | None = None,
    rings: Mapping[str, Ring] | None = None,
    models: Mapping[str, xr.Dataset] | None = None,
) -> Head:
    """Generate the head of a person from named parts.

    Parameters
    ----------
    parts : of "face", "jaw", "tongue" and "hyoid". Bodies that are not named stay.
    preset, seed, measures
        As of the template face; measures may also be those of the jaw.
    resolution, tongue_resolution
        Of face and tongue, by default the same name.
    contacts : pairs of `emgface.anatomy.head.model.CONTACTS`, by default all of the named parts.
    rings : parts of orbicularis oris that differ from those of the template face.
    models : "face", "jaw" (with hyoid and larynx) or "tongue" in place of generated ones, such as parts
        fitted to one person in one frame.

    Raises
    ------
    HeadError
        A part or contact pair is unknown, models were fitted in different frames, or a part of a
        person is joined with generated ones.
    FaceError, JawError, TongueError
        As of the parts.
    """
    unknown = [part for part in parts if part not in PARTS]
    if unknown or not parts or len(set(parts)) < len(parts):
        wrong = unknown[0] if unknown else ",".join(parts)
        raise HeadError(f"parts {wrong!r}, expected different names of {', '.join(PARTS)}")
    named = [part for part in PARTS if part in parts]
    models = _checked(models or {}, named)
    who = {"preset": preset, "seed": seed}
    built = dict[str, xr.Dataset]()
    attachments = dict[str, Integers]()
    if "face" in named:
        own = {field.name for field in fields(Measures)}
        given = {k: v for k, v in (measures or {}).items() if k in own}
        face = models.get("face")
        if face is None:
            face = template_face(measures=given, resolution=resolution, rings=rings, **who)
        for bone, name in ((MANDIBLE, "face-jaw"), (SKULL, "face-skull")):
            attachments[name] = np.flatnonzero(face["fixed"].values == bone)
        built["face"] = face
    if "jaw" in named or "hyoid" in named:
        jaw = models.get("jaw")
        jaw = template_jaw(measures=measures, **who) if jaw is None else jaw
        built["jaw"] = moving(jaw, named)
    if "tongue" in named:
        size = resolution if tongue_resolution is None else tongue_resolution
        built["tongue"] = (
            models["tongue"]
            if "tongue" in models
            else template_tongue(measures=measures, resolution=size, **who)
        )
        for body, nodes in attached_nodes(built["tongue"]).items():
            attachments[f"tongue-{body}"] = nodes
    if "tongue" in built and "jaw" in built:
        built["jaw"] = without_floor_of(built["tongue"], built["jaw"])
    wanted = [p for p, needs in CONTACTS.items() if set(needs) <= set(named)]
    label = preset if seed is None else f"{preset}, volunteer {seed}"
    if models:
        label = ", ".join(str(model.attrs["name"]) for model in models.values())
    return build_lists(
        parts=built,
        named=named,
        attachments=attachments,
        contacts=wanted if contacts is None else contacts,
        shells=_shells(built, measures, preset, seed),
        name=f"{'head' if models else 'template head'} ({label}: {', '.join(named)})",
        origin="fitted" if _fitted(models) else "generated",
    )


def _fitted(models: Mapping[str, xr.Dataset]) -> bool:
    return any(model.attrs.get("origin") == "fitted" for model in models.values())


def _checked(models: Mapping[str, xr.Dataset], named: Sequence[str]) -> dict[str, xr.Dataset]:
    """Models of the named parts of one person in one frame; HeadError otherwise."""
    for part, model in models.items():
        if part not in OWNER or not set(OWNER[part]) & set(named):
            raise HeadError(
                f"a model of {part!r} is given, expected face, jaw or tongue, among the "
                f"parts {', '.join(named)}"
            )
        CHECKS[GROUP_SCHEMAS[part]](model)
    _check_one_person(models, named)
    frames = {
        part: np.array(json.loads(model.attrs["fit_frame"]))
        for part, model in models.items()
        if "fit_frame" in model.attrs
    }
    first = next(iter(frames), None)
    for part, frame in frames.items():
        if np.abs(frame - frames[str(first)]).max() > SAME_FRAME:
            raise HeadError(
                f"{first} and {part} were fitted in different frames, expected one: fit the {part} with "
                "the fitted face as its frame"
            )
    return dict(models)


def _check_one_person(models: Mapping[str, xr.Dataset], named: Sequence[str]) -> None:
    """Refuse parts of a person together with generated ones, which have the places of another."""
    fitted = [part for part, model in models.items() if model.attrs.get("origin") == "fitted"]
    others = [part for part, own in OWNER.items() if set(own) & set(named) and part not in fitted]
    if not fitted or not others:
        return
    given, absent = ([p for p in others if (p in models) == there] for there in (True, False))
    why = " and ".join(
        [f"the given {listed(given)} not"] * bool(given)
        + [f"the {listed(absent)} would be generated"] * bool(absent)
    )
    kept = [name for name in named if any(name in OWNER[part] for part in fitted)]
    files = " ".join(f"--model {part}=FILE" for part in others)
    raise HeadError(
        f"the {listed(fitted)} {'is' if len(fitted) == 1 else 'are'} fitted to a person, but {why}, "
        "with bones, teeth and attachments millimetres from those of the person; expected all parts "
        "of one person: by emgface fit, first the face, then the jaw with that face as --frame and the "
        f"tongue with that jaw as --frame; give {files}, or build only --parts {','.join(kept)}"
    )


def without_floor_of(tongue: xr.Dataset, jaw: xr.Dataset) -> xr.Dataset:
    """Jaw whose geniohyoid and mylohyoid have the force that those of a tongue lack.

    Both are the same muscles of the same person: their largest forces add up to those of the jaw. The
    tissue of the tongue alone pulls with a quarter of them, sigma_max sum_e w_e V_e / l over its
    elements e with the shares w, for fibres of mean length l, and it has no active force where the floor
    is stretched by half, whereas the lines of a jaw span it. The published coupled model replaces the
    lines (Stavness et al., section 11.2.1.5).
    """
    force = jaw["muscle_force_max"].values.copy()
    names = [str(m) for m in jaw["muscle"].values]
    for muscle, lines in FLOOR_MUSCLES.items():
        for side in ("_L", "_R"):
            own = [k for k, name in enumerate(names) if name in {line + side for line in lines}]
            whole = force[own].sum()
            if own:
                share = min(floor_force(tongue, muscle + side) / whole, 1.0)
                force[own] *= 1.0 - share
    return jaw.assign(muscle_force_max=("muscle", force, jaw["muscle_force_max"].attrs))


def floor_force(tongue: xr.Dataset, muscle: str) -> float:
    """Force [N] of a muscle of a tongue along its fibres, with the stress of `TONGUE`."""
    number = [str(m) for m in tongue["muscle"].values].index(muscle)
    own = tongue["bundle_muscle"].values == number
    volume = element_quality(tongue["position"].values, tongue["connectivity"].values).volume
    shares = tongue["bundle_weight"].values[own] * volume[tongue["bundle_index"].values[own]]
    lines = np.flatnonzero(tongue["fibre_muscle"].values == number)
    points = [tongue["fibre_position"].values[tongue["fibre_of_point"].values == k] for k in lines]
    lengths = [np.linalg.norm(np.diff(x, axis=0), axis=1).sum() for x in points]
    return float(TONGUE.sigma_max * shares.sum() / np.mean(lengths))


def moving(jaw: xr.Dataset, named: Sequence[str], without: Sequence[str] = ()) -> xr.Dataset:
    """Jaw model in which only the named bodies move, without muscles of some names.

    Muscles, springs and joints between bodies that stay are omitted.
    """
    moves = jaw["body_moves"].values.copy()
    for k, body in enumerate(jaw["body"].values):
        owner = "hyoid" if body in HYOID else str(body)
        moves[k] = bool(moves[k]) and owner in named
    on = moves.astype(bool)
    guided = on[jaw["point_body"].values][jaw["joint_point"].values]
    hinged = on[jaw["joint_body_b"].values]
    other = np.where(jaw["joint_point"].values >= 0, guided, hinged)
    plain = np.array([str(m)[:-2] for m in jaw["muscle"].values])
    kept = {
        "muscle": on[jaw["muscle_body"].values].any(axis=1) & ~np.isin(plain, without),
        "spring": on[jaw["spring_body"].values].any(axis=1),
        "joint": on[jaw["joint_body"].values] | other,
    }
    if moves.all() and all(chosen.all() for chosen in kept.values()):
        return jaw
    model = jaw.assign(body_moves=("body", moves, jaw["body_moves"].attrs))
    model = model.isel({dim: np.flatnonzero(chosen) for dim, chosen in kept.items()})
    muscles = [str(m) for m in model["muscle"].values]
    exciters = exciters_of(muscles, MUSCLE_GROUPS)
    gain = np.array([[own.get(m, 0.0) for m in muscles] for own in exciters.values()])
    model = model.drop_vars(["exciter_gain", "exciter"]).assign_coords(exciter=list(exciters))
    model["exciter_gain"] = (
        ("exciter", "muscle"),
        gain.reshape(-1, len(muscles)),
        {"units": "1"},
    )
    return check_jaw(model)


def _shells(
    parts: Mapping[str, xr.Dataset],
    measures: Mapping[str, float] | None,
    preset: str,
    seed: int | None,
) -> dict[str, Arch]:
    """Teeth, those of the face if there is one, and the palate if there is a tongue."""
    if "face" not in parts and "tongue" not in parts:
        return {}
    places, arches = person(measures, preset, seed)
    teeth = arches_of(parts["face"]) if "face" in parts else arches
    shells = {"mandible" if arch.bone == MANDIBLE else "maxilla": arch for arch in teeth}
    if "tongue" in parts:
        shells["palate"] = _with_teeth(palate(places, arches), arches, teeth)
    return shells


def _with_teeth(roof: Arch, before: Sequence[Arch], after: Sequence[Arch]) -> Arch:
    """Palate moved as the teeth of a fitted face were."""
    one, two = ({a.bone: a.points for a in arches}[SKULL] for arches in (before, after))
    if one.shape != two.shape or np.array_equal(one, two):
        return roof
    pick = np.arange(0, len(one), max(1, len(one) // 500))
    moved = SmoothMap.through(
        similarity(one[pick], two[pick]), one[pick], two[pick], np.full(len(pick), 0.5e-3)
    )
    return replace(roof, points=moved(roof.points))
