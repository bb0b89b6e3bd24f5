"""Tables and pictures of datasets, for commands."""

from pathlib import Path

import numpy as np
import xarray as xr

from emgface.cli.console import Rows
from emgface.errors import DataError


def activation_rows(activation: xr.Dataset) -> Rows:
    """List mean and peak activation per muscle, left and right."""
    values = activation["activation"]
    head = ("muscle", "mean left", "mean right", "peak left", "peak right")
    rows = []
    for name in dict.fromkeys(str(m).rsplit("_", 1)[0] for m in values["muscle"].values):
        sides = [values.sel(muscle=f"{name}_{side}") for side in "LR"]
        numbers = [float(s.mean()) for s in sides] + [float(s.max()) for s in sides]
        rows.append((name, *(f"{number:.2f}" for number in numbers)))
    return Rows(head, tuple(rows))


def score_rows(scores: xr.Dataset) -> Rows:
    """List the scores of every marker."""
    head = ("marker", "rho", "amplitude ratio", "rmse [mm]", "reason")
    rows = [
        (
            str(marker),
            f"{float(s['rho']):.3f}",
            f"{float(s['amplitude_ratio']):.2f}",
            f"{1e3 * float(s['rmse']):.2f}",
            str(s["reason"].item()),
        )
        for marker in scores["marker"].values
        for s in [scores.sel(marker=marker)]
    ]
    rows.append(("median", f"{float(np.nanmedian(scores['rho'])):.3f}", "", "", ""))
    return Rows(head, tuple(rows))


def draw_activation(activation: xr.Dataset, path: Path) -> None:
    """Draw the activation over time, left solid and right dashed; list inactive muscles.

    Raises DataError if the format of the picture is unknown or it cannot be written.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    values = activation["activation"]
    every = list(dict.fromkeys(str(m).rsplit("_", 1)[0] for m in values["muscle"].values))
    silent = [n for n in every if not values.sel(muscle=[f"{n}_L", f"{n}_R"]).any()]
    names = [name for name in every if name not in silent] or every
    figure = Figure(figsize=(8, 1.5 + 0.9 * len(names)), layout="constrained")
    FigureCanvasAgg(figure)
    panels = np.atleast_1d(figure.subplots(len(names), 1, sharex=True))
    for panel, name in zip(panels, names, strict=True):
        for side, line in (("L", "-"), ("R", "--")):
            one = values.sel(muscle=f"{name}_{side}")
            panel.plot(one["time"], one, line, color="black", lw=1, label=side)
        panel.set(ylim=(0, 1), ylabel=name)
    panels[0].legend(ncols=2, fontsize="small", loc="upper right")
    panels[-1].set_xlabel("time [s]")
    attrs = activation.attrs
    label = [str(attrs.get(k, "")) for k in ("volunteer", "instruction", "repetition", "strategy")]
    title = f"muscle activation [1], {' '.join(filter(None, label))} ({attrs['origin']})"
    if silent and len(silent) < len(every):
        title += f"\nwithout activation: {', '.join(silent)}"
    figure.suptitle(title, fontsize="medium")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, dpi=150)
    except (OSError, ValueError) as error:
        raise DataError(f"{path} cannot be written as a picture: {error}") from error
