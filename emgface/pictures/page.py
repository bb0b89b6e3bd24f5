"""Pages with a moving face: encoding as JSON, and pages of a single motion or face."""

import base64
import hashlib
import io
import json
import re
from collections.abc import Mapping
from importlib.resources import files
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import xarray as xr
from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from numpy.typing import NDArray

from analysis.figures.style import SAVED_PARAMETERS, settings, title_of
from analysis.tables import ABSENT_CELL, Table
from emgface.characters import isolated
from emgface.errors import DataError
from emgface.muscles import INSTRUCTIONS
from emgface.pictures.body import body_of, skin_of
from emgface.pictures.encoding import (
    body_data,
    deltas,
    levels,
    measured_markers,
    middle_of,
    muscle_names,
    packed,
    scaling,
    whole,
)
from emgface.pictures.lips import lips_at_rest, lips_of_motion
from emgface.pictures.notes import Notes
from emgface.pictures.picking import pick_data
from emgface.pictures.render import VIEWS
from emgface.pictures.surface import drawn_surface
from emgface.pictures.suture import treatment_words

#: number of columns above which a table is printed smaller, or upright if it is low
WIDE: Final = 12
LOW: Final = 6  #: largest number of rows of a table that is printed upright
THREE: Final = "three/three.module.min.js"
"""three.js 0.170.0, build/three.module.min.js, unchanged."""
if TYPE_CHECKING:
    from matplotlib.figure import Figure


def face_page(face: xr.Dataset) -> str:
    """Write the interactive page of a face_model at rest."""
    skin = skin_of(face)
    rest = face["position"].values[skin.node]
    centre = middle_of(rest)
    markers = whole(face["position"].values[face["marker_node"].values][None], centre)
    about = f"{face.sizes['node']} nodes, {face.sizes['element']} elements. {lips_at_rest(face)}".strip()
    trial = _trial(rest[None], markers, np.zeros(1), centre, about)
    data = body_data(body_of(face, skin), rest) | _single(trial, face["marker"].values)
    data["pick"] = pick_data(face, skin)
    kind = str(face.attrs["origin"]).rpartition(", ")[2]
    words = f"The face model {face.attrs['name']} at rest, {kind} ({face.attrs['source']})."
    words = f"{words} {treatment_words(face)}".strip()
    return page_of(data, title=str(face.attrs["name"]), badge=f"{kind} face", words=words,
                   simulated=False)  # fmt: skip


def motion_page(
    motion: xr.Dataset,
    activation: xr.Dataset | None = None,
    *,
    aligned: xr.Dataset | None = None,
    scores: xr.Dataset | None = None,
    compared: xr.Dataset | None = None,
) -> str:
    """Write the page of one simulated motion as HTML without network requests.

    `motion` is a trajectory with surface, without which DataError is raised. `activation` (muscle,
    time), the measured markers `aligned` with it (`analysis.align.align`), their `scores`, and the
    markers of a `compared` trajectory are shown under the same time cursor.
    """
    body, _, frames = drawn_surface(motion)
    centre = middle_of(frames[0])
    trial = _motion_trial(motion, frames, centre)
    data = body_data(body, frames[0]) | _single(trial, motion["marker"].values)
    data["forces"] = force_names(motion)
    origin, driven = "", ""
    if activation is not None:
        pace, start = motion.attrs["recorded_pace"], motion.attrs["recorded_start"]
        trial["activation"] = levels(
            activation["activation"], start + pace * motion["frame_time"].values
        )
        data["muscles"] = muscle_names(activation["muscle"].values)
        data["scaling"] = scaling(activation)
        origin, driven = driven_by(activation)
    if aligned is not None:
        origin = str(aligned.attrs.get("origin", origin))
        sampled = motion.sel(time=motion["frame_time"].values, method="nearest")
        trial["measured"] = deltas(whole(measured_markers(aligned, sampled), centre))
    if scores is not None:
        trial["about"] += f" {_scored(scores)}"
    if compared is not None:
        _, _, others = drawn_surface(compared)
        same = set(compared["marker"].values) == set(motion["marker"].values)
        if others.shape[1:] != frames.shape[1:] or not same:
            raise DataError(
                "the compared motion is of another face, expected two motions of one face: simulate "
                "both with the same face and --surface"
            )
        second = _motion_trial(compared.sel(marker=motion["marker"].values), others, centre)
        names = _two_names(trial_name(motion), trial_name(compared))
        if force_names(compared) != data["forces"]:
            second.pop("forces", None)
        trial["strategy"], second["strategy"] = names
        data["trials"].append(second)
        data["strategies"] = list(names)
    title = trial_name(motion)
    words = f"The motion of the face is simulated by a finite-element model{driven}."
    words = f"{words} {treatment_words(motion)}".strip()
    badge = "simulated motion" + (f", {origin} recording" if origin else "")
    return page_of(data, title=title, badge=badge, words=words, simulated=True)


