"""Make the picture of this page: python docs/fit/make.py."""

from pathlib import Path

import numpy as np
from PIL import Image

from emgface.face.template import template_face
from emgface.fit.inputs import points_of_face
from emgface.fit.person import fit_face
from emgface.fit.picture import fit_figure
from emgface.fit.targets import sheets
from emgface.pictures.stills import write_figure

HERE = Path(__file__).parent


def main() -> None:
    """Fit the mean face to a random woman, and draw the result."""
    person = template_face(resolution="medium", preset="woman", seed=12)
    rng = np.random.default_rng(12)
    marks = {k: p + 5e-4 * rng.standard_normal(3) for k, p in points_of_face(person).items()}
    skin = person["position"].values, sheets(person)["skin"].triangles
    fitted = fit_face(
        template_face(resolution="medium"), marks, skin=skin, name="fitted face", simulated=True
    )
    path = write_figure(fit_figure(fitted), HERE / "fit.png", dpi=110)
    with Image.open(path) as picture:
        picture.convert("RGB").save(path.with_suffix(".jpg"), quality=88, optimize=True)
    path.unlink()


if __name__ == "__main__":
    main()
