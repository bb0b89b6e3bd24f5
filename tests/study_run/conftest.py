"""Slab of tissue with twenty muscles, whose simulation is fast."""

import shutil
import warnings
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from emgface.choices import configure
from emgface.errors import FeatureWarning
from emgface.face.file import save_face
from emgface.face.model import build_face
from emgface.face.parts import Bundle, Fibre
from emgface.face.simulation_parameters import SimulationParameters
from emgface.muscles import MUSCLES
from emgface.report import figures
from emgface.report.write import write_page
from emgface.study.configuration import StudyConfiguration
from emgface.study.run import run_study
from emgface.volunteers.simulate import make_volunteers
from sim import grid_cells
from sim.threads import set_thread_count, thread_count
from tests.conftest import MadeOnce

STEP = 0.02
"""Time step [s] of everything simulated here."""

MECHANICS = {
    "solver": "linearly_implicit",
    "step": STEP,
    "output": STEP,
    "contact": {"method": "none"},
}
"""One solution per step, because tests of studies do not depend on the solver."""

STEPS = (10, 2, 6)
LOW, HIGH = np.array([-0.03, 0.05, -0.10]), np.array([0.03, 0.06, -0.064])

# place (|x|, z) from -1 to 1 within the slab, and direction (towards the side, up) of each muscle
PLACES = {
    "ZYG": (0.8, 0.5, (1.0, 1.0)),
    "RIS": (0.8, 0.0, (1.0, 0.0)),
    "LLSAN": (0.3, 0.8, (0.2, 1.0)),
    "LAO": (0.5, 0.8, (0.0, 1.0)),
    "BUC": (0.7, 0.2, (1.0, 0.3)),
    "OOP": (0.3, 0.4, (1.0, 0.0)),
    "OOM": (0.2, -0.2, (1.0, 0.0)),
    "DLI": (0.4, -0.6, (0.3, -1.0)),
    "DAO": (0.7, -0.7, (0.5, -1.0)),
    "MEN": (0.1, -0.8, (0.0, -1.0)),
}


def slab_face() -> xr.Dataset:
    """Ten by two by six elements, fixed at the inner side of the rim."""
    nx, ny, nz = STEPS
    axes = [np.linspace(LOW[i], HIGH[i], n + 1) for i, n in enumerate(STEPS)]
    position = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)

    cells = [(i, j, k) for i in range(nx) for j in range(ny) for k in range(nz)]
    connectivity = grid_cells(STEPS)
    layer = np.array([0 if j == 0 else 2 for _, j, _ in cells])
    x, y, z = position.T
    rim = (np.abs(x) > 0.0299) | (z < -0.0999) | (z > -0.0641)
    inner = y < 0.0501
    fixed = np.where(rim & inner, np.where(z < -0.082, 1, 2), 0)
    centre = position[connectivity].mean(axis=1)
    middle, half = (LOW + HIGH) / 2, (HIGH - LOW) / 2

    fibres, bundles = [], []
    for muscle in MUSCLES:
        name, side = muscle.split("_")
        sign = -1.0 if side == "L" else 1.0
        lateral, vertical, (dx, dz) = PLACES[name]
        at = middle + half * np.array([sign * lateral, 0.0, vertical])
        direction = np.array([sign * dx, 0.0, dz])
        direction /= np.linalg.norm(direction)
        distance = np.linalg.norm((centre - at) * [1.0, 0.3, 1.0], axis=1)
        distance[centre[:, 0] * sign < 0] = np.inf
        element = np.flatnonzero(distance < 0.0071)  # a radius: the same on both sides
        fibres.append(Fibre(muscle, at + np.array([[-1.0], [1.0]]) * 0.004 * direction))
        bundles.append(Bundle(muscle, element, np.tile(direction, (element.size, 1))))

    def nearest(lateral: float, vertical: float) -> int:
        target = middle + half * np.array([lateral, 1.0, vertical])
        return int(np.argmin(np.linalg.norm(position - target, axis=1)))

    places = [(-0.6, 0.0), (-0.4, 0.3), (-0.2, 0.3), (0.2, 0.3), (0.4, 0.3), (0.6, 0.0),
              (-0.4, -0.3), (-0.2, -0.3), (0.2, -0.3), (0.4, -0.3)]  # fmt: skip
    head = np.array([[-0.03, 0.06, 0.0], [0.03, 0.06, 0.0], [-0.06, 0.0, -0.02],
                     [0.06, 0.0, -0.02], [0.0, 0.07, -0.03], [0.0, 0.08, -0.04]])  # fmt: skip
    return build_face(
        position=position,
        connectivity=connectivity,
        layer=layer,
        fixed=fixed,
        fibres=fibres,
        bundles=bundles,
        marker_node=np.array([nearest(*place) for place in places]),
        face_marker_position=head,
        lip_opening_node=np.array([nearest(0.0, 0.3), nearest(0.0, -0.3)]),
        name="slab",
        origin="generated",
        source="a test",
    )


@pytest.fixture(scope="session", autouse=True)
def one_thread():
    """Use one thread, because further threads would only wait for each other."""
    before = thread_count()
    set_thread_count(1)
    yield
    set_thread_count(before)


@pytest.fixture(scope="session")
def slab() -> xr.Dataset:
    return slab_face()


@pytest.fixture(scope="session")
def laboratory(slab: xr.Dataset, made_once: MadeOnce, tmp_path_factory) -> Path:
    """Folder with the slab as face.nc and one simulated volunteer with instructions B and E."""

    def fill(folder: Path) -> None:
        save_face(slab, folder / "face.nc")
        make_volunteers(
            slab,
            folder,
            n=1,
            instructions=("B", "E"),
            seed=2,
            parameters=configure(SimulationParameters, MECHANICS),
        )

    own = tmp_path_factory.mktemp("laboratory")  # tests write studies into it
    return Path(shutil.copytree(made_once("laboratory", fill), own, dirs_exist_ok=True))


def leave_out_figures(patch: pytest.MonkeyPatch) -> None:
    """Write reports without their figures, which take most of the time."""
    for name in ("trial_figures", "score_figures", "baseline_figure", "formant_figure"):
        patch.setattr(figures, name, lambda results: [])


@pytest.fixture
def without_figures(monkeypatch) -> None:
    leave_out_figures(monkeypatch)


@pytest.fixture(scope="session")
def shown(laboratory: Path, tmp_path_factory) -> Path:
    """Folder of a study of one trial under two strategies."""
    folder = tmp_path_factory.mktemp("report")
    study = configure(
        StudyConfiguration,
        {
            "name": "slab <of> tissue",
            "strategies": ["act_all", "act_rel"],
            "recordings": {"folder": str(laboratory / "recordings"), "instructions": ["B"]},
            "face": {"path": str(laboratory / "face.nc")},
            "signals": {"normalisation": {"silent": "zero"}, "resampling": {"steps": 40}},
            "simulation": MECHANICS | {"sigma_max": 100e3},
        },
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FeatureWarning)
        run_study(study, folder / "study")
    return folder / "study"


@pytest.fixture(scope="session")
def page(shown: Path) -> Path:
    """Report of the study `shown` with moving faces."""
    written = write_page(shown, shown.parent / "report.html")
    assert written.notes == []
    return written.path
