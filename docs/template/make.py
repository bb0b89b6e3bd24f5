"""Make the pictures and tables of the template face in this folder.

    python docs/template/make.py                 all parts
    python docs/template/make.py quality norms   the parts specified

Parts: pictures, quality, volunteers, actions, lips, gestures, published, convergence, norms. Each
writes its pictures and its part of README.md; other parts are not changed. The part "published" requires
the files of the published face in the folder EMGFACE_SHARED, and is not changed without them.
"""

import os
import re
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from PIL import Image

from benchmarks.report import markdown
from emgface.errors import FaceError
from emgface.face.artisynth import import_artisynth
from emgface.face.check import face_report
from emgface.face.lip_shape import lip_opening, lip_rim, lip_shape
from emgface.face.parts import FREE, MANDIBLE, SKULL
from emgface.face.quality import element_quality
from emgface.face.template import GROUP_PRESETS, norms_table, random_measures, template_face
from emgface.face.template.actions import muscle_actions, steady_positions
from emgface.face.template.build import shaped_positions
from emgface.face.template.gestures import GESTURES, gesture_activation
from emgface.face.template.grid import Grid, make_grid, refined_grid
from emgface.pictures.stills import face_figure, states_figure, write_figure

HERE = Path(__file__).parent
RESOLUTIONS = ("coarse", "medium", "fine", 11_520)
REFINEMENTS = (1, 2, 4, 8)
"""Factors of refinement of the coarse grid; each halves the edges of the previous grid."""
VOLUNTEERS = 1000


def gesture_positions(
    face: xr.Dataset, instructions: tuple[str, ...] = tuple(GESTURES)
) -> dict[str, Any]:
    """Positions of the nodes [m] in held gestures: 100 kPa, without gravity, with contact."""
    positions, _ = steady_positions(face, [gesture_activation(one) for one in instructions])
    return dict(zip(instructions, positions, strict=True))


def shrink(path: Path) -> None:
    """Store a picture as JPEG and delete its PNG."""
    with Image.open(path) as picture:
        picture.convert("RGB").save(path.with_suffix(".jpg"), quality=88, optimize=True)
    path.unlink()


def pictures() -> str:
    """Skin, lips, teeth, markers, muscles and attachments."""
    fine = template_face(resolution="fine")
    shrink(write_figure(face_figure(fine), HERE / "face.png", dpi=100))
    return """![Skin, lips, markers, muscles and attachments](face.jpg)

`emgface show face.nc --out face.png` draws this picture of any face.

The nostrils are dimples in the underside of the nose; the face has no nasal passage."""


def quality() -> str:
    """Quality and volume by resolution and by preset."""
    template_face(resolution="coarse")  # files that are loaded once do not count as building
    rows = {}
    for resolution in RESOLUTIONS:
        start = time.perf_counter()
        face = template_face(resolution=resolution)
        seconds = time.perf_counter() - start
        value = face_report(face).summary["value"]
        rows[str(resolution)] = {
            "elements": int(value["elements"]),
            "free nodes": int(value["free nodes"]),
            "inverted": int(value["inverted elements"]),
            "smallest scaled Jacobian": value["smallest scaled Jacobian of hexahedra"],
            "1 %": value["1 % of scaled Jacobian of hexahedra"],
            "median": value["median scaled Jacobian of hexahedra"],
            "below 0.3": int(value["hexahedra with scaled Jacobian below 0.3"]),
            "smallest edge (mm)": value["smallest edge length"],
            "largest edge ratio": value["largest edge ratio"],
            "volume (cm3)": value["volume"] * 1e-3,
            "built in (s)": seconds,
        }
    by_resolution = pd.DataFrame.from_dict(rows, orient="index").rename_axis("resolution")
    rows = {}
    for preset in GROUP_PRESETS:
        value = face_report(template_face(resolution="fine", preset=preset)).summary["value"]
        rows[preset] = {
            "inverted": int(value["inverted elements"]),
            "smallest scaled Jacobian": value["smallest scaled Jacobian of hexahedra"],
            "volume (cm3)": value["volume"] * 1e-3,
        }
    by_preset = pd.DataFrame.from_dict(rows, orient="index").rename_axis("preset")
    return f"""{markdown(by_resolution.reset_index(), ".2f")}

The published reference mesh has a smallest scaled Jacobian of 0.011. The next table lists the presets at
the fine resolution:

{markdown(by_preset.reset_index(), ".2f")}"""


