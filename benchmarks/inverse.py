"""Activations of simulated volunteers from their markers and sEMG: errors and coverage of each setting.

    python -m benchmarks inverse RECORDING.nc ... [--only S01_A_1,S02_D_1] [--out FIGURE.png]
        [--settings "step:motion trajectory:assisted:10"] [--sigma-max 115e3] [--step 0.02]
        [--calibration CALIBRATION.nc] [--results FOLDER]
    python -m benchmarks inverse RECORDING.nc ... --truth

The recordings contain their true activation. The face that inverts is the coarse template without
contact and gravity, so that shape, tissue and strength of every volunteer differ from it. Compared are
all twenty muscles over the whole trial. Two markers are left out of the targets. A setting is a form, a
variant and the weight of the sEMG. Results are kept in the folder `--results`, from which a repeated
command continues. `--truth` moves the template by the true activation times the true
strengths, with and without contact and the laws of the volunteer, and prints how far its markers are
from the recorded ones. The row "others" is the null hypothesis that needs neither markers nor sEMG of
the person: the mean true activation of the other volunteers in the same instruction, shifted in time to
the onset of the motion.
"""

import json
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pandas as pd
import typer
import xarray as xr

import sim
from analysis.figures.style import COLOURS, blank, save, styled
from benchmarks.report import markdown, say
from emgface.face.motion import settle_face, simulate_face
from emgface.face.simulation_parameters import SimulationParameters
from emgface.face.template import template_face
from emgface.inverse.calibration import Calibration
from emgface.inverse.markers import targets_of
from emgface.inverse.parameters import InverseParameters
from emgface.inverse.run import invert
from emgface.recordings.dataset import read_recording
from emgface.schema.netcdf import read_netcdf

ACTIVE = 0.05
"""True activation above which a muscle counts as active."""
DEFAULT = (
    "step:driven step:hybrid step:motion step:assisted step:assisted:10 trajectory:motion "
    "trajectory:assisted"
)
HELD_OUT = ("upper_paramedian_left", "lower_lateral_right")
SIMULATION = SimulationParameters(
    solver="linearly_implicit", gravity=False, contact={"method": "none"}
)


def parsed(text: str) -> InverseParameters:
    """Setting from a form, a variant and the weight of the sEMG, such as "step:assisted:10"."""
    form, variant, weight = (text + ":1").split(":")[:3]
    return InverseParameters(
        variant=variant, form=form, emg_weight=float(weight), left_out=HELD_OUT
    )


def measures(
    found: xr.Dataset, recording: xr.Dataset, face: xr.Dataset, rest, simulation=SIMULATION
) -> dict[str, float]:
    """Errors of activations against the truth, and of the markers of a forward simulation."""
    at = found["time"].values
    truth = recording["true_activation"].interp(time_true=at).sel(muscle=found["muscle"].values)
    a, b = found["activation"].values, truth.values
    moved = simulate_face(face, found["activation"], simulation, settled=rest)
    wanted = targets_of(recording, face, rest, at)
    x = moved["position"].interp(time=at - at[0]).transpose("time", "marker", "axis").values
    gap = x - wanted.values
    distance = np.sqrt(np.nanmean((gap**2).sum(axis=2), axis=0))
    out = np.isin(wanted["marker"].values, HELD_OUT)
    inferred = ("LAO", "BUC", "OOM", "DLI")
    recorded = np.array([not m.startswith(inferred) for m in found["muscle"].values])
    covered = covered_active = np.nan
    if "activation_low" in found:
        inside = (found["activation_low"].values <= b) & (b <= found["activation_high"].values)
        covered, covered_active = float(inside.mean()), float(inside[b > ACTIVE].mean())
    return {
        "correlation": correlation(a, b),
        "without electrode": correlation(a[~recorded], b[~recorded]),
        "rms": np.sqrt(np.mean((a - b) ** 2)),
        "slope": np.polyfit(b.ravel(), a.ravel(), 1)[0],
        "in the interval [%]": 100.0 * covered,
        f"above {ACTIVE} [%]": 100.0 * covered_active,
        "tracked [mm]": 1e3 * np.sqrt(np.mean(distance[~out] ** 2)),
        "left out [mm]": 1e3 * np.sqrt(np.mean(distance[out] ** 2)),
    }


def correlation(a: np.ndarray, b: np.ndarray) -> float:
    return np.nan if a.std() == 0.0 else float(np.corrcoef(a.ravel(), b.ravel())[0, 1])