def driven_by(activation: xr.Dataset) -> tuple[str, str]:
    """Origin of the recording of an activation, '' without one, and what drives the face in words."""
    origin = str(activation.attrs.get("origin", ""))
    if "montage" in activation.attrs:
        return origin, f" from the sEMG of a {origin or 'stored'} recording"
    if activation.attrs.get("strategy") == "true":
        return origin, " from the true activation of a simulated recording"
    return "", " from specified muscle activations"


def _motion_trial(
    motion: xr.Dataset, frames: NDArray[np.floating], centre: NDArray[np.float64]
) -> dict[str, Any]:
    """Encode the surface and markers of a trajectory."""
    time = motion["frame_time"].values
    markers = motion["position"].transpose("time", "marker", "axis")
    markers = whole(markers.sel(time=time, method="nearest").values, centre)
    sigma_max = float(motion.attrs["sigma_max"]) / 1e3
    named = motion.attrs.get("face") or "unnamed"
    about = f"Face model: {named}, sigma_max {sigma_max:.4g} kPa. {lips_of_motion(motion)}".strip()
    trial = _trial(frames, markers, time, centre, about)
    if force_names(motion):
        trial["forces"] = packed(forces_at(motion, time))
    return trial


def force_names(motion: xr.Dataset) -> list[dict[str, str]]:
    """Muscles whose force a motion contains, and contact without id, as `muscle_names`."""
    names = list[dict[str, str]]()
    if "muscle_force" in motion:
        names += muscle_names(motion["muscle"].values[_with_force(motion)])
    if "contact_force" in motion:
        names.append({"id": "", "name": "contact of the lips and teeth"})
    return names


def forces_at(motion: xr.Dataset, time: NDArray[np.floating]) -> NDArray[np.float32]:
    """Forces (frame, force) [N] of `force_names` at the instants of frames [s]."""
    chosen, columns = motion.sel(time=time, method="nearest"), list[NDArray[np.floating]]()
    if "muscle_force" in motion:
        force = chosen["muscle_force"].transpose("time", "muscle").values
        columns += list(force[:, _with_force(motion)].T)
    if "contact_force" in motion:
        columns.append(chosen["contact_force"].values)
    return np.stack(columns, axis=1).astype("<f4")


def _with_force(motion: xr.Dataset) -> NDArray[np.bool_]:
    """Muscles whose force is known throughout."""
    force = motion["muscle_force"].transpose("time", "muscle")
    return np.asarray(np.isfinite(force.values).all(axis=0), dtype=np.bool_)


def _scored(scores: xr.Dataset) -> str:
    """Sentence on rho of each marker."""
    rho = scores["rho"]
    if not np.isfinite(rho.values).any():
        return "rho is undefined for all markers."
    named = zip((str(m).replace("_", " ") for m in rho["marker"].values), rho.values, strict=True)
    each = (f"{name} {v:.2f}" if np.isfinite(v) else f"{name} undefined" for name, v in named)
    return f"Median rho {np.nanmedian(rho.values):.2f}: {', '.join(each)}."


def _two_names(first: str, second: str) -> tuple[str, str]:
    """Different names of two motions."""
    return (first, second) if first != second else (f"{first}, first", f"{second}, second")


