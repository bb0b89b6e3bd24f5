"""Sweeps of changed heads: what holds the jaw of a head, and experiments on the published head."""

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd
import xarray as xr

from emgface.anatomy.head import build
from emgface.anatomy.head.build import build_head
from emgface.anatomy.head.model import LINES, Head
from emgface.anatomy.head.outcomes import Measure
from emgface.anatomy.head.published import import_head
from emgface.anatomy.head.sweep import Run, Setting, outcomes, sweep
from emgface.errors import HeadError
from emgface.face.parts import MANDIBLE, SKULL
from studies.coupled.experiments import EXPERIMENTS, LAW, moved_most
from studies.mechanics.expressions import EXPRESSIONS

ALL: Final = ("face", "jaw", "tongue", "hyoid")
JAW, TONGUE_JAW, FACE_JAW = ("jaw", "hyoid"), ("jaw", "tongue", "hyoid"), ("face", "jaw", "hyoid")
WIDE: Final = {"bi_open": 1.0, "bi_infrahyoid": 0.3, "bi_retracthyoid": 0.35}
"""Excitations of the task "gape" of a jaw."""


@dataclass(frozen=True)
class Change:
    """A change of heads: of which parts, parameters, and of the head itself."""

    name: str
    parts: tuple[tuple[str, ...], ...]
    face: dict[str, float]
    tongue: dict[str, float]
    head: Callable[[tuple[str, ...], str], Head] | None = None
    drive: dict[str, float] | None = None


def opened(motion: xr.Dataset, head: Head) -> dict[str, float]:
    """Way of the lower incisor and of the hyoid down, and the smallest det F."""
    moved = motion["position"].isel(time=-1) - motion["position"].isel(time=0)
    down = -1e3 * moved.sel(axis=str(motion["axis"].values[2]))
    found = {f"{p}_down_mm": float(down.sel(marker=p)) for p in ("lower_incisor", "hyoid")}
    smallest = motion["smallest_J"].min() if "smallest_J" in motion else np.nan
    return {**found, "smallest_J": float(smallest)}


def without_floor(parts: tuple[str, ...], preset: str) -> Head:
    """Head whose jaw lacks geniohyoid and mylohyoid."""
    head = build_head(parts, preset=preset, contacts=[])
    jaw = build.moving(head.parts["jaw"], parts, LINES)
    return build.build_lists(
        parts={**head.parts, "jaw": jaw}, named=parts, attachments={}, contacts=[], shells={},
        name="head without floor",
    )  # fmt: skip


def floor_as_published(parts: tuple[str, ...], preset: str) -> Head:
    """Head whose geniohyoid and mylohyoid are tissue of the tongue alone, as in the published model."""
    head = build_head(parts, preset=preset, contacts=[])
    jaw = head.parts["jaw"].copy(deep=True)
    own = [str(name)[:-2] in LINES for name in jaw["muscle"].values]
    jaw["muscle_force_max"].values[own] = 1e-6
    return Head(head.lists, {**head.parts, "jaw": jaw})


def strong_floor(parts: tuple[str, ...], preset: str) -> Head:
    """As `floor_as_published`, with muscles that fill their elements (1.7 and 2.9 times as much)."""
    head = floor_as_published(parts, preset)
    tongue = head.parts["tongue"].copy(deep=True)
    names = np.array([str(m)[:2] for m in tongue["muscle"].values])
    own = np.isin(names[tongue["bundle_muscle"].values], ["GH", "MH"])
    tongue["bundle_weight"].values[own] = 1.0
    return Head(head.lists, {**head.parts, "tongue": tongue})


def free_ramus(parts: tuple[str, ...], preset: str) -> Head:
    """Head whose face is free at the elements that are fixed to both bones."""
    head = build_head(parts, preset=preset, contacts=[])
    face, named = head.parts["face"], head.lists
    fixed, cells = face["fixed"].values, face["connectivity"].values
    between = (fixed[cells] == SKULL).any(axis=1) & (fixed[cells] == MANDIBLE).any(axis=1)
    free = np.unique(cells[between])
    pairs = [str(p).startswith("face-") for p in named["pair"].values]
    loose = np.array(pairs)[named["attachment_pair"].values]
    loose &= np.isin(named["attachment_node"].values, free)
    face = face.assign(fixed=face["fixed"].where(~np.isin(np.arange(len(fixed)), free), 0))
    face["fixed"] = face["fixed"].astype(fixed.dtype)
    return replace(head, lists=named.isel(attachment=~loose), parts={**head.parts, "face": face})