def volunteers() -> str:
    """Quality of random people at the fine resolution: geometry alone, nothing is simulated."""
    grid = make_grid("fine")
    start, rows = time.perf_counter(), {}
    for preset in GROUP_PRESETS:
        seeds = range(list(GROUP_PRESETS).index(preset), VOLUNTEERS, len(GROUP_PRESETS))
        smallest, inverted, volume = [], 0, []
        for seed in seeds:
            measures = random_measures(seed, preset=preset, asymmetry=1.0)
            measured = element_quality(shaped_positions(measures, grid), grid.connectivity)
            smallest.append(measured.scaled_jacobian.min())
            inverted += int((measured.smallest_det <= 0).sum())
            volume.append(measured.volume.sum() * 1e6)
        low, five, middle = np.quantile(smallest, [0.0, 0.05, 0.5])
        rows[preset] = {
            "volunteers": len(seeds),
            "inverted elements": inverted,
            "smallest scaled Jacobian: least": low,
            "5 %": five,
            "median": middle,
            "volume (cm3): mean": np.mean(volume),
            "standard deviation": np.std(volume, ddof=1),
        }
    table = pd.DataFrame.from_dict(rows, orient="index").rename_axis("preset")
    took = (time.perf_counter() - start) / VOLUNTEERS
    return f"""The table summarises the fine meshes of {VOLUNTEERS} random volunteers with differences
between the sides (`random_measures(seed, preset=..., asymmetry=1.0)`, seeds 0 to {VOLUNTEERS - 1}).
Each mesh took {1e3 * took:.0f} ms.

{markdown(table.reset_index(), ".2f")}"""


def actions() -> str:
    """Every muscle pair alone."""
    table = muscle_actions(template_face(resolution="fine")).drop(columns=["name"])
    return f"""The table lists displacements of the fine face at 0.8 s with an activation of 0.5,
sigma_max = 100 kPa, no gravity, and lips and teeth in contact by constraints. Displacements are in mm;
x is positive medially (left markers), y forward and z up. `opening` (mm) is the height of the margin
of the upper lip above that of the lower lip in the midline; it is negative where one lip has moved in
front of the other. `lips in lips` (mm) is the depth to which the lips penetrate each other. `agrees`
is true if every displacement that defines the action has the stated direction and exceeds 0.1 mm, and
the lips do not penetrate each other. A muscle whose action is to close the lips must also move both
margins and close at least half of the opening.

{markdown(table.reset_index(), ".2f")}"""


def lips() -> str:
    """Opening between the lips without loads and under muscles that close them."""
    face = template_face(resolution="medium")
    runs = {"OOM 0.5": {"OOM": 0.5}, "OOM 0.5 and MEN 0.3": {"OOM": 0.5, "MEN": 0.3}}
    positions, _ = steady_positions(
        face, [{f"{m}_{s}": a for m, a in run.items() for s in "LR"} for run in runs.values()]
    )
    shown = {"without loads": face["position"].values} | dict(zip(runs, positions, strict=True))
    title = f"{face.attrs['name']}: the lips, simulated"
    shrink(write_figure(states_figure(face, shown, title=title), HERE / "lips.png", dpi=110))
    rim, rows = lip_rim(face), {}
    for name, position in shown.items():
        shape = lip_shape(face, rim, position)
        rows[name] = {"opening (mm)": 1e3 * shape["height"], "area (mm2)": 1e6 * shape["area"]}
    table = pd.DataFrame.from_dict(rows, orient="index").rename_axis("state")
    return f"""Without loads, the lips of the template are apart by the measure `lip_gap`, the opening of
relaxed lips (see the norms below), so that a gap is seen in profile. Muscles that close the lips close
it. The table lists the medium face with sigma_max = 100 kPa, no gravity, and lips and teeth in contact
by constraints; the area is that of the opening in front view.

![The lips without loads and closed by muscles, from three sides](lips.jpg)

{markdown(table.reset_index(), ".2f")}"""


