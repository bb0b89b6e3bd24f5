"""Effects of the open choices of the publication on rho, with simulated volunteers.

    python -m benchmarks open_choices --out docs/choices

Simulates volunteers on the coarse template face, scores them under every level of eight choices, of
which one at a time differs from its reference, and writes table and figure. About four seconds per
trial and core.
"""

import tempfile
import tomllib
import warnings
from pathlib import Path

import numpy as np

from analysis.figures import save, sensitivity_plot
from analysis.sensitivity import choices_table, sensitivity
from emgface.choices import configure
from emgface.errors import FeatureWarning
from emgface.face.check import sheet_nodes
from emgface.face.file import save_face
from emgface.face.parts import OUTER
from emgface.face.simulation_parameters import SimulationParameters
from emgface.face.template import template_face
from emgface.study.configuration import StudyConfiguration
from emgface.study.run import run_study
from emgface.volunteers.settings import VolunteerParameters
from emgface.volunteers.simulate import make_volunteers
from emgface.volunteers.world import MATCHED

CHOICES = """
[[axis]]
parameters = ["signals.mapping.mapping_stage"]
levels = ["signal", "feature", "activation"]
[[axis]]
name = "normalisation_reach"
parameters = ["signals.normalisation.reach"]
levels = ["trial", "session"]
[[axis]]
name = "wamp_threshold"
parameters = ["signals.feature.threshold"]
levels = [10e-6, 5e-6, 20e-6]
[[axis]]
parameters = ["signals.filter.phase"]
levels = ["zero", "causal"]
[[axis]]
parameters = ["simulation.sigma_max"]
levels = [100e3, 50e3]
[[axis]]
parameters = ["simulation.fibre_law", "simulation.P1"]
levels = [["blemker", 0.05], ["generic", 500.0]]
[[axis]]
parameters = ["simulation.bulk_potential"]
levels = ["logarithmic", "quadratic"]
[[axis]]
name = "marker_ring"
parameters = ["face.path"]
levels = ["FOLDER/lips.nc", "FOLDER/further_out.nc"]
"""


def with_markers_further_out(face):
    """Move every marker to the nearest node of the skin that is further from the mouth."""
    position = face["position"].values
    node = face["marker_node"].values.copy()
    skin = np.setdiff1d(sheet_nodes(face, OUTER), node)
    middle = position[node].mean(axis=0)
    for k, own in enumerate(node):
        radius = np.linalg.norm((position[skin] - middle)[:, [0, 2]], axis=1)
        outside = skin[radius > np.linalg.norm((position[own] - middle)[[0, 2]]) + 2e-3]
        free = np.setdiff1d(outside, node[:k])
        node[k] = free[np.argmin(np.linalg.norm(position[free] - position[own], axis=1))]
    return face.assign(marker_node=face["marker_node"].copy(data=node))


def main(
    workers: int = 1,
    out: Path = Path("docs/choices"),
    work: Path | None = None,
) -> None:
    """Simulate and score; the files in a folder `work` remain, so that a run can be resumed."""
    warnings.simplefilter("ignore", FeatureWarning)
    with tempfile.TemporaryDirectory() as temporary:
        folder = work or Path(temporary)
        face = template_face(resolution="coarse")
        save_face(face, folder / "lips.nc")
        save_face(with_markers_further_out(face), folder / "further_out.nc")
        make_volunteers(
            face,
            folder / "volunteers",
            n=7,
            instructions=["B", "D"],
            seed=7,
            parameters=SimulationParameters(step=0.02, sigma_max=100e3),
            # In the matched world only the choice differs from the assumptions of the study.
            settings=VolunteerParameters(world=MATCHED),
            workers=workers,
        )
        text = CHOICES.replace("FOLDER", folder.as_posix())
        study = configure(
            StudyConfiguration,
            {
                "name": "open choices",
                "strategies": ["act_rel"],
                "recordings": {"folder": folder / "volunteers" / "recordings"},
                "face": {"path": folder / "lips.nc"},
                "signals": {"normalisation": {"silent": "zero"}},
                "simulation": {"step": 0.02, "sigma_max": 100e3},
            }
            | tomllib.loads(text),
        )
        cube = run_study(study, folder / "study", workers=workers).cube
    out.mkdir(parents=True, exist_ok=True)
    for variable in ("rho", "amplitude_ratio"):
        found = sensitivity(cube, variable=variable)
        table = choices_table(found)
        (out / f"{variable}.csv").write_text(table.csv(), encoding="utf-8")
        (out / f"{variable}.md").write_text(table.markdown(), encoding="utf-8")
        save(sensitivity_plot(found), out / f"{variable}.svg")
        print(table.text(), found.attrs["summary"], sep="\n")