def trial_name(motion: xr.Dataset) -> str:
    """Label of the trial of a trajectory or activation, as far as its attributes specify it."""
    parts = ("volunteer", "instruction", "repetition", "strategy")
    named = [str(motion.attrs[name]) for name in parts if name in motion.attrs]
    said = INSTRUCTIONS.get(str(motion.attrs.get("instruction", "")), "")
    if named and "repetition" in motion.attrs and "instruction" not in motion.attrs:
        named[int("volunteer" in motion.attrs)] = f"repetition {motion.attrs['repetition']}"
    return " ".join(named) + (f" ({said})" if said else "") or "motion"


def _trial(
    frames: NDArray[np.floating],
    markers: NDArray[np.int16],
    time: NDArray[np.floating],
    centre: NDArray[np.float64],
    about: str,
) -> dict[str, Any]:
    return {
        "instruction": "",
        "strategy": "",
        "label": "",
        "about": about,
        "time": [round(float(t), 4) for t in time],
        "skin": deltas(whole(frames, centre)),
        "simulated": deltas(markers),
    }


def _single(trial: dict[str, Any], markers: NDArray[Any]) -> dict[str, Any]:
    return {
        "instructions": {"": ""},
        "strategies": [""],
        "markers": [str(name) for name in markers],
        "muscles": [],
        "trials": [trial],
    }


def page_of(data: dict[str, Any], *, title: str, badge: str, words: str, simulated: bool) -> str:
    """Write a page with one face."""
    from emgface import __version__

    picks = "pick" in data
    script = viewer_script(resource("page/viewer.js") + resource("page/pick.js") * picks)
    return environment().get_template("face.html").render(
        picks=picks,
        viewer=as_json(data),
        labels={"simulated": "simulated by the face model" if simulated else "lip markers",
                "measured": "recording"},
        views=VIEWS,
        tag="simulated motion" if simulated else badge,
        title=title,
        badge=badge,
        simulated=simulated,
        words=words,
        version=__version__,
        style=style(),
        script=Markup(script),
        policy=policy(script),
    )  # fmt: skip


def svg_of(figure: "Figure", name: str, description: str, *, scale: float = 1.0) -> Markup:
    """Write a figure as an SVG element that fills its container, up to `scale` times its own width.

    `name` is unique in the page and prefixes every id; `description` is the text for screen
    readers.
    """
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    buffer = io.StringIO()
    figure.set_dpi(130)
    with settings(SAVED_PARAMETERS):
        # ``savefig`` would draw twice, first for a layout that drawing computes anyway.
        FigureCanvasSVG(figure).print_svg(buffer, metadata={"Date": None})
    text = buffer.getvalue()
    text = isolated(text[text.index("<svg") :])
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r'\bid="([^"]+)"', rf'id="{name}-\1"', text)
    text = re.sub(r'(href=")#', rf"\1#{name}-", text)
    text = re.sub(r"url\(#", f"url(#{name}-", text)
    head, body = text.split(">", 1)
    width = re.search(r'width="([\d.]+)pt"', head)
    head = re.sub(r'\s(width|height)="[^"]*"', "", head)
    wide = float(width[1]) if width else 500.0
    label = str(Markup.escape(isolated(description))).replace('"', "&quot;")
    size = f"max-width:{scale * wide:.0f}pt"
    return Markup(f'{head} role="img" aria-label="{label}" style="{size}">{body}')


def figure_page(figure: "Figure") -> str:
    """Write the page of a figure, as wide as the window."""
    words = title_of(figure) or "figure"
    title = Markup.escape(isolated(words))
    return (
        f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>{title}</title>'
        f'<meta http-equiv="Content-Security-Policy" content="{policy("")}"></head>'
        f"<body>{svg_of(figure, 'figure', words)}</body></html>\n"
    )


