"""Signs of contradicting signals in recordings as they are, with exchanged sides, and shifted in time.

    python -m benchmarks inverse-doubts RECORDING.nc ...

The sides of the sEMG are exchanged, or it is moved by 0.4 s, in a circle. Printed are the attributes by
from which `emgface.inverse.doubts` decides, and its warnings.
"""

from pathlib import Path

import pandas as pd
import xarray as xr

from benchmarks.inverse import SIMULATION
from benchmarks.report import markdown
from emgface.face.motion import settle_face
from emgface.face.template import template_face
from emgface.inverse.doubts import doubts, signs
from emgface.inverse.parameters import InverseParameters
from emgface.inverse.problem import pose_problem
from emgface.recordings.dataset import read_recording
from emgface.signals.parameters import SignalChain

SHIFT = 0.4
"""Time by which the sEMG is moved [s]."""


def changed(recording: xr.Dataset) -> dict[str, xr.Dataset]:
    """The recording, with exchanged sides, and with its sEMG late and early."""
    names = [f"{c[:-1]}{'R' if c[-1] == 'L' else 'L'}" for c in recording["channel"].values]
    period = float(recording["time_emg"][1] - recording["time_emg"][0])
    found = {"as it is": recording, "exchanged": recording.assign_coords(channel=names)}
    for label, sign in (("late", 1), ("early", -1)):
        moved = recording["emg"].roll(time_emg=sign * round(SHIFT / period))
        found[label] = recording.assign(emg=moved)
    return found


def main(recordings: list[Path]) -> None:
    """Pose every recording on the template face and print its signs."""
    face = template_face(resolution="coarse")
    rest, rows = settle_face(face, SIMULATION), []
    usual = {"sigma_max": 115e3, "rest_ratio": 0.0, "misfit_ratio": 0.0}
    for path in recordings:
        for label, one in changed(read_recording(path)).items():
            posed = pose_problem(
                one, face, SIMULATION, SignalChain(), InverseParameters(), settled=rest
            )
            found = signs(posed, one, True)
            told = len(doubts(xr.Dataset(attrs=usual | found)))
            rows.append({"trial": path.stem, "sEMG": label} | found | {"told": told})
    print(markdown(pd.DataFrame(rows), ".2f"), flush=True)
