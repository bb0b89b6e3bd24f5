"""Make the picture of this page: python docs/treatment/make.py."""

from pathlib import Path

from PIL import Image

import emgface as ef
from emgface.choices import configure
from emgface.face.simulation_parameters import SimulationParameters
from emgface.face.template import template_face
from emgface.pictures.stills import write_figure
from emgface.treatment.motions import compared_motions, gestures
from emgface.treatment.pages import states_of

HERE = Path(__file__).parent
PLAN = {
    "name": "V of 14 mm",
    "step": [{"kind": "wedge", "shape": "V", "place": 0.4, "width": 14.0, "height": 12.0}],
}


def main() -> None:
    """Excise a V from the lower lip of a generated face, and draw the closed wound and two movements."""
    face = template_face(resolution="medium")
    treated = ef.treat(face, PLAN)
    parameters = configure(
        SimulationParameters,
        {"accuracy": "draft", "sigma_max": 100e3, "contact": {"method": "none"}},
    )
    motions = compared_motions(
        face, treated, gestures(face, ("A", "D")), parameters, source="gestures"
    )
    path = write_figure(states_of(treated, motions, ("A", "D")), HERE / "treated.png", dpi=110)
    with Image.open(path) as picture:
        picture.convert("RGB").save(path.with_suffix(".jpg"), quality=88, optimize=True)
    path.unlink()


if __name__ == "__main__":
    main()