def gestures() -> str:
    """Rest and the six instructions, by the muscles that are relevant for them."""
    fine = template_face(resolution="fine")
    positions = gesture_positions(fine)
    shown = {"rest": fine["position"].values}
    shown |= {f"{name}: {GESTURES[name][0]}": q for name, q in positions.items()}
    title = f"{fine.attrs['name']}: held gestures, simulated"
    shrink(write_figure(states_figure(fine, shown, title=title), HERE / "gestures.png", dpi=110))
    moved = {}
    for name, position in positions.items():
        u = 1e3 * (position - fine["position"].values)[fine["marker_node"].values]
        at = {str(m): u[k] for k, m in enumerate(fine["marker"].values)}
        upper, lower = (
            0.5 * (at[f"{lip}_paramedian_left"] + at[f"{lip}_paramedian_right"])
            for lip in ("upper", "lower")
        )
        moved[name] = {
            "corners apart": at["corner_right"][0] - at["corner_left"][0],
            "left corner up": at["corner_left"][2],
            "right corner up": at["corner_right"][2],
            "corners forward": 0.5 * (at["corner_left"] + at["corner_right"])[1],
            "upper lip up": upper[2],
            "upper lip forward": upper[1],
            "lower lip up": lower[2],
            "lower lip forward": lower[1],
            "mouth to the left": -u[:, 0].mean(),
            "opening": 1e3 * lip_opening(fine, position),
        }
    table = pd.DataFrame.from_dict(moved, orient="index").rename_axis("instruction (mm)")
    rest = 1e3 * lip_opening(fine, fine["position"].values)
    faces = {f"{r} template": template_face(resolution=r) for r in ("coarse", "medium")}
    rows = [smiles(name, face, gesture_positions(face, JUDGED)) for name, face in faces.items()]
    rows.append(smiles("fine template", fine, positions))
    return f"""The table lists simulated displacements from rest caused by the muscles of Table 1 of
Eskes et al. 2017. Lips and teeth are in contact by constraints. The opening is {rest:.2f} mm at rest;
it is negative where the lips have passed through each other.

![Rest and six gestures from three sides](gestures.jpg)

{markdown(table.reset_index(), ".2f")}

### Comparison with published smiles and pursing

The columns contain the following measures. `corner`: displacement of the marker of the left corner.
`direction`: angle of this displacement above the lateral direction in front view. `mouth width`:
change of the distance between the corners of the opening. `lips forward`: mean forward displacement of
the four paramedian markers. `upper margin up`: upward displacement of the margin of the upper lip in
the midline.

{markdown(pd.concat(rows), ".1f")}

In spontaneous smiles of 15 children (mean age 10.5 years), the corners moved up and laterally at about
47 degrees, the mouth widened by 27 %, and the upper lip rose by 28 % (Tarantili et al. 2005, Am J
Orthod Dentofacial Orthop 128:8-15). The levels of activation of the smiles were selected from several
candidates by comparing the motion of the medium face with these values; the agreement is therefore not
a prediction. The coarse and fine faces were not used in this selection. In a published model, the
corner moves by 11 to 14 mm in four expressions, within one standard deviation of the measured
displacements (Flynn et al. 2015, Comput Methods Biomech Biomed Eng 18:571-582). In this template, the
corner moves less, as in the model of Eskes et al. 2017. Pursing by the relevant muscles closes,
narrows and protrudes the lips (Eskes et al. 2017, Results; Stavness et al., Coupled biomechanical
modeling of the face)."""


JUDGED = ("A", "D", "F")
"""Instructions that are compared with publications: pursing and both smiles."""


