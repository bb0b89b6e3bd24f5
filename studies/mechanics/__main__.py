"""Generate the tables and pictures of `docs/mechanics`.

python -m studies.mechanics                          template face, then the page
python -m studies.mechanics --face FACE.nc --out DIR  any other face; numbers and pictures to DIR
python -m studies.mechanics --page                    the page only, from the stored tables
"""

from pathlib import Path
from typing import Annotated

import pandas as pd
import typer
import xarray as xr

from benchmarks.report import face_of, markdown, say, shrink
from emgface.face.simulation_parameters import SimulationParameters
from emgface.pictures.stills import states_figure, write_figure
from studies.mechanics.expressions import EXPRESSIONS, SKINS, express, summary
from studies.mechanics.lip_rounding import round_lips
from studies.mechanics.skin_probe import probe_skin

HERE = Path(__file__).resolve().parents[2] / "docs" / "mechanics"
RESOLUTION = "medium"
STRESSES = (0.0, 15.9e3, 40e3, 89.4e3)

PAGE = """# Lips, expressions and skin

All results on this page are simulated. `python -m studies.mechanics` generates the tables and
pictures of the template face; with `--face` and `--out` it generates those of any other face.
Contact of the lips is switched off; `overlap` is the area in which the lips pass through each
other. "Walls" are frictionless unilateral supports with a stiffness of 1000 N/m behind every free
node of the inner surface; they represent teeth and bone. The simulations include no gravity, the
largest muscle stress is 100 kPa, and the pressure is computed at each Gauss point. The quasi-static
solver computes the equilibria.

## Interpretation

**Lip rounding.** The peripheral part of orbicularis oris on both sides is activated to 0.5 and 1.
`stiffening` is the factor on the passive moduli of the muscle's elements at full activation; 1
means no stiffening (Stavness et al., Fig. 11.10). With stiffening, the shape of the lips changes
less between half and full activation: on both faces, with and without walls, the opening changes
0.14 to 0.41 times as much as without stiffening, and the protrusion changes 0.40 to 0.67 times as
much. Without walls and without stiffening, the lower lip of the reference face is drawn beneath the
upper lip at activations between 0.4 and 0.5; with stiffening, the lower lip is not drawn beneath
the upper lip. With walls, the lips protrude further (Fig. 11.12); without walls, the lips of the
reference face retract. At a given activation, stiffening reduces the protrusion.

**Expressions.** The publication states no activations; the activations used here are listed in
`studies.mechanics.expressions.EXPRESSIONS`. Landmarks are the ten lip markers, the lip margins in
the midline, chin and cheeks. For every skin without tension, the mouth corner is the landmark with
the largest displacement in each of the four expressions. A stiffer skin, isotropic or orthotropic
as in the publication (young to old), reduces the displacements in both smiles on both faces; this
agrees with the publication. The exception is the expression with lips turned downwards on the
reference face, in which the stiffest skin of either kind increases the displacement of the corners
by 6 %. The effect of tension depends on the expression, which also agrees with the publication. For
lips turned downwards, the landmark with the largest displacement depends on the chosen activations:
on the reference face, the depressor of the lower lip, at an activation of only 0.1, moves the chin
and the lower lip further than the depressor of the corner, at an activation of 0.7, moves the
corner.

**Skin under tension.** Two probes, 16 mm apart, pull at the skin within a fixed ring of 30 mm
radius, along and across the local tension line. The orientation of the tension lines follows a
rule: the lines are perpendicular to the muscles beneath the skin. On the reference face, to which
the published orientations were transferred by node numbers, the median deviation of this rule from
these orientations is 14 degrees around the mouth and 18 degrees in the upper face. In the cheeks it
is 50 degrees; there the rule is no better than chance. In a fixed block, the stress equals the
prescribed tension. Tensions of 15.9 and 89.4 kPa increase the stiffness of this block from 14.9 kPa
to 61.6 and 248 kPa along the line, and to 19.6 and 29.6 kPa across the line (`tests/verification`).
On a face, the stress relaxes within the ring, and the tissue beneath the skin is isotropic. Tension
therefore increases the stiffness in both directions: a tension of 89.4 kPa increases the stiffness
along and across the line by factors of 2.4 and 1.8 on the reference face, and by factors of 2.2 and
2.1 on the template.

## Survival

The tables list the largest sigma_max (kPa), from a grid of 25 to 1000 kPa, at which no element
inverts when one muscle pair alone or all twenty muscles together are activated. The tables refer to
the reference face; the activation rises from 0 to 1 in 0.1 s and is then held, and the steps are
10 ms long. The value 0 means that elements invert even at 25 kPa, and the value 1000 is the end of
the grid. `python -m benchmarks survival` (commit `9c2599bc`) writes `survival.csv`, which
contains all attempts.

{survival}

{faces}
"""


def rounding(face: xr.Dataset, out: Path) -> None:
    """Lip rounding: table and pictures."""
    result = round_lips(face, progress=say)
    result.table.round(4).to_csv(out / "rounding.csv", index=False)
    shown = {
        f"{'stiffening' if factor > 1 else 'no stiffening'}, activation {level:g}": result.motion[
            True, factor
        ]["node_position"]
        .sel(level=level)
        .values
        for factor in (1.0, 10.0)
        for level in (0.5, 1.0)
    }
    title = f"{face.attrs['name']}: orbicularis oris, walls for teeth, no lip contact; simulated"
    figure = states_figure(
        face, shown, title=title, views=("front", "left"), displacement=True, lips=True
    )
    shrink(write_figure(figure, out / "rounding.png", dpi=80))


