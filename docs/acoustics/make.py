"""Motion for the picture of the acoustics page: lips that close and open (simulated)."""

from pathlib import Path

import numpy as np
import typer
import xarray as xr

import emgface as ef
from emgface.face.file import save_face
from emgface.muscles import MUSCLES
from emgface.schema.netcdf import write_netcdf


def main(out: Path) -> None:
    face = ef.face(resolution="coarse")
    time = np.linspace(0.0, 0.6, 61)
    level = np.interp(time, [0.0, 0.1, 0.2, 0.3, 0.36, 0.6], [0.0, 0.0, 0.7, 0.7, 0.0, 0.0])
    values = np.array([level * name.startswith(("OOP", "OOM")) for name in MUSCLES])
    drive = xr.DataArray(
        values, {"muscle": list(MUSCLES), "time": time}, ("muscle", "time"), attrs={"units": "1"}
    )
    none = {"method": "none"}
    motion = ef.simulate(drive, face, accuracy="draft", surface=True, contact=none, support=1000.0)
    save_face(face, out / "face.nc")
    write_netcdf(motion, out / "apa.nc", "trajectory")


if __name__ == "__main__":
    typer.run(main)
