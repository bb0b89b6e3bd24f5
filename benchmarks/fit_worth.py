"""Compare the scores of simulated persons with generic, fitted and own geometry of the face.

Every person is recorded with a face of his or her own (`emgface.volunteers`), in the matched and the
mismatched world. The study has the face as an axis: the generic face; that fitted to 20 landmarks; that
fitted to landmarks and a scan of the skin, also with the tissue one standard deviation thinner and
thicker than the scan suggests; and the own geometry on the mesh of the study. Neither instruction
presses the lips together, and the simulations are without contact, which takes most of the time.
"""

import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import xarray as xr
from scipy.stats import t

from analysis.figures.style import COLOURS, blank, grid, heading, save, styled
from analysis.statistics.paired import LIMIT
from analysis.tables import Column, Table
from emgface.choices import configure
from emgface.face.file import save_face
from emgface.face.simulation_parameters import SimulationParameters
from emgface.face.template import template_face, volunteer_face
from emgface.fit.inputs import points_of_face
from emgface.fit.person import fit_face
from emgface.fit.targets import sheets
from emgface.study.configuration import Axis, StudyConfiguration
from emgface.study.run import run_study
from emgface.volunteers.settings import VolunteerParameters
from emgface.volunteers.simulate import make_volunteers
from emgface.volunteers.world import MATCHED, MISMATCHED, World

SEED: Final = 44
NOISE: Final = 0.8e-3  #: standard deviation of a landmark per coordinate [m]
MESH: Final = "coarse"
SCANNED: Final = (
    "medium"  #: mesh whose skin is the scan, which has no nodes of the mesh of the study
)
SIMULATION: Final = {"accuracy": "draft", "contact": {"method": "none"}}
CONDITIONS: Final = {
    "matched, true activation": (MATCHED, "true"),
    "matched, act_all": (MATCHED, "act_all"),
    "mismatched, act_all": (MISMATCHED, "act_all"),
}
THICKNESS: Final = {"thinner": -1.0, "thicker": 1.0}
GEOMETRIES: Final = ("generic", "landmarks", "skin", *THICKNESS, "own")
VARIED: Final = ("matched, true activation", "matched, act_all")  #: conditions with `THICKNESS`
LEVEL: Final = 0.95


@dataclass(frozen=True)
class Measure:
    """Score of a marker, and the scale on which it is averaged."""

    variable: str
    label: str
    forward: Callable[[Any], Any]
    back: Callable[[Any], Any]


MEASURES: Final = (
    Measure("rho", "rho", lambda v: np.arctanh(np.clip(v, -LIMIT, LIMIT)), np.tanh),
    Measure("amplitude_ratio", "amplitude ratio", np.log, np.exp),
    Measure("rmse", "marker error [mm]", lambda v: 1e3 * v, lambda v: v),
)


def write_faces(index: int, folder: Path, preset: str = "adult") -> str:
    """Write the faces of one person, unless they are there; return the person's name."""
    name = f"S{index:02d}"
    generic = template_face(resolution=MESH, preset=preset)
    settings = VolunteerParameters()

    def own_face(resolution: str) -> xr.Dataset:
        return volunteer_face(
            SEED, index, resolution=resolution, preset=preset, spread=settings.spread,
            asymmetry=settings.face_asymmetry,
        )[0]  # fmt: skip

    scanned = own_face(SCANNED)
    rng = np.random.default_rng((SEED, index))
    marks = {k: p + NOISE * rng.standard_normal(3) for k, p in points_of_face(scanned).items()}
    skin = scanned["position"].values, sheets(scanned)["skin"].triangles

    def fitted(**given: Any) -> xr.Dataset:
        return fit_face(generic, marks, simulated=True, name=name, **given).face

    made: dict[str, Callable[[], xr.Dataset]] = {
        "generic": lambda: generic,
        "landmarks": fitted,
        "skin": lambda: fitted(skin=skin),
        "own": lambda: own_face(MESH),
        **{k: lambda d=d: fitted(skin=skin, thickness=d) for k, d in THICKNESS.items()},
    }
    for geometry, make in made.items():
        if not (path := folder / geometry / f"{name}.nc").exists():
            save_face(make(), path)
    return name


