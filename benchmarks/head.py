"""Generated head: actions of the tongue, stability and cost of a step.

    python -m benchmarks head --part actions     # displacement of tip and back by every muscle
    python -m benchmarks head --part stability --out DIR   # muscles at 1.0; continues its table
    python -m benchmarks head --part strong      # all muscles at 1.0 with 3 MPa
    python -m benchmarks head --part opening     # how far parts of a head let the jaw open
    python -m benchmarks head --part cost        # processor time of a step against the face alone
    python -m benchmarks head --part published_size  # the same, as large as the published head
    python -m benchmarks head --part precision --out DIR  # error and run time over scheme and step

All results are simulated. "cost" alternates the scenes, so that the load of the machine affects both.
"""

import itertools
from collections.abc import Iterable, Iterator
from pathlib import Path

import pandas as pd

from benchmarks.head_cost import cost, precision, published_size
from benchmarks.head_ends import ALL, WIDE, Rows, survives
from benchmarks.report import finish, say
from emgface.anatomy.head.build import build_head
from emgface.anatomy.head.model import Head
from emgface.anatomy.head.scene import TONGUE, HeadScene, head_scene
from emgface.anatomy.tongue.actions import action_table
from emgface.face.simulation_parameters import SimulationParameters
from emgface.files import write_text


def actions(preset: str, resolution: str) -> Rows:
    """Every muscle of the tongue raised to 0.3 and released within 1 s, without gravity."""
    tongue = build_head(["tongue"], preset=preset, resolution=resolution).parts["tongue"]
    for row in action_table(tongue, TONGUE, step=1e-2).to_dict("records"):
        yield {str(name): value for name, value in row.items()}


def stability(preset: str, resolution: str, known: pd.DataFrame) -> Rows:
    """Muscles at 1.0 within 0.1 s and held; jaw closed or opening, without and with contact."""
    heads = {
        name: build_head(ALL, preset=preset, resolution=resolution, contacts=pairs)
        for name, pairs in (("none", []), ("all", None))
    }
    head = heads["none"]
    tongue = {str(m)[:-2] for m in head.parts["tongue"]["muscle"].values}
    face = {str(m)[:-2] for m in head.parts["face"]["muscle"].values}
    together = {"all of the tongue": tongue, "all of the face": face, "all": tongue | face}
    single = {name: {name} for name in sorted(tongue) + sorted(face)}
    scenes = dict[str, HeadScene]()
    done = {tuple(row) for row in known[list(LABELS)].itertuples(index=False)}
    for jaw, contact, step, name in _cases(together, single):
        if (jaw, contact, step, name) in done:
            continue
        if contact not in scenes:
            scenes[contact] = head_scene(
                heads[contact], tongue=TONGUE.model_copy(update={"sigma_max": 300e3})
            )
        muscles = {**together, **single}[name]
        drive = {f"bi_{muscle}": 1.0 for muscle in sorted(muscles)}
        drive |= {"bi_open": 1.0} if jaw == "opening" else {"bi_close": 0.02}
        yield {
            **dict(zip(LABELS, (jaw, contact, step, name), strict=True)),
            **survives(heads[contact], scenes[contact], drive, 1e-3 * step),
        }


def strong(preset: str, resolution: str) -> Rows:
    """All muscles of a part at 1.0 with ten times the published stress, steps of 5 and 1 ms."""
    tongue = TONGUE.model_copy(update={"sigma_max": 3e6})
    for contacts, step in itertools.product((("none", []), ("all", None)), (5.0, 1.0)):
        head = build_head(ALL, preset=preset, resolution=resolution, contacts=contacts[1])
        scene = head_scene(head, face=SimulationParameters(sigma_max=3e6), tongue=tongue)
        names = {
            part: [str(m)[:-2] for m in head.parts[part]["muscle"].values]
            for part in ("tongue", "face")
        }
        for what in (["tongue"], ["face"], ["tongue", "face"]):
            drive = {f"bi_{m}": 1.0 for part in what for m in names[part]} | {"bi_close": 0.02}
            row = survives(head, scene, drive, 1e-3 * step)
            yield {"muscles": " and ".join(what), "contact": contacts[0], "step_ms": step, **row}


LABELS = ("jaw", "contact", "step_ms", "muscles")


def _cases(*groups: Iterable[str]) -> Iterator[tuple[str, str, float, str]]:
    """Single muscles at 5 ms with closed jaw, all together at every step, jaw and contact."""
    together, single = groups
    for contact in ("none", "all"):
        for step in (5.0, 20.0, 1.0):  # the most expensive steps last
            if step == 1.0:
                yield from (("closed", contact, 5.0, name) for name in single)
            for jaw in ("closed", "opening"):
                yield from ((jaw, contact, step, name) for name in together)


STRENGTHENED = ("ad", "pd", "ip", "sp", "sh", "oh", "th", "gh", "stet", "steh", "mh")
"""Muscles that open the jaw or hold the hyoid below, without their side."""


def opening(preset: str, resolution: str) -> Rows:
    """Widest opening of jaw, tongue and face together, with normal and with eightfold strength."""
    cases = [(("jaw", "hyoid"), 1.0, 5.0), (("jaw", "tongue", "hyoid"), 1.0, 5.0),
             (("face", "jaw", "hyoid"), 1.0, 5.0), *((ALL, k, h) for k in (1.0, 8.0)
                                                    for h in (1.0, 5.0, 10.0))]  # fmt: skip
    for parts, strength, step in cases:
        head = build_head(parts, preset=preset, resolution=resolution, contacts=[])
        jaw = head.parts["jaw"].copy(deep=True)
        opens = [str(name).rpartition("_")[0] in STRENGTHENED for name in jaw["muscle"].values]
        jaw["muscle_force_max"][opens] *= strength
        strong = Head(head.lists, {**head.parts, "jaw": jaw})
        row = survives(
            strong, head_scene(strong), WIDE, 1e-3 * step, rise=0.3, duration=1.0, output=0.05
        )
        yield {"parts": ", ".join(parts), "strength": strength, "step_ms": step, **row}


PARTS = {
    f.__name__: f
    for f in (
        actions,
        opening,
        strong,
        cost,
        published_size,
        precision,
    )
}


def main(
    part: str = "actions",
    preset: str = "man",
    resolution: str = "coarse",
    out: Path | None = None,
    rows: int = 1000,
) -> None:
    """Run one part and print its table; "stability" continues that of `out`, by at most `rows` rows."""
    if part != "stability":
        table = pd.DataFrame(PARTS[part](preset, resolution))
    else:
        stored = None if out is None else out / "head_stability.csv"
        table = pd.DataFrame(columns=list(LABELS))
        if stored is not None and stored.is_file():
            table = pd.read_csv(stored, keep_default_na=False)
        found = stability(preset, resolution, table)
        for row in itertools.islice(found, rows):
            say(str(row))
            table = pd.concat([table, pd.DataFrame([row])], ignore_index=True)
            if stored is not None:
                write_text(stored, table.to_csv(index=False))
    finish(f"head_{part}", table, out)


__all__ = ["main"]
