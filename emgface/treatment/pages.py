"""Pages that compare a treated with the intact face: both move side by side under one time cursor."""

from collections.abc import Iterable
from typing import Any, Final

import numpy as np
import pandas as pd
import xarray as xr
from markupsafe import Markup
from matplotlib.figure import Figure
from numpy.typing import NDArray

from analysis.tables import Column, Table
from emgface.face.identity import treatments_between
from emgface.pictures.body import Body, body_of, skin_of
from emgface.pictures.encoding import (
    body_data,
    deltas,
    levels,
    middle_of,
    muscle_names,
    packed,
    whole,
)
from emgface.pictures.page import as_json, cells, environment, policy, style, viewer_script
from emgface.pictures.render import VIEWS
from emgface.pictures.stills import body_figure
from emgface.treatment.facts import SHOWN_UNITS, facts_of_report, facts_of_step
from emgface.treatment.motions import ComparedMotions
from emgface.treatment.outcomes import CLOSED_AREA, OUTCOMES, UNIT_FACTORS, Outcome, with_words
from emgface.treatment.outline import in_excision, outline_of
from emgface.treatment.plan import CUTS, NOT_VALIDATED, Incision, Wedge, applied_plan

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

REMOVED_COLOUR: Final = (0.62, 0.10, 0.16)  #: colour of the tissue that is removed
PLAIN_UNITS: Final = {"mm": "millimetres", "mm2": "square millimetres", "Pa": "pascals"}
PLAIN_LABELS: Final = {
    "simulated": "points on the lips",
    "measured": "recording",
    "instruction": "Movement",
    "colour": "Points and colour",
    "displacement": "how far the skin has moved, as colour",
}
"""Labels of the viewer on the plain page."""
NO_SENSATION: Final = (
    "Sensation is not modelled. The activations after the treatment are those before it, which no "
    "person will repeat exactly. Scar, joining of fibres and their retraction have no measured values."
)


def side_by_side(
    intact: xr.Dataset,
    treated: xr.Dataset,
    motions: ComparedMotions,
    activations: dict[str, xr.DataArray],
    *,
    plain: bool = False,
) -> dict[str, Any]:
    """Surfaces and motions of both faces as data of the viewer; `plain` without terms of the field."""
    names = list(motions.intact)
    bodies = [_drawn_plan(intact, treated), body_of(treated)]
    rest = [f["position"].values[skin_of(f).node] for f in (intact, treated)]
    centre = middle_of(np.concatenate(rest))
    body, adjacent = joined(*bodies)
    data = body_data(body, np.concatenate(rest))
    trials = [_trial(name, motions, activations[name], centre, plain=plain) for name in names]
    markers = [f"{m} {when}" for when in ("before", "after") for m in intact["marker"].values]
    return data | {
        "panels": packed(adjacent),
        "sides": [-1] * intact.sizes["marker"] + [1] * treated.sizes["marker"],
        "what": "faces before (left) and after (right) a simulated treatment",
        "instructions": {
            trial["instruction"]: "" if plain else motions.words[name]
            for name, trial in zip(names, trials, strict=True)
        },
        "strategies": [""],
        "markers": markers,
        "muscles": muscle_names(intact["muscle"].values),
        "trials": trials,
    }


def _trial(
    name: str, motions: ComparedMotions, activation: xr.DataArray, centre: Floats, *, plain: bool
) -> dict[str, Any]:
    pair = motions.intact[name], motions.treated[name]
    n = min(m.sizes["frame"] for m in pair)
    time = pair[0]["frame_time"].values[:n]
    order = ("frame", "surface_node", "axis")
    skins = [m["surface_position"].transpose(*order).values[:n] for m in pair]
    marks = [
        m["position"].transpose("time", "marker", "axis").sel(time=time, method="nearest").values
        for m in pair
    ]
    sigma = [float(m.attrs["sigma_max"]) / 1e3 for m in pair]
    pace, start = pair[0].attrs["recorded_pace"], pair[0].attrs["recorded_start"]
    caption = f"Simulated, {motions.words[name]}: before on the left, after on the right"
    shown = motions.words[name] if plain else name
    return {
        "instruction": shown,
        "strategy": "",
        "label": shown,
        "about": f"{caption}."
        if plain
        else f"{caption}, with the same activations and sigma_max {sigma[0]:.4g} kPa.",
        "time": [round(float(t), 4) for t in time],
        "skin": deltas(whole(np.concatenate(skins, axis=1), centre)),
        "simulated": deltas(whole(np.concatenate(marks, axis=1), centre)),
        "activation": levels(activation, start + pace * time),
    }


