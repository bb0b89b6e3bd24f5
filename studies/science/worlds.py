"""How the scores fall from volunteers that match the study's assumptions to those that do not."""

from collections.abc import Mapping
from pathlib import Path

import xarray as xr


def make(studies: Mapping[str, Path], out: Path) -> str:
    """Tabulate the median rho of every strategy in every world."""
    lines = ["## Worlds", ""]
    for world, folder in studies.items():
        with xr.open_dataset(folder / "cube.nc") as cube:
            median = cube["rho"].median(["volunteer", "instruction", "repetition", "marker"])
            told = ", ".join(
                f"{name} {float(value):.2f}"
                for name, value in zip(cube["strategy"].values, median.values, strict=True)
            )
        lines.append(f"* {world} world (simulated): median rho {told}.")
    return "\n".join(lines) + "\n"