def environment(*packages: str) -> Environment:
    """Templates of this package and of others, which may include each other's templates.

    They are those of one page: what the note of a table states is not repeated at a later one.
    """
    loaders = [PackageLoader(name, "page") for name in (*packages, "emgface.pictures")]
    made = Environment(
        loader=ChoiceLoader(loaders),
        autoescape=True,
        finalize=_in_a_page,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.globals["noted"] = Notes()
    return made


def cells(table: Table) -> dict[str, Any]:
    """Convert a table for the page by `laid_out`."""
    numbers = [
        any(isinstance(row[k], int | float) for row in table.rows)
        for k in range(len(table.columns))
    ]
    rows = [
        [column.cell(value) for column, value in zip(table.columns, row, strict=True)]
        for row in table.rows
    ]
    heads = [column.head().replace("_", " ") for column in table.columns]
    return laid_out(table.title, heads, numbers, rows, table.note)


def laid_out(
    title: str, heads: list[str], numbers: list[bool], rows: list[list[str]], note: str = ""
) -> dict[str, Any]:
    """Lay out a table for the page: title, note, heads with alignment, rows of text.

    Columns of numbers without any value are named below the table instead. A table of many columns
    and few rows is printed upright: its rows become columns.
    """
    kept = [
        k for k, number in enumerate(numbers) if not number or {r[k] for r in rows} != {ABSENT_CELL}
    ]
    left = [head for k, head in enumerate(heads) if k not in kept]
    shown = [[heads[k] for k in kept], *([row[k] for k in kept] for row in rows)]
    number = [numbers[k] for k in kept]
    if len(kept) > WIDE and len(rows) <= LOW:
        shown = [list(line) for line in zip(*shown, strict=True)]
        number = [False] + [True] * len(rows)
    return {
        "title": title,
        "note": note,
        "without": ", ".join(left),
        "wide": len(shown[0]) > WIDE,
        "heads": [{"text": t, "number": n} for t, n in zip(shown[0], number, strict=True)],
        "rows": shown[1:],
    }


def style() -> Markup:
    """Style sheet of all pages."""
    return Markup(resource("page/page.css"))


def policy(script: str, *, connects: bool = False) -> str:
    """Content security policy that forbids every request and every script but this one.

    With `connects`, the page may send requests to the server that it was loaded from.
    """
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode("ascii")
    return "; ".join(
        [
            "default-src 'none'",
            f"script-src 'sha256-{digest}'" if script else "script-src 'none'",
            "style-src 'unsafe-inline'",
            "img-src data:",
            *(["connect-src 'self'"] if connects else []),
            "base-uri 'none'",
            "form-action 'none'",
        ]
    )


def viewer_script(page: str | None = None) -> str:
    """Combine three.js, the drawing of surfaces and the script of a page in one module.

    `page` is the text of that script, by default that of stored motions. The module has no imports;
    the exports, which are the last statement of a module, are replaced by an object.
    """
    page = resource("page/viewer.js") if page is None else page
    library = resource(THREE)
    body, exported = re.fullmatch(r"(.*)export\{([^{}]*)\};\s*", library, re.DOTALL).groups()  # pyright: ignore[reportOptionalMemberAccess]
    names = [pair.split(" as ") for pair in exported.split(",")]
    made = ",".join(f"{pair[-1]}:{pair[0]}" for pair in names)
    # Top-level names of the library would collide with those of the viewer.
    text = f"const THREE=(()=>{{{body}return{{{made}}};}})();\n{resource('page/surface.js')}{page}"
    if "</script" in text.lower():
        raise AssertionError("the script would end its own element")
    return text


def resource(name: str, package: str = "emgface.pictures") -> str:
    """Text of a file of a package."""
    return files(package).joinpath(name).read_text(encoding="utf-8")


class Exact(str):
    """Text of a page that returns to a file, and is therefore not changed for display."""

    __slots__ = ()


def _in_a_page(value: Any) -> Any:
    """A value for a page, whose texts do not reorder or hide the words around them."""
    if isinstance(value, str):
        return value if isinstance(value, Exact | Markup) else isolated(value)
    if isinstance(value, Mapping):
        return {_in_a_page(key): _in_a_page(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        # most values are numbers of a motion
        return [one if type(one) in (float, int) else _in_a_page(one) for one in value]
    return value


def as_json(value: Any) -> Markup:
    """JSON that can be embedded in a page; its texts are for display, except those that are `Exact`."""
    # "<" in the data could end the enclosing element.
    text = json.dumps(_in_a_page(value), allow_nan=False, separators=(",", ":"))
    return Markup(text.replace("<", "\\u003c"))