def cubes(
    persons: int,
    instructions: Sequence[str],
    work: Path,
    workers: int,
    chosen: Sequence[str] = (),
) -> dict[str, xr.Dataset]:
    """Cube of every condition, or of those `chosen`, with the face as the axis ``geometry``."""
    faces = work / "faces"
    for index in range(1, persons + 1):
        write_faces(index, faces)
    results: dict[str, xr.Dataset] = {}
    for condition, (world, strategy) in CONDITIONS.items():
        if chosen and condition not in chosen:
            continue
        folder = work / world.label.replace(" ", "_")
        _record(world, folder, persons, instructions, work, workers)
        used = [name for name in GEOMETRIES if name not in THICKNESS or condition in VARIED]
        paths = tuple(str(faces / name / "{volunteer}.nc") for name in used)
        true = strategy == "true"
        plan = configure(
            StudyConfiguration,
            {
                "name": f"worth of a fit, {condition}",
                **({"activation_source": "true"} if true else {"strategies": [strategy]}),
                "recordings": {"folder": folder / "recordings", "instructions": instructions},
                "face": {"path": paths[0]},
                "signals": {"normalisation": {"silent": "zero"}},
                "simulation": SIMULATION,
            },
        )
        axis = Axis(parameters=("face.path",), levels=paths, name="geometry")
        plan = plan.model_copy(update={"axis": (axis,)})
        out = work / condition.replace(", ", "_").replace(" ", "_")
        run_study(plan, out, workers=workers, store=work / "store")
        with xr.open_dataset(out / "cube.nc") as cube:
            results[condition] = cube.load()
    return results


def _record(
    world: World, folder: Path, persons: int, instructions: Sequence[str], work: Path, workers: int
) -> None:
    make_volunteers(
        None, folder, n=persons, instructions=instructions, seed=SEED,
        parameters=configure(SimulationParameters, SIMULATION),
        settings=VolunteerParameters(world=world, resolution=MESH), workers=workers,
        store=work / "store",
    )  # fmt: skip


def per_person(cube: xr.Dataset, measure: Measure) -> xr.DataArray:
    """Mean over instructions, repetitions and markers, dims (geometry, volunteer), on its scale.

    Only cells with a value for every geometry count, so that all means are of the same cells.
    """
    values = measure.forward(cube[measure.variable].squeeze("strategy", drop=True))
    whole = np.isfinite(values).all("geometry")
    others = [dim for dim in values.dims if dim not in ("geometry", "volunteer")]
    return values.where(whole).mean(others).transpose("geometry", "volunteer")


def interval(values: np.ndarray) -> tuple[float, float, float]:
    """Mean over persons, with the bounds of its interval by Student's t; NaN for fewer than three."""
    kept = values[np.isfinite(values)]
    if len(kept) < 3:
        return float(kept.mean()) if len(kept) else np.nan, np.nan, np.nan
    half = float(t.ppf(0.5 + LEVEL / 2, len(kept) - 1)) * kept.std(ddof=1) / np.sqrt(len(kept))
    return float(kept.mean()), float(kept.mean() - half), float(kept.mean() + half)


def worth_table(results: dict[str, xr.Dataset]) -> Table:
    """Means with intervals, differences from the generic face, and the share of the gap closed."""
    rows: list[tuple[Any, ...]] = []
    for condition, cube in results.items():
        for measure in MEASURES:
            values = per_person(cube, measure)
            generic = values.sel(geometry="generic").values
            for geometry in values["geometry"].values.tolist():
                own = values.sel(geometry=geometry).values
                mean = tuple(float(measure.back(v)) for v in interval(own))
                change = interval(own - generic)
                better = own - generic
                if measure.variable == "amplitude_ratio":
                    better = np.abs(generic) - np.abs(own)
                elif measure.variable == "rmse":
                    better = -better
                rises = int((better > 0.0).sum()) if geometry != "generic" else 0
                rows.append((condition, measure.label, geometry, *mean, *change, rises))
    persons = next(iter(results.values())).sizes["volunteer"]
    return Table(
        f"Scores of {persons} simulated persons by the geometry of their face",
        (
            Column("condition"), Column("score"), Column("geometry"), Column("mean", digits=3),
            Column("lower", digits=3), Column("upper", digits=3), Column("change", digits=3),
            Column("change, lower", digits=3), Column("change, upper", digits=3),
            Column("persons improved"),
        ),
        tuple(rows),
        "simulated",
        f"Intervals of {LEVEL:.0%} over persons (Student's t). Means of rho by Fisher's z, of ratios by "
        "their logarithm; changes from the generic face, within persons, on these scales.",
    )  # fmt: skip


