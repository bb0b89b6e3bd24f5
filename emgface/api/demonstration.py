"""Study of the demonstration: two simulated volunteers on the generated template face."""

from pathlib import Path
from typing import Final

from emgface.choices import configure
from emgface.face.support import WALL
from emgface.muscles import INSTRUCTIONS
from emgface.run.digest import canonical_json, code_version, text_digest
from emgface.study.configuration import StudyConfiguration
from emgface.volunteers.settings import VolunteerParameters

RESOLUTION = "coarse"
SHORT: Final = ("A", "D")  #: instructions of the demonstration: purse lips, and smile

DEMONSTRATION_DURATION, DEMONSTRATION_REST, DEMONSTRATION_OUTPUT = 1.0, 0.25, 0.02
"""Length of a trial, and of the rests before and after it; largest step and time between outputs [s]."""

STRATEGY_WORDS: Final = {
    "act_all": "all ten muscles of a side follow the EMG",
    "act_3": "only the three muscles of the largest variance follow the EMG",
    "act_rel": "only the muscles that anatomy relates to the instruction follow the EMG",
}


def demo_volunteers() -> VolunteerParameters:
    """Volunteers of the demonstration: individual faces, in the mismatched world."""
    return VolunteerParameters(
        resolution=RESOLUTION, duration=DEMONSTRATION_DURATION, rest=DEMONSTRATION_REST
    )


def demo_study(out: Path, *, instructions: tuple[str, ...] = SHORT) -> StudyConfiguration:
    """Configure the demonstration in the folder `out`, with recordings in ``volunteers/recordings``.

    The accuracy is that of a draft, and trials are short, so that the demonstration ends within a
    minute; ``--accuracy study`` is the default of studies. Walls behind the lining of lips and
    cheeks represent the teeth, and lips have no contact: contact of lips and teeth, the default of
    studies, takes four times as long. Muscles whose feature never exceeds the threshold are
    regarded as silent (Eq. 8 would be 0/0), in contrast to the published chain.
    """
    every = instructions == tuple(INSTRUCTIONS)
    return configure(
        StudyConfiguration,
        {
            "name": "demonstration, all instructions" if every else "demonstration",
            "recordings": {
                "folder": (out / "volunteers" / "recordings").resolve(),
                "instructions": list(instructions),
            },
            "face": {"template": {"resolution": RESOLUTION}},
            "signals": {"normalisation": {"silent": "zero"}},
            "simulation": {
                "sigma_max": 100e3,
                "accuracy": "draft",
                "step": DEMONSTRATION_OUTPUT,
                "output": DEMONSTRATION_OUTPUT,
                "support": WALL,
                "contact": {"method": "none"},
            },
            "strategies": list(STRATEGY_WORDS),
        },
    )


def volunteers_digest(study: StudyConfiguration, settings: VolunteerParameters) -> str:
    """Digest of all that the recordings of the demonstration depend on."""
    chosen = {
        "instructions": study.recordings.instructions,
        "seed": study.seed,
        "simulation": study.simulation.model_dump(mode="json"),
        "settings": settings.model_dump(mode="json"),
        "code": code_version(("emgface", "sim")),
    }
    return text_digest(canonical_json(chosen))
