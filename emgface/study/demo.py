"""Study of the demonstration: two simulated volunteers on the generated template face."""

from pathlib import Path

from emgface.choices import configure
from emgface.muscles import INSTRUCTIONS
from emgface.study.configuration import StudyConfiguration
from emgface.volunteers.settings import VolunteerParameters

RESOLUTION = "coarse"


def demo_volunteers() -> VolunteerParameters:
    """Volunteers of the demonstration: individual faces, in the mismatched world."""
    return VolunteerParameters(resolution=RESOLUTION)


def demo_study(out: Path, *, quick: bool = False) -> StudyConfiguration:
    """Configure the demonstration.

    Parameters
    ----------
    out : Path
        Folder of the demonstration; the recordings are expected in ``volunteers/recordings``.
    quick : bool
        Two instructions instead of all six.

    Returns
    -------
    StudyConfiguration

    Notes
    -----
    The accuracy is that of a draft, so that the demonstration ends within minutes; ``--accuracy
    study`` is the default of studies. Muscles whose feature never exceeds the threshold are taken
    as silent (Eq. 8 would be 0/0), which the published chain does not foresee.
    """
    return configure(
        StudyConfiguration,
        {
            "name": "demonstration, quick" if quick else "demonstration",
            "recordings": {
                "folder": (out / "volunteers" / "recordings").resolve(),
                "instructions": ["B", "E"] if quick else list(INSTRUCTIONS),
            },
            "face": {"template": {"resolution": RESOLUTION}},
            "signals": {"normalisation": {"silent": "zero"}},
            "simulation": {"sigma_max": 100e3, "accuracy": "draft"},
        },
    )
