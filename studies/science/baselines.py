"""Compare rho in every world with baselines that do not use the EMG of the trial."""

from collections.abc import Mapping
from pathlib import Path

import xarray as xr

from analysis.axes import reference_cube
from analysis.baseline_tables import comparison
from analysis.figures import baseline_plot, save
from emgface.files import replace_file
from emgface.schema.netcdf import read_netcdf

HEAD = """## Interpretation of a rho of 0.9

A correlation can be interpreted only by comparison with baselines that do not use the EMG of the trial.
After the same alignment, each trial is therefore also compared with the mean motion of the other
volunteers for the same instruction (template); with another repetition of the person, which determines
the highest score of a motion that is the same in every repetition (ceiling); with the simulated motion
of the other instructions; and with the simulated motion of another repetition (EMG shuffled over
trials). `docs/statistics.md` defines these baselines.
"""


def make(studies: Mapping[str, Path], out: Path) -> str:
    """Draw and tabulate the baselines of every world."""
    lines = [HEAD]
    for world, folder in studies.items():
        cube = reference_cube(read_netcdf(folder / "cube.nc", "cube"))
        lines += _of_world(cube, world, out)
    return "\n".join(lines) + "\n"


def _of_world(cube: xr.Dataset, world: str, out: Path) -> list[str]:
    """Write figure and tables of one world; return the Markdown that shows them."""
    sentences, tables = comparison(cube)
    if not tables:
        lacking = sentences or ["The cube contains no baselines; run its study again."]
        return [f"### {world.capitalize()} world (simulated)", "", *lacking, ""]
    figure = f"baselines_{world}.svg"
    save(baseline_plot(cube), out / figure)
    lines = [
        f"### {world.capitalize()} world (simulated)",
        "",
        *(f"* {one}" for one in sentences),
        "",
    ]
    lines += [f"![rho and its baselines, {world} world (simulated)]({figure})", ""]
    for name, table in tables.items():
        text = table.csv()
        replace_file(
            out / f"{name}_{world}.csv",
            lambda path, text=text: path.write_text(text, encoding="utf-8"),
        )
        if name != "baselines_instruction":
            lines += [table.markdown(), ""]
    return lines