def others(path: Path, recordings: list[Path], face: xr.Dataset, rest) -> xr.Dataset | None:
    """Mean true activation of the other volunteers in the same instruction, None if there are none."""
    recording = read_recording(path)
    at = recording["time_marker"].values
    names = [str(m) for m in face["muscle"].values]
    start, found = _onset(recording, face, rest), []
    for other in map(read_recording, recordings):
        if other.attrs["instruction"] != recording.attrs["instruction"]:
            continue
        if other.attrs["volunteer"] != recording.attrs["volunteer"]:
            shifted = at - start + _onset(other, face, rest)
            truth = other["true_activation"].sel(muscle=names)
            # Recordings begin and end at rest.
            truth = truth.interp(time_true=shifted, kwargs={"fill_value": 0.0})
            found.append(truth.transpose("muscle", ...).values)
    if not found:
        return None
    return xr.Dataset(
        {"activation": (("muscle", "time"), np.mean(found, axis=0), {"units": "1"})},
        {"muscle": names, "time": ("time", at, {"units": "s"})},
    )


def _onset(recording: xr.Dataset, face: xr.Dataset, rest) -> float:
    """Time at which the lip markers have made half of their largest displacement [s]."""
    at = recording["time_marker"].values
    moved = targets_of(recording, face, rest, at)
    size = np.sqrt(((moved - moved.isel(time=slice(0, 10)).mean("time")) ** 2).sum("axis"))
    size = size.mean("marker").values
    return float(at[int((size > 0.5 * np.nanmax(size)).argmax())])


def at_truth(face: xr.Dataset, path: Path) -> str:
    """Error of the markers over their motion, cosine and size of the motion, at the true activation."""
    recording, told = read_recording(path), [path.stem]
    at = recording["time_marker"].values
    person, mismatch = (json.loads(recording.attrs[k]) for k in ("person", "mismatch"))
    factor = person["sigma_max"] / SIMULATION.sigma_max
    a = recording["true_activation"].interp(time_true=at).rename(time_true="time")
    a = a.transpose("muscle", "time")
    strength = xr.DataArray(
        [factor * mismatch["strength"][str(m)] for m in a["muscle"].values], dims="muscle"
    )
    drive = (a * strength).clip(0.0, 1.0).assign_attrs(units="1")
    own = SIMULATION.model_dump() | {
        "fibre_law": "generic", "kappa": 4.0 * SIMULATION.kappa,
        "incompressibility": "element", "bulk_potential": "quadratic",
    }  # fmt: skip
    touching = {"contact": SimulationParameters().contact}
    laws = SimulationParameters.model_validate(own)
    for label, one in {
        "without contact": SIMULATION,
        "contact": SIMULATION.model_copy(update=touching),
        "laws of the volunteer": laws,
        "laws and contact": laws.model_copy(update=touching),
    }.items():
        rest = settle_face(face, one)
        moved = simulate_face(face, drive, one, settled=rest)["position"].interp(time=at)
        wanted = targets_of(recording, face, rest, at)
        x = moved.sel(marker=wanted["marker"]).transpose("time", "marker", "axis").values
        u = x - x[0]
        v = wanted.values - np.nanmean(wanted.values[:8], axis=0)
        seen = np.isfinite(u) & np.isfinite(v)
        u, v = u[seen], v[seen]
        size = np.linalg.norm(v)
        told.append(
            f"{label}: error {np.linalg.norm(u - v) / size:.2f}, cosine "
            f"{u @ v / np.linalg.norm(u) / size:.2f}, size {np.linalg.norm(u) / size:.2f}"
        )
    return "; ".join(told)


@styled
def most_active(
    muscles: Sequence[str], level: np.ndarray, title: str, one: Callable[[Any, int], None]
):
    """Activation over time of the eight muscles with the largest level; `one` draws a muscle."""
    figure = blank(11.0, 5.2)
    axes = figure.subplots(2, 4, sharex=True, sharey=True).ravel()
    for panel, i in zip(axes, np.argsort(-level)[:8], strict=True):
        one(panel, i)
        panel.set_title(muscles[i])
        panel.set_ylim(0.0, 1.0)
    for panel in axes[4:]:
        panel.set_xlabel("time [s]")
    for panel in axes[::4]:
        panel.set_ylabel("activation")
    axes[0].legend(fontsize=7)
    figure.suptitle(title)
    return figure


def draw(found: dict[str, xr.Dataset], truth: xr.DataArray, title: str):
    """Activation of each variant, with the truth."""
    muscles = [str(m) for m in truth["muscle"].values]

    def one(panel, i: int) -> None:
        name, time = muscles[i], truth["time_true"]
        panel.plot(time, truth.sel(muscle=name), color="black", lw=2.0, label="truth")
        for k, (variant, own) in enumerate(found.items()):
            level = own["activation"].sel(muscle=name)
            panel.plot(own["time"], level, color=COLOURS[k], label=variant)

    return most_active(muscles, truth.max("time_true").values, title, one)