def smiles(name: str, face: xr.Dataset, positions: dict[str, np.ndarray]) -> pd.DataFrame:
    """Measures of pursing and smiles of a face."""
    rest, rim = face["position"].values, lip_rim(face)
    node = dict(zip(face["marker"].values.tolist(), face["marker_node"].values, strict=True))
    before, top = lip_shape(face, rim, rest), int(face["lip_opening_node"].values[0])
    rows = []
    for instruction in JUDGED:
        q = positions[instruction]
        after = lip_shape(face, rim, q)
        corner = 1e3 * (q - rest)[node["corner_left"]]
        direction = np.degrees(np.arctan2(corner[2], -corner[0])) if instruction != "A" else np.nan
        rows.append(
            {
                "face": name,
                "gesture": GESTURES[instruction][0],
                "corner (mm)": float(np.linalg.norm(corner)),
                "direction (degrees)": float(direction),
                "mouth width (%)": 100.0 * (after["width"] / before["width"] - 1.0),
                "upper margin up (mm)": 1e3 * float((q - rest)[top, 2]),
                "lips forward (mm)": 1e3 * after["protrusion"],
                "opening at rest (mm)": 1e3 * before["height"],
                "opening (mm)": 1e3 * after["height"],
            }
        )
    return pd.DataFrame(rows)


def published() -> str:
    """Pursing and both smiles of the imported face, if its files are available."""
    models = Path(os.environ.get("EMGFACE_SHARED", "../shared")) / "artisynth_models"
    face = import_artisynth(models)
    table = smiles("published face", face, gesture_positions(face, JUDGED))
    return f"""The table lists the same measures of the imported reference face (Nazari et al. 2010;
ArtiSynth Models), simulated with the same activations and the mechanics of the tables above. Lips and
teeth are in contact; the elements within 5 mm of the fibres belong to the muscles.

{markdown(table, ".1f")}

These levels of activation were chosen for the template and do not produce realistic smiles of this
face: the corners move up and back, the mouth widens by 6 % in the voluntary smile and narrows in the
closed-mouth smile. The lips are 4 mm apart at rest. Pursing narrows the mouth and moves the corners
forward, but the paramedian markers hardly move forward, and the lips do not close.
[Mechanics](../mechanics/README.md) compares the protrusion of this face with and without support and
stress stiffening."""


PAIRS = {
    "ZYG": "corner_left",
    "LLSAN": "upper_paramedian_left",
    "OOP": "corner_left",
    "DAO": "corner_left",
}
"""Muscle pairs of the study of convergence, and the marker that is shown."""


def held_from_a_curve(face: xr.Dataset, grid: Grid) -> xr.Dataset:
    """Hold the inner surface outside the perioral curve, which every grid follows."""
    fixed = face["fixed"].values.reshape(grid.shape).copy()
    fixed[:, :, 0] = FREE
    above = face["position"].values.reshape(*grid.shape, 3)[:, :, 0, 2] >= 0.0
    outside = slice(sum(grid.rings[:2]), None)
    fixed[:, outside, 0] = np.where(above, SKULL, MANDIBLE)[:, outside]
    return face.assign(fixed=face["fixed"].copy(data=fixed.ravel()))


def orders(*, on_a_curve: bool) -> pd.DataFrame:
    """Displacement of the lip markers on the refined grids, changes and observed orders."""
    runs = [{f"{muscle}_{side}": 0.3 for side in "LR"} for muscle in PAIRS]
    moved, elements, names = [], [], []
    for k in REFINEMENTS:
        grid = refined_grid(k)
        face = template_face(resolution=grid)
        if on_a_curve:
            face = held_from_a_curve(face, grid)
        position, _ = steady_positions(face, runs, duration=0.6, step=0.1)
        moved.append(1e3 * (position - face["position"].values)[:, face["marker_node"].values])
        elements.append(face.sizes["element"])
        names = [str(name) for name in face["marker"].values]
    rows = {}
    for run, (muscle, marker) in enumerate(PAIRS.items()):
        u = [m[run] for m in moved]
        change = [
            float(np.sqrt(((a - b) ** 2).sum(axis=1).mean()))
            for a, b in zip(u[:-1], u[1:], strict=True)
        ]
        place = names.index(marker)
        row = {
            f"{n} elements": " ".join(f"{value:.2f}" for value in m[place])
            for n, m in zip(elements, u, strict=True)
        }
        row |= {f"change {k + 1}": value for k, value in enumerate(change)}
        row["order 1-2-4"] = float(np.log2(change[0] / change[1]))
        row["order 2-4-8"] = float(np.log2(change[1] / change[2]))
        rows[f"{muscle}: {marker} x y z"] = row
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("displacement (mm)")


