"""Make the pictures of this page.

python docs/treatment/make.py                  the closed wound and two movements
python docs/treatment/make.py --doses FOLDER   the dose-response, whose cases are kept in FOLDER
"""

import sys
from pathlib import Path

from matplotlib.figure import Figure
from PIL import Image

import emgface as ef
from emgface.choices import configure
from emgface.face.simulation_parameters import SimulationParameters
from emgface.face.template import template_face
from emgface.pictures.stills import write_figure
from emgface.treatment.dose import DoseSetting, cases, dose_table
from emgface.treatment.dose_figure import dose_figure
from emgface.treatment.motions import compared_motions, gestures
from emgface.treatment.pages import states_of

HERE = Path(__file__).parent
PLAN = {
    "name": "V of 14 mm",
    "step": [{"kind": "wedge", "shape": "V", "place": 0.4, "width": 14.0, "height": 12.0}],
}


def write_picture(figure: Figure, name: str) -> None:
    """Write a figure as JPEG next to this file."""
    path = write_figure(figure, HERE / f"{name}.png", dpi=110)
    with Image.open(path) as picture:
        picture.convert("RGB").save(path.with_suffix(".jpg"), quality=88, optimize=True)
    path.unlink()


def closed_wound() -> Figure:
    """A V excised from the lower lip of a generated face: the closed wound and two movements."""
    face = template_face(resolution="medium")
    treated = ef.treat(face, PLAN)
    parameters = configure(
        SimulationParameters,
        {"accuracy": "draft", "sigma_max": 100e3, "contact": {"method": "none"}},
    )
    motions = compared_motions(
        face, treated, gestures(face, ("A", "D")), parameters, source="gestures"
    )
    return states_of(treated, motions, ("A", "D"))


def doses(folder: Path) -> Figure:
    """Changes against the share of the lower lip that is removed, of five generated persons."""
    setting = DoseSetting(resolution="medium", movements=("A", "D", "opening"), contact=False)
    every = cases(5, 2, ["V"], [0.1, 0.2, 0.3, 0.4], [0.5], ["all"])
    return dose_figure(dose_table(every, setting, folder), setting)


def main() -> None:
    """Make the picture that the command line names."""
    if sys.argv[1:2] == ["--doses"]:
        write_picture(doses(Path(sys.argv[2])), "doses")
    else:
        write_picture(closed_wound(), "treated")


if __name__ == "__main__":
    main()