def inverted(
    path: Path, settings: list[str], face: xr.Dataset, rest, simulation, calibration, results=None
) -> tuple[list[dict], dict[str, xr.Dataset]]:
    """Errors of each setting in one trial, and the activations, which are kept in `results`."""
    recording, rows, found = read_recording(path), [], {}
    for label in settings:
        name = f"{path.stem}_{label.replace(':', '_')}.nc"
        given = f"{simulation.model_dump_json()} {calibration is not None}"
        one = None if results is None else _kept(results / name, given)
        if one is None:
            one = _inverted(recording, label, face, rest, simulation, calibration)
            if results is not None:
                results.mkdir(parents=True, exist_ok=True)
                one.assign_attrs(given=given).to_netcdf(results / name)
        row = {"trial": path.stem, "setting": label} | json.loads(one.attrs["row"])
        rows.append(row)
        if "activation" in one:
            found[label] = one
        say(str({k: round(v, 3) if isinstance(v, float) else v for k, v in row.items()}))
    return rows, found


def _inverted(recording, label, face, rest, simulation, calibration) -> xr.Dataset:
    """Result of a setting with its errors in the attribute ``row``, or none and the failure."""
    begun = time.process_time()
    try:
        found = invert(
            recording, face, simulation, parameters=parsed(label), settled=rest,
            calibration=calibration,
        )  # fmt: skip
        row = {"processor [s]": time.process_time() - begun}
        row = measures(found, recording, face, rest, simulation) | row
    except sim.SimulationError as error:
        return xr.Dataset(attrs={"row": json.dumps({"failure": type(error).__name__})})
    return found.assign_attrs(row=json.dumps({k: float(v) for k, v in row.items()}))


def _kept(path: Path, given: str) -> xr.Dataset | None:
    """Result of the same parameters, if there is one."""
    found = xr.load_dataset(path) if path.exists() else None
    return found if found is not None and found.attrs["given"] == given else None


def means(rows: list[dict]) -> pd.DataFrame:
    """Mean of every setting over the trials that it could invert, and their number."""
    table = pd.DataFrame(rows).drop(columns=["trial", "failure"], errors="ignore")
    groups = table.groupby("setting", sort=False)
    found = groups.mean()
    found.insert(0, "trials", groups["correlation"].count())
    return found.reset_index()


def main(
    recordings: list[Path],
    out: Annotated[Path | None, typer.Option(help="Figure of the last trial, and CSV.")] = None,
    settings: Annotated[
        str, typer.Option(help="form:variant:weight, separated by spaces.")
    ] = DEFAULT,
    only: Annotated[str, typer.Option(help="Trials to invert, all by default.")] = "",
    sigma_max: Annotated[float | None, typer.Option(help="Of the template [Pa].")] = None,
    step: Annotated[float, typer.Option(help="Step of the inversion [s].")] = 0.01,
    calibration: Annotated[Path | None, typer.Option(help="Of the volunteer.")] = None,
    results: Annotated[Path | None, typer.Option(help="Folder of results that are kept.")] = None,
    truth: Annotated[
        bool, typer.Option("--truth", help="Error of the template at the true activation.")
    ] = False,
) -> None:
    """Invert, compare, print and draw."""
    face, simulation = template_face(resolution="coarse"), SIMULATION
    chosen = [path for path in recordings if not only or path.stem in only.split(",")]
    if truth:
        for path in chosen:
            print(at_truth(face, path), flush=True)
        return
    simulation = simulation.model_copy(update={"output": step, "step": step})
    if sigma_max is not None:
        simulation = simulation.model_copy(update={"sigma_max": sigma_max})
    rest, calibrated = settle_face(face, simulation), None
    if calibration is not None:
        calibrated = Calibration(read_netcdf(calibration, "emg_calibration"))
    rows: list[dict] = []
    drawn: dict[str, xr.Dataset] = {}
    for path in chosen:
        if (mean := others(path, recordings, face, rest)) is not None:
            error = measures(mean, read_recording(path), face, rest, simulation)
            rows.append({"trial": path.stem, "setting": "others"} | error)
        more, drawn = inverted(path, settings.split(), face, rest, simulation, calibrated, results)
        rows += more
        if out is not None:
            pd.DataFrame(rows).to_csv(out.with_suffix(".csv"), index=False)
    print(markdown(means(rows), ".2f"), flush=True)
    if out is not None:
        last = read_recording(chosen[-1])
        world = str(last.attrs.get("world", "")).removesuffix(" world")
        title = f"SIMULATED volunteer {chosen[-1].stem}, {world} world"
        save(draw(drawn, last["true_activation"], title), out)