def expressions(face: xr.Dataset, out: Path) -> None:
    """Expressions: table of landmarks and a picture."""
    table, positions = express(face, progress=say)
    table.round(4).to_csv(out / "landmarks.csv", index=False)
    summary(table).round(4).to_csv(out / "expressions.csv", index=False)
    shown = {name: positions[name, SKINS[0].name] for name in EXPRESSIONS}
    title = f"{face.attrs['name']}: expressions, walls for teeth, no lip contact; simulated"
    figure = states_figure(
        face, shown, title=title, views=("front", "left"), displacement=True, lips=True
    )
    shrink(write_figure(figure, out / "expressions.png", dpi=80))


def probes(face: xr.Dataset, out: Path) -> None:
    """Stiffness of the skin under prestress, as a table."""
    rows = []
    for stress in STRESSES:
        say(f"probe, {stress / 1e3:g} kPa")
        method = "stretch" if stress else "none"
        p = SimulationParameters.model_validate(
            {
                "gravity": False,
                "sigma_max": 100e3,
                "contact": {"method": "none"},
                "skin": {"kappa": 250e3},
                "prestress": {"method": method, "along": stress},
            }
        )
        table = probe_skin(face, p)
        ratio = table["along (N/m)"] / table["across (N/m)"]
        rows.append(
            {
                "tension (kPa)": stress / 1e3,
                "along, median (N/m)": table["along (N/m)"].median(),
                "across, median (N/m)": table["across (N/m)"].median(),
                "along / across, median": ratio.median(),
            }
        )
    pd.DataFrame(rows).round(4).to_csv(out / "probe.csv", index=False)


def lips_table(folder: Path) -> str:
    """Lip rounding at half and full activation."""
    table = pd.read_csv(folder / "rounding.csv")
    table = table[table.activation.isin([0.0, 0.5, 1.0])]
    table = table[~((table.activation == 0.0) & (table.support | (table.stiffening > 1.0)))]
    table = table.assign(
        walls=table.support.map({True: "yes", False: "no"}),
        stiffening=table.stiffening.map(lambda s: f"{s:g}"),
        activation=table.activation.map(lambda a: f"{a:g}"),
    )
    columns = ["walls", "stiffening", "activation", "protrusion (mm)", "margin_protrusion (mm)"]
    columns += ["height (mm)", "width (mm)", "area (mm2)", "overlap (mm2)", "roundness (1)"]
    return markdown(table[[*columns, "smallest det F"]], ".2f")


def survival_table() -> str:
    """Largest surviving sigma_max by solver, from the attempts."""
    attempts = pd.read_csv(HERE / "survival.csv")
    parts = []
    for (kind, duration), own in attempts.groupby(["incompressibility", "duration_s"], sort=False):
        best = own[own.survived].groupby(["muscle", "solver"])["sigma_max_kPa"].max().unstack()
        order = [m for m in dict.fromkeys(own.muscle)]
        solvers = list(dict.fromkeys(own.solver))
        best = best.reindex(index=order, columns=solvers).fillna(0).astype(int)
        table = markdown(best.rename_axis("muscle pair").reset_index(), ".2f")
        parts.append(f"With {kind} volume and the activation held until {duration:g} s:\n\n{table}")
    return "\n\n".join(parts)


def page() -> str:
    """Text of the page, from the tables."""
    sections = []
    for folder, name in (
        (HERE / "template", "Template face"),
        (HERE / "reference", "Reference face"),
    ):
        if not (folder / "rounding.csv").exists():
            continue
        pictures = (folder / "rounding.png").exists()
        text = [f"## {name}", "### Lip rounding", lips_table(folder)]
        if pictures:
            text.append(f"![Lips rounded by orbicularis oris]({folder.name}/rounding.png)")
        text += ["### Expressions", markdown(pd.read_csv(folder / "expressions.csv"), ".2f")]
        if pictures:
            text.append(f"![Four expressions]({folder.name}/expressions.png)")
        text += ["### Skin under tension", markdown(pd.read_csv(folder / "probe.csv"), ".2f")]
        sections.append("\n\n".join(text))
    body = PAGE.replace("{survival}", survival_table()).replace("{faces}", "\n\n".join(sections))
    return body.rstrip() + "\n"


def main(
    face: Path | None = None,
    out: Path | None = None,
    page_only: Annotated[bool, typer.Option("--page")] = False,
) -> None:
    """Compute the results specified by the options."""
    if not page_only:
        if face and out is None:
            raise SystemExit("--face needs --out, a folder for its numbers and pictures")
        model, folder = face_of(face, RESOLUTION), out or HERE / "template"
        folder.mkdir(parents=True, exist_ok=True)
        for make in (rounding, expressions, probes):
            make(model, folder)
    if not face:
        (HERE / "README.md").write_text(page(), encoding="utf-8")


if __name__ == "__main__":
    typer.run(main)