def changes() -> list[Change]:
    """Return the changes of a whole head, each of one part or property, whose openings are compared."""
    soft = {"C10": 250.0, "C20": 117.5, "kappa": 2500.0}
    soft_tongue = {"C10": 103.7, "C20": 48.6, "kappa": 1037.0}
    strong = {"sigma_max": 300e3}
    return [
        Change("none", (JAW, TONGUE_JAW, FACE_JAW, ALL), LAW, {}),
        Change("face with 300 kPa", (FACE_JAW, ALL), strong, {}),
        Change("jaw without geniohyoid and mylohyoid", (JAW,), {}, {}, without_floor),
        Change("floor of the tongue alone", (TONGUE_JAW, ALL), LAW, {}, floor_as_published),
        Change("moduli of the tongue x 0.1", (TONGUE_JAW,), {}, soft_tongue),
        Change("moduli of the face x 0.1", (FACE_JAW,), LAW | soft, {}),
        Change("bulk modulus of the face x 0.1", (FACE_JAW,), LAW | {"kappa": 2500.0}, {}),
        Change("face free over the ramus", (FACE_JAW,), LAW, {}, free_ramus),
        Change("tongue with 300 kPa", (TONGUE_JAW, ALL), LAW, strong),
        Change(
            "floor of the tongue alone, x 5 and x 9", (TONGUE_JAW, ALL), LAW, strong, strong_floor
        ),
    ]


def held(preset: str, resolution: str, out: Path | None) -> Iterator[dict[str, object]]:
    """Opening with the excitations of "gape" after every change, with steps of 20 and 10 ms."""
    setting = Setting(preset=preset, resolution=resolution, duration=1.0, rise=0.3, step=2e-2)
    for change in changes():
        for parts in change.parts:
            face = change.face if "face" in parts else {}
            tongue = change.tongue if "tongue" in parts else {}
            drive = (change.drive or WIDE) | {"bi_close": 0.0}
            run = Run(f"{change.name}; {', '.join(parts)}", drive, face, tongue, contacts=())
            table = sweep(
                [run],
                replace(setting, parts=parts),
                folder=None if out is None else out / "held",
                head=None if change.head is None else change.head(parts, preset),
                measure=opened,
            )
            shown = ("lower_incisor_down_mm", "lower_incisor_down_mm_step_error", "hyoid_down_mm",
                     "smallest_J", "end")  # fmt: skip
            row = {name: value for name, value in table.iloc[0].items() if name in shown}
            yield {"change": change.name, "parts": ", ".join(parts), **row}


def published(models: Path, out: Path | None) -> Iterator[dict[str, object]]:
    """Experiments 1, 3, 4, 5 and 6 on the published head.

    Its rings cannot be moved (2), and it lacks muscles of two labials (7).
    """
    teeth = {"teeth": ("lip-lip", "lips-teeth"), "no teeth": ("lip-lip",)}
    lips = [
        Run(
            f"factor {f:g}, OOP {a:g}, {n}",
            {"bi_OOP": a},
            {**LAW, "stiffening": f},
            contacts=teeth[n],
        )
        for n, f, a in itertools.product(teeth, (1.0, 10.0), (1.0, 0.5))
        if n == "teeth" or a == 1.0
    ]
    skin = [
        Run(
            f"{name}, skin x {k:g}",
            {f"bi_{m}": level for m, level in levels.items()},
            {**LAW, "skin.stiffness": k},
        )
        for name, levels in EXPRESSIONS.items()
        for k in (1.0, 4.0)
    ]
    rings = {"none": {}, "OOP": {"bi_OOP": 1.0}, "OOP and OOM": {"bi_OOP": 1.0, "bi_OOM": 0.6}}
    closing = [
        Run(
            f"{name}, openers {level:g}",
            {**drive, **({"bi_open": level} if level else {"bi_close": 0.02})},
            LAW,
            contacts=("lip-lip",),
        )
        for name, drive in rings.items()
        for level in (0.0, 0.05, 0.2)
    ]
    coupling = list(EXPERIMENTS["coupling"].runs)
    each: list[tuple[tuple[str, ...], list[Run], Measure]] = [
        (TONGUE_JAW, coupling, outcomes),
        (("face",), lips + skin, moved_most),
        (("face", "jaw"), closing, moved_most),
    ]
    for parts, runs, measure in each:
        step = 4e-2 if "face" in parts else 2e-2
        setting = Setting(parts=parts, step=step, gravity="jaw" in parts)
        table = sweep(
            runs,
            setting,
            head=import_head(models, parts),
            folder=None if out is None else out / f"published_{len(parts)}",
            measure=measure,
        )
        for row in table.to_dict("records"):
            yield {str(k): v for k, v in row.items()}


def _held(preset: str, resolution: str, out: Path | None, models: Path | None) -> pd.DataFrame:
    return pd.DataFrame(held(preset, resolution, out))


def _published(preset: str, resolution: str, out: Path | None, models: Path | None) -> pd.DataFrame:
    if models is None:
        raise HeadError("the published head is not part of this package: specify --models FOLDER")
    return pd.DataFrame(published(models, out))


SWEEPS: Final = {"held": _held, "published": _published}
"""Tables of a preset and resolution, kept in a folder, with the folder of the published models."""
