"""Published jaw model, if its files are available, and results of another simulator."""

import json

import numpy as np
import pytest

from emgface.anatomy.jaw.published import import_jaw

TO_MM = np.array([-1e3, -1e3, 1e3])
"""From the frame of the package [m] to that of the published files [mm]."""


@pytest.fixture(scope="session")
def published(shared):
    """Importer of the published model, each variant read once."""
    made = {}

    def model(variant, **options):
        key = variant, *sorted(options.items())
        if key not in made:
            folder = shared / "artisynth_models" / "jaw_larynx"
            made[key] = import_jaw(folder, variant=variant, **options)
        return made[key]

    return model


@pytest.fixture(scope="session")
def recorded(shared):
    """Description and arrays of a case that the other simulator ran."""

    def case(name):
        folder = shared / "artisynth_reference" / "jaw"
        with np.load(folder / f"{name}.npz") as arrays:
            return json.loads((folder / f"{name}.json").read_text()), dict(arrays)

    return case


def here(name):
    """Name in the package of a muscle of the published program, such as at_L for lat."""
    return name if name.startswith("bi_") else name[1:] + {"l": "_L", "r": "_R"}[name[0]]