def convergence() -> str:
    """Displacement of the lip markers on grids refined in proportion, with the observed order."""
    return f"""The numbers of rays and rings of the coarse grid are multiplied by 1, 2, 4 and 8
(`refined_grid`), so that the edges along the surface are halved each time; the three anatomical layers
are not divided. Each muscle pair has an activation of 0.3. `change` is the root mean square, over the
ten markers, of the difference between the displacements on two successive grids. The observed order is
log2 of the ratio of two changes.

{markdown(orders(on_a_curve=False).reset_index(), ".2f")}

Muscles occupy fractions of elements; the volume of a muscle therefore does not depend on the grid. The
set of fixed nodes does depend on the grid: the border between bone and free lining crosses the rings
and moves by up to one element from grid to grid, which causes an error of first order. In the
following table, the lining is instead fixed outside the perioral curve, which is a ring of nodes on
every grid (a different boundary condition, with different displacements):

{markdown(orders(on_a_curve=True).reset_index(), ".2f")}

With this boundary condition, the orders of ZYG and DAO increase; the border therefore limits them in
the first table. The orders of LLSAN and OOP do not increase consistently, and the cause was not
isolated (possible causes are the kink in the boundary condition and the mouth corner, at which the
rings meet and stresses are singular)."""


def norms() -> str:
    """Means, spreads, sources."""
    return f"""All measures are in mm. In the column `standing`, `found` means that the numbers were
taken from the table cited. `assumption` means that they were quoted without access to the source,
derived or chosen, as stated in the note.

{markdown(norms_table().reset_index(), ".1f")}

The presets describe the following groups of people:

{markdown(pd.DataFrame({"means": GROUP_PRESETS}).rename_axis("preset").reset_index())}"""


PARTS: dict[str, tuple[str, Callable[[], str]]] = {
    "pictures": ("The face", pictures),
    "quality": ("Quality and volume by resolution", quality),
    "volunteers": ("Random volunteers", volunteers),
    "actions": ("Each muscle pair alone", actions),
    "lips": ("Opening between the lips", lips),
    "gestures": ("The six instructions", gestures),
    "published": ("The imported published face", published),
    "convergence": ("Convergence with the mesh", convergence),
    "norms": ("Measures and their sources", norms),
}
INTRODUCTION = """# The template face

The face is generated, and all motions are simulated. `python docs/template/make.py` generates this page.
"""


def main(chosen: list[str]) -> None:
    """Write the chosen parts and keep the others."""
    unknown = set(chosen) - set(PARTS)
    if unknown:
        raise SystemExit(
            f"unknown part {sorted(unknown)[0]!r}, expected some of {', '.join(PARTS)}"
        )
    page = HERE / "README.md"
    old = page.read_text(encoding="utf-8") if page.exists() else ""
    texts = dict(re.findall(r"^## (.+?)\n\n(.*?)(?=\n\n## |\Z)", old, flags=re.M | re.S))
    for name, (title, make) in PARTS.items():
        if not chosen or name in chosen:
            print(name, flush=True)
            try:
                texts[title] = make().strip()
            except FaceError as error:
                if name != "published":
                    raise
                print(f"not made: {error}", flush=True)
            parts = [f"## {t}\n\n{texts[t].strip()}\n" for t, _ in PARTS.values() if t in texts]
            page.write_text("\n".join([INTRODUCTION, *parts]), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