def spread_of_thickness(results: dict[str, xr.Dataset]) -> list[str]:
    """Sentences: standard deviation of the scores by one of the thickness under the skin."""
    said: list[str] = []
    for condition, cube in results.items():
        if not set(THICKNESS) <= set(cube["geometry"].values.tolist()):
            continue
        one, two = (cube["rho"].sel(geometry=g).squeeze() for g in THICKNESS)
        half = (0.5 * np.abs(two - one)).values
        said.append(
            f"{condition}: one standard deviation of the thickness changes rho of a marker by "
            f"{np.sqrt(np.nanmean(half**2)):.3f} (root mean square), its error by "
            f"{_of_error(cube):.3f} mm."
        )
    return said


def _of_error(cube: xr.Dataset) -> float:
    one, two = (1e3 * cube["rmse"].sel(geometry=g) for g in THICKNESS)
    return float(np.sqrt(np.nanmean(((0.5 * (two - one)) ** 2).values)))


@styled
def worth_figure(results: dict[str, xr.Dataset]) -> Any:
    """Scores of every person by geometry (lines), and their means with intervals."""
    shown = [g for g in GEOMETRIES if g not in THICKNESS]
    figure = blank(9.0, 2.4 * len(results) + 0.6)
    panels = grid(figure, len(results), len(MEASURES))
    for row, (condition, cube) in zip(panels, results.items(), strict=True):
        for panel, measure in zip(row, MEASURES, strict=True):
            values = per_person(cube, measure).sel(geometry=shown)
            panel.plot(range(len(shown)), measure.back(values.values), color="0.75", linewidth=0.7)
            means = np.array([interval(own) for own in values.values])
            middle, low, high = (measure.back(means[:, k]) for k in range(3))
            panel.errorbar(
                range(len(shown)), middle, yerr=np.nan_to_num([middle - low, high - middle]),
                color=COLOURS[4], marker="o", capsize=3,
            )  # fmt: skip
            if measure.variable == "amplitude_ratio":
                panel.axhline(1.0, color="0.5", linewidth=0.6, linestyle=":")
            panel.set_xticks(range(len(shown)), shown)
            panel.set_ylabel(measure.label)
            panel.set_title(condition, fontsize="small")
    heading(figure, "Scores by the geometry of the face", "simulated")
    return figure


def worth(
    persons: int,
    instructions: Sequence[str],
    out: Path,
    work: Path,
    workers: int,
    chosen: Sequence[str] = (),
) -> dict[str, xr.Dataset]:
    """Simulate, fit and score; write table and figure to `out`, and print the table with its cost."""
    began = time.monotonic()
    results = cubes(persons, instructions, work, workers, chosen)
    table = worth_table(results)
    out.mkdir(parents=True, exist_ok=True)
    (out / "worth.csv").write_text(table.csv(), encoding="utf-8")
    (out / "worth.md").write_text(table.markdown(), encoding="utf-8")
    save(worth_figure(results), out / "worth.svg")
    print(table.text(), *spread_of_thickness(results), sep="\n")
    times = os.times()
    spent = times.user + times.system + times.children_user + times.children_system
    print(
        f"{spent / 60.0:.1f} minutes of processor time, {(time.monotonic() - began) / 60.0:.1f} elapsed "
        f"with {workers} processes; results of an earlier run in the same folder are not counted"
    )
    return results
