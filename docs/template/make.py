"""Make the pictures and tables of the template face in this folder: python docs/template/make.py."""

import time
from pathlib import Path

import numpy as np
import pandas as pd
from PIL import Image

from emgface.face.check import face_report
from emgface.face.show import draw_face
from emgface.face.template import PRESETS, norms_table, template_face
from emgface.face.template.actions import muscle_actions, steady_positions
from emgface.face.template.gestures import draw_gestures, gesture_positions

HERE = Path(__file__).parent
RESOLUTIONS = ("coarse", "medium", "fine", 11_520)


def shrink(path: Path) -> None:
    """Store a picture with 64 colours; shading needs few."""
    with Image.open(path) as picture:
        picture.convert("RGB").quantize(64).save(path, optimize=True)


def markdown(table: pd.DataFrame, digits: int = 2) -> str:
    """Format a table for a page."""
    table = table.reset_index()

    def cell(value: object) -> str:
        return f"{value:.{digits}f}" if isinstance(value, float) else str(value)

    rows = [list(map(str, table.columns)), ["---"] * len(table.columns)]
    rows += [[cell(value) for value in row] for row in table.itertuples(index=False)]
    return "\n".join("| " + " | ".join(row) + " |" for row in rows)


def quality() -> pd.DataFrame:
    """Quality and volume by resolution."""
    rows = {}
    for resolution in RESOLUTIONS:
        start = time.perf_counter()
        face = template_face(resolution=resolution)
        seconds = time.perf_counter() - start
        value = face_report(face).summary["value"]
        rows[str(resolution)] = {
            "elements": int(value["elements"]),
            "free nodes": int(value["free nodes"]),
            "smallest scaled Jacobian": value["smallest scaled Jacobian of hexahedra"],
            "1 %": value["1 % of scaled Jacobian of hexahedra"],
            "median": value["median scaled Jacobian of hexahedra"],
            "below 0.3": int(value["hexahedra with scaled Jacobian below 0.3"]),
            "smallest edge (mm)": value["smallest edge length"],
            "largest edge ratio": value["largest edge ratio"],
            "volume (cm3)": value["volume"] * 1e-3,
            "built in (s)": seconds,
        }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("resolution")


def presets() -> pd.DataFrame:
    """Quality of the means of every group at the fine resolution."""
    rows = {}
    for preset in PRESETS:
        value = face_report(template_face(resolution="fine", preset=preset)).summary["value"]
        rows[preset] = {
            "smallest scaled Jacobian": value["smallest scaled Jacobian of hexahedra"],
            "volume (cm3)": value["volume"] * 1e-3,
        }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("preset")


def convergence() -> pd.DataFrame:
    """Displacement of the lip markers over four resolutions, two muscle pairs at 0.3."""
    pairs = {"ZYG": "corner_left", "LLSAN": "upper_paramedian_left"}
    runs = [{f"{muscle}_{side}": 0.3 for side in "LR"} for muscle in pairs]
    moved = []
    rows: dict[str, dict[str, float]] = {}
    for resolution in RESOLUTIONS:
        face = template_face(resolution=resolution)
        nodes = face["marker_node"].values
        position, _ = steady_positions(face, runs, duration=0.6, step=0.1)
        moved.append(1e3 * (position - face["position"].values)[:, nodes])
    names = [str(name) for name in face["marker"].values]
    for k, resolution in enumerate(RESOLUTIONS):
        row: dict[str, float] = {}
        for run, (muscle, marker) in enumerate(pairs.items()):
            u = moved[k][run, names.index(marker)]
            row |= {f"{muscle}: {marker} {axis}": float(u["xyz".index(axis)]) for axis in "xyz"}
            miss = moved[k][run] - moved[-1][run]
            row[f"{muscle}: rms of all markers to the finest"] = float(
                np.sqrt((miss**2).sum(axis=1).mean())
            )
        rows[str(resolution)] = row
    return (
        pd.DataFrame.from_dict(rows, orient="index")
        .rename_axis("resolution")
        .T.rename_axis("displacement (mm)")
    )


def main() -> None:
    """Write everything."""
    fine = template_face(resolution="fine")
    shrink(draw_face(fine, HERE / "face.png", dpi=80))
    shrink(draw_gestures(fine, gesture_positions(fine), HERE / "gestures.png", dpi=60))
    actions = muscle_actions(fine).drop(columns=["name"])
    norms = norms_table()
    page = f"""# The template face

Everything here is generated; every motion is simulated. `python docs/template/make.py` makes it anew.

![Skin, markers, muscles and attachments](face.png)

## Quality and volume by resolution

{markdown(quality())}

## Presets, fine

{markdown(presets())}

## Each muscle pair alone

Fine face, activation 0.5, sigma_max 100 kPa, no gravity, no contact, at 0.8 s; displacement in mm,
x positive medially (left markers), y forward, z up. `agrees`: every sign of the action.

{markdown(actions)}

## The six instructions

Held gestures, without contact: lips pass through each other and through the place of the teeth.

![Rest and six gestures](gestures.png)

## Convergence

{markdown(convergence())}

## Measures (mm)

{markdown(norms, 1)}
"""
    (HERE / "README.md").write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
