"""Published jaw model: parameters from the stored forces of its chewing cycle, and the cycle with them.

Parts of ``python -m benchmarks jaw``; they need the published model with its stored results.
"""

from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from scipy.spatial.transform import Rotation

import sim
from benchmarks.jaw_variants import PROBES, SHARED, chewed, published
from emgface.anatomy.jaw.outcomes import displacement
from emgface.anatomy.jaw.run import run_task
from emgface.anatomy.jaw.series import Excitation, read_probes
from emgface.anatomy.jaw.tasks import Task

STORED = SHARED / "artisynth_models" / "jaw_larynx" / "stored_results" / "leftchew"
MUSCLES = "ad ip sp at mt pt dm sm mp".split()
"""Muscles of each side in the order of the stored forces, right side first."""
POINTS = {"incisorDisp": "lower_incisor", "ltmjDisp": "condyle_L", "rtmjDisp": "condyle_R"}
TO_M = np.array([-1e-3, -1e-3, 1e-3])
SILENT = 0.004, 0.36
"""Time without excitation of the closers [s]."""
EATEN = 0.463, 0.548
"""Time of compression of the morsel [s], without its first contact, at which the speed changes."""


def stored(name: str, time: np.ndarray) -> np.ndarray:
    """Columns of a stored trace at times [s]."""
    lines = (STORED / f"{name}.raw").read_text(encoding="utf-8").splitlines()
    rows = np.array([[float(x) for x in line.split()] for line in lines if len(line.split()) > 1])
    return np.column_stack([np.interp(time, rows[:, 0], x) for x in rows[:, 1:].T])


