"""Page of the live face: data of the surface, muscles, presets and curves for the browser."""

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import xarray as xr
from markupsafe import Markup

from emgface.face.muscle_force import fibre_lengths
from emgface.muscles import INSTRUCTIONS, MUSCLE_NAMES, RELEVANT
from emgface.pictures.body import Skin, body_of
from emgface.pictures.encoding import body_data, deltas, middle_of, whole
from emgface.pictures.lips import lips_at_rest
from emgface.pictures.page import Exact, as_json, environment, policy, style, viewer_script
from emgface.pictures.page import resource as packaged
from emgface.pictures.render import VIEWS
from emgface.pictures.suture import treatment_words
from emgface.view.curves import Curves
from emgface.view.frames import FRAME_NUMBERS
from emgface.view.moving import Moving
from emgface.view.workspace import Workspace

PRESET: Final = 0.3  #: activation of the muscles of an instruction (Table 1 of Eskes et al. 2017)


def live_page(
    face: xr.Dataset,
    skin: Skin,
    moving: Moving,
    *,
    words: str,
    sliders: bool,
    edits: bool,
    curves: Curves | None = None,
    workspace: Workspace | None = None,
) -> str:
    """Write the page of the live face as HTML; it connects to the server that it comes from.

    `words` states the origin of the activations, `sliders` and `edits` whether sliders act and curves
    can be edited, and `curves` are shown at first, or those of a `workspace` with its view and notes.
    """
    from emgface import __version__

    rest = face["position"].values[skin.node]
    centre = middle_of(rest)
    muscles = list(moving.muscles)
    curves = workspace.curves if workspace and workspace.curves else curves
    forces: list[str] = []
    if edits:
        known = np.isfinite(fibre_lengths(face))
        forces = [m for m, one in zip(muscles, known, strict=True) if one]
    live: dict[str, Any] = {
        "forces": forces,
        "muscles": muscles,
        "names": [MUSCLE_NAMES.get(stem_of(m), m) for m in muscles],
        "presets": presets(muscles),
        "head": list(FRAME_NUMBERS),
        "markers": face.sizes["marker"],
        "rest": deltas(whole(rest[None], centre)),
        "real_time": moving.real_time,
        "sliders": sliders,
        "edits": edits,
        "words": words,
        "curves": as_message(curves) if curves else {},
        "workspace": workspace and {"view": workspace.view, "notes": Exact(workspace.notes)},
    }
    data = body_data(body_of(face, skin), rest)
    data |= {"markers": [str(m) for m in face["marker"].values], "live": live}
    script = viewer_script(view_resource("live.js"))
    return environment("emgface.view").get_template("live.html").render(
        title=str(face.attrs.get("name", "")) or "face",
        words=words,
        lips=f"{lips_at_rest(face)} {treatment_words(face)}".strip(),
        viewer=as_json(data),
        views=VIEWS,
        version=__version__,
        style=style(),
        own_style=Markup(view_resource("live.css")),
        script=Markup(script),
        policy=policy(script, connects=True),
    )  # fmt: skip


def as_message(curves: Curves) -> dict[str, Any]:
    """Curves as JSON for the page."""
    return {
        "knots": {name: rows.tolist() for name, rows in curves.knots.items()},
        "duration": curves.duration,
        "interpolation": curves.interpolation,
    }


def presets(muscles: list[str]) -> Mapping[str, Any]:
    """Activations of the muscles that are relevant for each instruction, by its letter."""
    return {
        letter: {
            "name": INSTRUCTIONS[letter],
            "levels": [PRESET if stem_of(m) in own else 0.0 for m in muscles],
        }
        for letter, own in RELEVANT.items()
        if np.any([stem_of(m) in own for m in muscles])
    }


def stem_of(muscle: str) -> str:
    """Name of a muscle without its side."""
    stem, _, side = muscle.rpartition("_")
    return stem if stem and side in ("L", "R") else muscle


def view_resource(name: str) -> str:
    """Text of a file of this package's pages."""
    return packaged(f"page/{name}", "emgface.view")