def joined(one: Body, two: Body) -> tuple[Body, NDArray[np.int8]]:
    """Body of two bodies, and the side (points,) of every point: -1 of the first, 1 of the second."""
    sizes = [
        (b.n, b.tissue - b.n, len(b.rules) - (b.tissue - b.n), len(b.teeth)) for b in (one, two)
    ]
    starts = np.cumsum([0, *(sizes[k][part] for part in range(4) for k in (0, 1))])
    # points in the order: nodes, refined points, points behind the mouth, teeth, of both bodies
    places: list[Indices] = []
    for k in (0, 1):
        parts = [starts[2 * part + k] + np.arange(sizes[k][part]) for part in range(4)]
        places.append(np.concatenate(parts))
    rules = [
        np.split(places[k][b.rules].reshape(-1, 4), [sizes[k][1]]) for k, b in enumerate((one, two))
    ]
    colour = np.empty((int(starts[-1]), 3))
    side = np.empty(int(starts[-1]), dtype=np.int8)
    for k, b in enumerate((one, two)):
        colour[places[k]] = b.colour
        side[places[k]] = 2 * k - 1
    body = Body(
        one.n + two.n,
        np.concatenate([r[part] for part in (0, 1) for r in rules]),
        np.concatenate([one.teeth, two.teeth]),
        np.concatenate([places[0][one.triangle], places[1][two.triangle]]),
        colour,
        one.tissue + two.tissue,
    )  # fmt: skip
    return body, side


def _drawn_plan(intact: xr.Dataset, treated: xr.Dataset) -> Body:
    """Body of the intact face with the excisions of the plan drawn on the skin."""
    skin = skin_of(intact)
    body = body_of(intact, skin)
    points = body.points(intact["position"].values[skin.node])[: body.tissue]
    for entry in treatments_between(intact, treated):
        for step in applied_plan(entry).step:
            if not isinstance(step, (Wedge, Incision)):
                continue
            mine = in_excision(intact, outline_of(intact, step), step.lip, points)
            body.colour[: body.tissue][mine] = REMOVED_COLOUR
    return body


def states_of(treated: xr.Dataset, motions: ComparedMotions, names: tuple[str, ...]) -> Figure:
    """Draw the treated face from three sides, at rest and at the largest displacement of movements."""
    skin = skin_of(treated)
    body = body_of(treated, skin)
    shown: dict[str, NDArray[np.floating]] = {"closed wound": treated["position"].values[skin.node]}
    for name in names:
        if name not in motions.treated:
            continue
        order = ("frame", "surface_node", "axis")
        frames = motions.treated[name]["surface_position"].transpose(*order).values
        far = int(np.argmax(((frames - frames[0]) ** 2).sum(axis=(1, 2))))
        shown[motions.words[name]] = frames[far]
    markers = treated["position"].values[treated["marker_node"].values]
    return body_figure(
        body, shown, title=f"{treated.attrs['name']}; {NOT_VALIDATED}", around=markers
    )


def _table(frame: pd.DataFrame, title: str) -> dict[str, Any]:
    if "unit" in frame:
        frame = frame.assign(unit=frame["unit"].replace(SHOWN_UNITS))
    columns = tuple(Column(str(name), digits=2) for name in frame.columns)
    return cells(Table(title, columns, tuple(map(tuple, frame.to_numpy().tolist())), "simulated"))


def compare_page(
    intact: xr.Dataset,
    treated: xr.Dataset,
    motions: ComparedMotions,
    activations: dict[str, xr.DataArray],
    tables: tuple[pd.DataFrame, pd.DataFrame],
    *,
    plain: bool = False,
) -> str:
    """Write the page of a comparison as HTML without network requests; `plain` is that for the person.

    `tables` are those of `emgface.treatment.outcomes`.
    """
    from emgface import __version__

    data = side_by_side(intact, treated, motions, activations, plain=plain)
    entries = treatments_between(intact, treated)
    cuts = any(isinstance(step, CUTS) for e in entries for step in applied_plan(e).step)
    event = "operation" if cuts else "treatment"
    script = viewer_script()
    outcomes, movements = tables
    rendered = environment("emgface.treatment").get_template(
        "person.html" if plain else "compare.html"
    )
    return rendered.render(
        viewer=as_json(data),
        labels=PLAIN_LABELS
        if plain
        else {"simulated": "lip markers, simulated", "measured": "recording"},
        views=VIEWS,
        tag="simulated · before | after",
        title="Movement of the lips before and after a simulated treatment",
        names=(str(intact.attrs["name"]), str(treated.attrs["name"])),
        source=motions.source,
        steps=_steps(entries),
        cuts=cuts,
        failed=motions.failed,
        notes=motions.notes,
        sentences=plain_sentences(
            outcomes, movements, [motions.words[n] for n in motions.failed], event
        ),
        event=event,
        outcomes=_table(with_words(outcomes), "outcomes, simulated"),
        movements=_table(movements, "movement after, relative to before, simulated"),
        warning=NOT_VALIDATED,
        limits=NO_SENSATION,
        version=__version__,
        style=style(),
        script=Markup(script),
        policy=policy(script),
    )


