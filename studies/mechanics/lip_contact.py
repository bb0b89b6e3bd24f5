"""Contact of lips with each other and with teeth: closing, gestures, support of the teeth, friction.

    python -m studies.mechanics.lip_contact  template face, tables and pictures
    python -m studies.mechanics.lip_contact --face FACE.nc --out DIR  any other face
    python -m studies.mechanics.lip_contact --part closing --part teeth  some of the parts

closing   both parts of orbicularis oris at full activation, held for 1 s, with and without contact
gestures  the held gestures of the six instructions
friction  closing with friction 0.3
teeth     protrusion with and without support by the teeth
"""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import typer
import xarray as xr

from analysis.figures import save
from analysis.figures.style import COLOURS, MARKS, blank, grid, legend, styled
from benchmarks.contact import CLOSING, METHODS, STEPPING, contact_table, measure
from benchmarks.report import face_of, shrink
from emgface.face.muscle_parameters import SIGMA_MAX
from emgface.face.simulation_parameters import SimulationParameters
from emgface.face.template.gestures import GESTURES
from emgface.pictures.sections import draw_sections
from emgface.pictures.stills import states_figure, write_figure
from studies.mechanics.teeth_support import BACKING, protrude_lips

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FACTORS = (1.0, 10.0)  #: of the stiffening of the muscles with their activation
DOCS = Path(__file__).resolve().parents[2] / "docs" / "contact"


def compare_methods(
    face: xr.Dataset,
    out: Path,
    name: str,
    cases: Sequence[str],
    hold: float,
    friction: float = 0.0,
) -> xr.Dataset:
    """Run cases with several methods; write table, figure and a section of every case."""
    results = measure(
        face,
        cases=cases,
        friction=friction,
        hold=hold,
        parameters=SimulationParameters(sigma_max=SIGMA_MAX, gravity=False, **STEPPING),
    )
    table = contact_table(results)
    table.round(6).to_csv(out / f"{name}.csv", index=False)
    title = f"opening of the lips, {face.attrs['name']} (simulated)"
    shrink(save(_opening_figure(results["opening"], title), out / f"{name}-opening.png"))
    for case in cases:
        shown = {"rest": face["position"].values}
        for method in METHODS:
            label = "no contact" if method == "none" else method
            shown[label] = results["node_position"].sel(case=case, contact=method).values
        title = f"{face.attrs['name']}: {case}, section in the midline (simulated)"
        path = draw_sections(face, shown, out / f"{name}-{case}.png", title=title, dpi=80)
        shrink(path)
    print(f"\n{table.round(4).to_string(index=False)}", flush=True)
    return results


@styled
def _opening_figure(opening: xr.DataArray, title: str) -> "Figure":
    """Opening of the lips over time, one panel per case and one line per kind of contact."""
    cases, kinds = opening["case"].values, opening["contact"].values
    across = min(3, len(cases))
    rows = -(-len(cases) // across)
    figure = blank(7.0 if across == 1 else 3.6 * across, 3.0 * rows + 0.8)
    panels = [panel for row in grid(figure, rows, across, sharex=True) for panel in row]
    lines = []
    for panel, case in zip(panels, cases, strict=False):
        drawn = opening.sel(case=case)
        marked = MARKS if opening.sizes["time"] < 30 else [""] * len(MARKS)
        lines = [
            panel.plot(
                opening["time"], 1e3 * drawn.sel(contact=kind), color=COLOURS[k], marker=marked[k]
            )[0]
            for k, kind in enumerate(kinds)
        ]
        panel.set(xlabel="time [s]", ylabel="opening of the lips [mm]", title=str(case))
    for panel in panels[len(cases) :]:
        panel.set_visible(False)
    legend(figure, lines, [str(kind) for kind in kinds])
    figure.suptitle(title)
    return figure


def teeth(face: xr.Dataset, out: Path) -> None:
    """Protrusion without contact, with that of the lips, and with teeth, for several stiffenings."""
    table, motion = protrude_lips(face, stiffening=FACTORS, progress=print)
    free = table["touching"] == "nothing"
    table.insert(1, "contact", free.map({True: "none", False: "constraint"}))
    table.round(6).to_csv(out / "teeth.csv", index=False)
    print(table.round(3).to_string(index=False), flush=True)
    for factor in FACTORS:
        shown = {"rest": face["position"].values}
        for (name, own), simulated in motion.items():
            if own == factor:
                label = name if BACKING[name] else "no contact"
                shown[label] = simulated["node_position"].values[-1]
        title = (
            f"{face.attrs['name']}: orbicularis oris (peripheral) at 1, stiffening {factor:g} "
            "(simulated)"
        )
        shrink(draw_sections(face, shown, out / f"teeth-{factor:g}.png", title=title, dpi=70))
        path = out / f"teeth-{factor:g}-outside.png"
        figure = states_figure(
            face, shown, title=title, views=("front", "left"), displacement=True, lips=True
        )
        shrink(write_figure(figure, path, dpi=80))


def main(
    face: Path | None = None,
    out: Path = DOCS / "template",
    part: list[str] = ["closing", "gestures", "friction", "teeth"],  # noqa: B006
) -> None:
    """Measure, draw and store."""
    model = face_of(face, "medium")
    out.mkdir(parents=True, exist_ok=True)
    if "closing" in part:
        compare_methods(model, out, "closing", (CLOSING,), 1.0)
    if "gestures" in part:
        compare_methods(model, out, "gestures", tuple(GESTURES), 0.3)
    if "friction" in part:
        compare_methods(model, out, "friction", (CLOSING,), 0.5, friction=0.3)
    if "teeth" in part:
        teeth(model, out)


if __name__ == "__main__":
    typer.run(main)
