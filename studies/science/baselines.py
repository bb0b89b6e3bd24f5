"""rho of every world beside what scores without the EMG of the trial."""

from collections.abc import Mapping
from pathlib import Path

import xarray as xr

from analysis.axes import reference_cube
from analysis.baseline_tables import comparison
from analysis.figures import baseline_plot, save
from emgface.files import replace_file
from emgface.schema.netcdf import read_netcdf

HEAD = """## What a rho of 0.9 means

A correlation says little before it is known what scores without the EMG of the person. After the same
alignment each trial is therefore also compared with the mean motion of the other volunteers at the same
instruction (template); with another repetition of the person, from which follows the ceiling of all
motions that are the same in every repetition; with the simulated motion of the other instructions, and
with that of another repetition (EMG shuffled over trials). `docs/statistics.md` defines them.
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
    told, tables = comparison(cube)
    if not tables:
        lacking = told or ["The cube holds no baselines: run its study again."]
        return [f"### {world.capitalize()} world (simulated)", "", *lacking, ""]
    figure = f"baselines_{world}.svg"
    save(baseline_plot(cube), out / figure)
    lines = [f"### {world.capitalize()} world (simulated)", "", *(f"* {one}" for one in told), ""]
    lines += [f"![rho beside its baselines, {world} world (simulated)]({figure})", ""]
    for name, table in tables.items():
        text = table.csv()
        replace_file(
            out / f"{name}_{world}.csv",
            lambda path, text=text: path.write_text(text, encoding="utf-8"),
        )
        if name != "baselines_instruction":
            lines += [table.markdown(), ""]
    return lines