def _steps(entries: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
    """Steps of all plans: their place, the parameters of the plan, and what their report adds."""
    steps: list[dict[str, Any]] = []
    for entry in entries:
        plan = applied_plan(entry)
        for step, report in zip(plan.step, entry["steps"], strict=True):
            own = facts_of_step(step)
            own += [fact for fact in facts_of_report(report) if fact[0] not in dict(own)]
            title = f"Step {report['step']} of “{plan.name}”: {report['kind']}"
            steps.append({"title": title, "facts": own})
    return steps


def plain_sentences(
    outcomes: pd.DataFrame,
    movements: pd.DataFrame,
    lost: Iterable[str] = (),
    event: str = "operation",
) -> list[str]:
    """Sentences without terms of the field on what becomes larger and what smaller.

    `lost` are the words of movements that could not be simulated, `event` that of the treatment.
    """
    known, sentences = {o.name: o for o in OUTCOMES if o.plain}, list[str]()
    words_of_event = set[str]()
    for row in outcomes.itertuples():
        outcome, unit = known.get(str(row.outcome)), str(row.unit)
        values = {"before": float(row.before), "after": float(row.after)}  # pyright: ignore
        finite = [when for when, value in values.items() if np.isfinite(value)]
        if outcome is None or not finite:
            continue
        bounded = [when for when in finite if row.bound in (when, "both")]
        worded = {
            when: "at least " * (when in bounded) + _plain(values[when], unit) for when in finite
        }
        if len(finite) == 1:
            other = next(when for when in values if when not in finite)
            sentences.append(
                f"In the model, {outcome.plain.format(worded[finite[0]])} {finite[0]} the {event}; the "
                f"model could not work it out {other}."
            )
            continue
        words_of_event.add(outcome.movement)
        sentences.append(f"In the model, {_compared(outcome, values, worded, bool(bounded))}.")
    for row in movements.itertuples():
        share = float(row[3])
        if (
            np.isfinite(share) and row.movement not in words_of_event
        ):  # its outcomes say what it is for
            sentences.append(f"“{row.words}”: the movement is {100 * share:.0f} % of that before.")
    return sentences + [f"“{name}”: the model could not work out this movement." for name in lost]


def _plain(value: float, unit: str) -> str:
    """Number of an outcome with the word of its unit; a pressure in whole hundreds below it."""
    text = f"{100.0 * (value // 100.0):.0f}" if unit == "Pa" else f"{value:.1f}"
    return f"{text} {PLAIN_UNITS[unit]}"


def _compared(
    outcome: Outcome, values: dict[str, float], worded: dict[str, str], bounded: bool
) -> str:
    """Words on a value after and before the treatment, and on which of them is larger."""
    before, after = values["before"], values["after"]
    size = "more" if after > before else "less"
    if bounded:
        return f"{outcome.plain.format(worded['after'])} (before: {worded['before']})"
    if outcome.unit == "mm2" and max(before, after) <= UNIT_FACTORS["mm2"] * CLOSED_AREA:
        less = "less than one square millimetre, as before, which counts as closed"
        return outcome.plain.format(less)
    if min(before, after) < 0.0:  # a number below zero says nothing to a person
        return outcome.plain.format(
            f"{_plain(abs(after - before), outcome.unit)} {size} than before"
        )
    same = abs(after - before) < 0.05 * max(abs(before), 0.2)
    closed = "; less than one counts as closed" if outcome.unit == "mm2" else ""
    than = "about as before" if same else f"{size} than before"
    return (
        f"{outcome.plain.format(worded['after'])}, {than} ({worded['before'].split()[0]}){closed}"
    )