def poses(jaw: xr.Dataset, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotation (n, 3, 3) and shift (n, 3) [m] of the mandible from three stored points."""
    P = np.array([jaw["point_position"].sel(point=p).values for p in POINTS.values()])
    moved = P + np.stack([stored(n, time) * TO_M for n in POINTS], axis=1)
    R = np.array(
        [
            Rotation.align_vectors(Q - Q.mean(0), P - P.mean(0))[0].as_matrix()  # pyright: ignore
            for Q in moved
        ]
    )
    return R, moved.mean(1) - R @ P.mean(0)


def forces() -> pd.DataFrame:
    """Passive fraction, damping and tone of closers, and active force of lateral pterygoids.

    Least squares F/F_max = passive p + damping L'/F_max + tone f while the closers are silent, with the
    passive and active curves p, f of Peck at the stored lengths; for lateral pterygoids F over that of
    the law at the excitation of the series.
    """
    jaw, time = published("larynx"), np.arange(1, 990) * 1e-3
    R, shift = poses(jaw, time)
    F, series = (
        stored("musclesForceNorm", time),
        read_probes(PROBES).activation(published("larynx")),
    )
    rows = list[dict[str, Any]]()
    for k, name in enumerate(m + s for s in ("_R", "_L") for m in MUSCLES):
        if name[:2] == "ad":
            continue  # the rotation of the hyoid is not stored
        row = jaw.sel(muscle=name)
        of_jaw = [str(jaw["body"].values[b]) == "jaw" for b in row["muscle_body"].values]
        held, fixed = (row["muscle_position"].values[of_jaw.index(w)] for w in (True, False))
        rest, f_max = float(np.linalg.norm(held - fixed)), float(row["muscle_force_max"])
        length = np.linalg.norm(R @ held + shift - fixed, axis=1)
        own = {n: float(row[f"muscle_{n}"]) for n in ("stretch_max", "tendon_ratio")}
        f = sim.Peck(1.0, **own, passive_fraction=0.0).evaluate(
            length, np.full_like(length, rest), np.ones_like(length)
        )[1]
        p = np.clip((length / rest - 1.0) / (own["stretch_max"] - 1.0), 0.0, 1.0)
        if name[:3] in ("ip_", "sp_"):
            a = np.interp(time, series[0]["time"], series[0].sel(muscle=name)) * f * f_max
            on = (time > 0.13) & (a > 0.2 * a.max())
            rows.append(
                {"muscle": name, "active, stored / law": (a @ (F[:, k] * on)) / (a @ (a * on))}
            )
            continue
        on = (time > SILENT[0]) & (time < SILENT[1])
        columns = np.column_stack([p, np.gradient(length, time) / f_max, f])[on]
        found, miss = _fitted(columns, F[on, k] / f_max)
        names = ("passive fraction", "damping N s/m", "tone")
        rows.append(
            {"muscle": name} | dict(zip(names, found, strict=True)) | {"miss N": miss * f_max}
        )
    table = pd.DataFrame(rows)
    middle = table.drop(columns="muscle").median()
    return pd.concat([table, pd.DataFrame([{"muscle": "median"} | middle.to_dict()])]).round(4)


def morsel() -> pd.DataFrame:
    """Largest force and damping of the morsel, F = F_max (1 - d/D) - c d' with D = 10 mm."""
    jaw = published("larynx")
    rows = list[dict[str, Any]]()
    for shift in (0, 1, 2):
        time = np.arange(EATEN[0], EATEN[1], 1e-3)
        R, moved = poses(jaw, np.append(time, time[-1] + 1e-3) - 1e-3 * shift)
        bite = jaw.sel(joint="bite_R")
        x = R @ jaw["point_position"].sel(point="bite_R").values + moved
        d = (x - bite["joint_origin"].values) @ bite["joint_normal"].values
        columns = np.column_stack([1.0 - d / 10e-3, -np.gradient(d, 1e-3), np.ones_like(d)])[:-1]
        force = stored("rightBolusForce", time).ravel()
        row: dict[str, Any] = {"force later by ms": shift}
        for used in ((0, 2), (0, 1, 2)):
            found, miss = _fitted(columns[:, used], force)
            names = [("F_max N", "c N s/m", "offset N")[i] for i in used]
            if len(used) == 2:
                names = [f"without c: {n}" for n in names]
            row |= dict(zip(names, found, strict=True))
            row[f"{'' if len(used) == 3 else 'without c: '}miss N"] = miss
        rows.append(row)
    left = float(np.abs(stored("leftBolusForce", np.arange(0.0, 1.0, 1e-3))).max())
    print(f"largest force of the left morsel: {left:g} N")
    return pd.DataFrame(rows).round(3)


def _fitted(columns: np.ndarray, values: np.ndarray) -> tuple[list[float], float]:
    found = np.linalg.lstsq(columns, values, rcond=None)[0]
    return found.tolist(), float(np.abs(columns @ found - values).max())


CASES: dict[str, dict[str, float]] = {
    "as stated": {},
    "with the tone": {"tone": 1e-3},
    "and the lateral pterygoids": {"tone": 1e-3, "ip_": 0.74, "sp_": 0.58},
    "and the morsel": {"tone": 1e-3, "ip_": 0.74, "sp_": 0.58, "morsel": 30.0},
    "and damping of bodies x 1.5": {
        "tone": 1e-3, "ip_": 0.74, "sp_": 0.58, "morsel": 30.0, "bodies": 1.5,
    },
    "and damping of bodies x 2": {
        "tone": 1e-3, "ip_": 0.74, "sp_": 0.58, "morsel": 30.0, "bodies": 2.0,
    },
    "damping of muscles 8 N s/m instead": {"tone": 1e-3, "muscles": 8.0},
}  # fmt: skip


def chewing() -> pd.DataFrame:
    """Published chewing cycle with the parameters of its stored forces, in steps [mm, s]."""
    series = read_probes(PROBES)
    time = np.arange(0.0, 0.5501, 5e-3)
    d = stored("incisorDisp", time) * [-1.0, -1.0, 1.0]
    k = int(np.argmin(d[:, 2]))
    h = stored("hyoidDisp", time[: k + 1])
    first = {"down": -d[k, 2], "back": -d[k, 1], "lateral": abs(d[k, 0]), "time s": time[k]}
    first |= {"largest lateral": np.abs(d[:, 0]).max()}
    first |= {"hyoid up": h[:, 2].max(), "hyoid forward": -h[:, 1].min(), "rms": 0.0}
    rows: list[dict[str, Any]] = [{"case": "stored"} | first]
    for case, own in CASES.items():
        jaw = with_parameters(published("larynx"), own)
        tone = np.full(len(series.time), own.get("tone", 0.0))
        motion = run_task(
            jaw,
            Task("", 0.55, morsel="L"),
            excitation=Excitation(series.time, {**series.values, "bi_close": tone}),
            resistance=own.get("morsel", 35.0),
            check=False,
        )
        found = {n.removeprefix("chew, "): x for n, x in chewed(motion).items()}
        ours = displacement(motion, "lower_incisor")
        apart = np.linalg.norm(_to_one_side(ours) - _to_one_side(d), axis=1)
        rows.append({"case": case} | found | {"rms": np.sqrt((apart**2).mean())})
    return pd.DataFrame(rows).round(3)


def with_parameters(jaw: xr.Dataset, own: dict[str, float]) -> xr.Dataset:
    """The model with the forces of lateral pterygoids and the damping of a case."""
    for m in ("ip_", "sp_"):
        of = [str(n).startswith(m) for n in jaw["muscle"].values]
        jaw["muscle_force_max"][of] = own.get(m, 1.0) * jaw["muscle_force_max"][of]
    jaw["body_damping"][:] = own.get("bodies", 1.0) * jaw["body_damping"]
    jaw["muscle_damping"][:] = own.get("muscles", 1.0)
    return jaw


def _to_one_side(d: np.ndarray) -> np.ndarray:
    """Path, mirrored if its largest lateral displacement is to the left."""
    side = np.sign(d[np.argmax(np.abs(d[:, 0])), 0])
    return d * [side, 1.0, 1.0]
