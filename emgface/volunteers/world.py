"""Worlds: differences between simulated volunteers and the assumptions of a study.

In the *matched* world a volunteer obeys the assumptions of the study: the same kind of mesh and
laws, the muscles of the template, force without delay, bursts of the relevance table, and
electrodes whose signals follow Eqs 2-6. Scores in this world verify the implementation; they do not
estimate the accuracy in people. Each kind of mismatch removes one assumption; the *mismatched*
world removes all.
"""

from collections.abc import Iterable
from typing import Any, Final, Literal

from pydantic import field_validator

from emgface.choices import THIS_PACKAGE, Parameters, choice, configure, parameter, positive
from emgface.errors import ConfigurationError

CAVANAGH = "Cavanagh and Komi 1979, Eur J Appl Physiol 42:159-163 (30 to 100 ms; 49.5 to 55.5 ms)"
ITO = "Ito, Murano and Gomi 2004, J Appl Physiol 96:2318-2324"
THELEN = "Thelen 2003, J Biomech Eng 125:70-77, after Zajac 1989, Crit Rev Biomed Eng 17:359-411"
LINDSTROM = "Lindstrom and Magnusson 1977, Proc IEEE 65:653-662"
SCHUMANN = (
    "Schumann et al. 2010, J Neurosci Methods 187:120-128, found most muscles active in most tasks"
)

SPIEGEL = (
    "Spiegel et al. 2012, Acta Physiol 204, Suppl 689, P303: profiles of normalised facial EMG of two "
    "sessions have a median rank correlation of 0.88, quartiles 0.81 and 0.91"
)
JOHNSTON = (
    "Johnston et al. 2003, Cleft Palate Craniofac J 40:291-296: landmarks of repeated expressions "
    "differ by 0.74 (rest) to 1.12 mm (cheek puff), and by the symmetry of the sides"
)

Range = tuple[float, float]


class World(Parameters):
    """Differences between simulated volunteers and the assumptions of a study, by kind."""

    elements: float = parameter(
        1.5,
        "Number of elements of a volunteer's face divided by that of `resolution`; 1 is the same mesh.",
        note="the number of rings of a coarse mesh changes, but not the number of its rays; a face "
        "from a file keeps its mesh",
        ge=0.75,
        le=10,
    )
    volume: Literal["study", "element"] = choice(
        "element",
        "Bulk law of the tissue: that of the study, or kappa/2 (J - 1)^2 of the mean volume of each "
        "element.",
    )
    kappa_factor: float = positive(
        4.0,
        "Factor on the bulk modulus of the tissue.",
        note="soft tissue is less compressible than with the 25 kPa of the study",
    )
    fibre_law: Literal["study", "other"] = choice(
        "other",
        "Law of the muscle fibres: that of the study, or the other one. If the study uses "
        "that of Blemker, the other law has an active stress independent of the fibre "
        "length.",
    )
    course_shift: float = parameter(
        4e-3,
        "Standard deviation, along the skin, of the positions of origin and insertion of each muscle.",
        unit="m",
        note="random for each volunteer, equal on both sides, for random faces; the inner edge "
        "of orbicularis oris is changed instead",
        ge=0,
        le=0.01,
    )
    strength: float = parameter(
        0.4,
        "Standard deviation of the logarithm of each muscle's strength.",
        note="factor on the force at a given activation; the EMG does not depend on it",
        ge=0,
        le=1,
    )
    delay: Range = parameter(
        (0.03, 0.05),
        "Electromechanical delay from the excitation to the onset of activation: range from "
        "which the value of each volunteer is drawn.",
        unit="s",
        source=CAVANAGH,
        note="with electrical stimulation of the lips, the force of a single twitch followed "
        f"after 15 ms ({ITO})",
    )
    activation_time: float = parameter(
        0.015, "Time constant of the rise of activation.", unit="s", source=THELEN, ge=0, le=0.2
    )
    deactivation_time: float = parameter(
        0.050, "Time constant of the fall of activation.", unit="s", source=THELEN, ge=0, le=0.2
    )
    recruitment: float = parameter(
        0.4,
        "Standard deviation, over persons and instructions, of the logarithm of the level of each "
        "muscle of the relevance table.",
        ge=0,
        le=1,
    )
    left_out: float = parameter(
        0.15,
        "Probability that a person omits a muscle of the table from an instruction (a fifth "
        "of its level remains), except the strongest one.",
        ge=0,
        le=1,
    )
    joining: float = parameter(
        0.3,
        "Probability that a muscle that is not in the table is co-activated.",
        source=f"{THIS_PACKAGE}; {SCHUMANN}",
        ge=0,
        le=1,
    )
    joining_level: Range = parameter((0.10, 0.30), "Range of the peak activation of such a muscle.")
    muscle_timing: float = parameter(
        0.04,
        "Standard deviation of the onset of each muscle relative to that of the instruction.",
        unit="s",
        ge=0,
        le=0.1,
    )
    repetition_effort: float = parameter(
        0.15,
        "Standard deviation, over repetitions, of the logarithm of the effort.",
        source=f"{THIS_PACKAGE}; {JOHNSTON}",
        ge=0,
        le=1,
    )
    repetition_level: float = parameter(
        0.3,
        "Standard deviation, over repetitions, of the logarithm of the level of each muscle.",
        source=f"{THIS_PACKAGE}; {SPIEGEL}",
        note="chosen so that the peaks of two repetitions have this rank correlation; the sessions "
        "were days apart, so that repetitions within one session may vary less",
        ge=0,
        le=1,
    )
    repetition_side: float = parameter(
        0.15,
        "Standard deviation, over repetitions, of the logarithm of the ratio of left to right effort.",
        source=f"{THIS_PACKAGE}; {JOHNSTON}",
        ge=0,
        le=1,
    )
    repetition_onset: float = parameter(
        0.06, "Standard deviation of the onset over repetitions.", unit="s", ge=0, le=0.2
    )
    repetition_duration: float = parameter(
        0.10,
        "Standard deviation, over repetitions, of the logarithm of the duration of the bursts.",
        ge=0,
        le=0.3,
    )
    repetition_timing: float = parameter(
        0.03,
        "Standard deviation, over repetitions, of the onset of each muscle relative to the others.",
        unit="s",
        ge=0,
        le=0.1,
    )
    pick_up: Literal["mapping", "volume"] = choice(
        "volume",
        "Sources recorded by the electrodes: the muscles assumed by Eqs 2-6, with scaled "
        "copies of neighbouring channels; or every muscle, filtered by the tissue between "
        "muscle and electrode.",
        source=f"{LINDSTROM} (tissue filter)",
    )
    snr: Range | None = parameter(
        (14.0, 20.0),
        "Ratio of the power of a channel in the pass-band during activity to that at rest: "
        "range from which the value of each channel is drawn; default: noise of the "
        "amplifier only.",
        unit="dB",
        source=f"{THIS_PACKAGE}: typical surface EMG of facial muscles",
        note="defined by `emgface.volunteers.noise.signal_to_noise`",
    )
    amplitude: float = positive(
        0.25,
        "Factor on the amplitude of the EMG, which is 100 to 400 uV at full activation.",
        note="so that a channel at rest has a few microvolts at these signal-to-noise ratios",
    )

    @field_validator("delay", "joining_level", "snr")
    @classmethod
    def _ordered(cls, value: Range | None) -> Range | None:
        if value is not None and not 0.0 <= value[0] <= value[1]:
            raise ValueError(
                f"{value} is not a range: expected two numbers >= 0 in ascending order"
            )
        return value

    @field_validator("snr")
    @classmethod
    def _above_the_noise(cls, value: Range | None) -> Range | None:
        if value is not None and value[0] < 1.0:
            raise ValueError(
                f"{value[0]:g} dB is too low, expected at least 1 dB: the power during "
                "activity includes the noise, so that there is no signal at a ratio near 0 "
                "dB"
            )
        return value

    @property
    def kinds(self) -> tuple[str, ...]:
        """Names of the kinds of mismatch that are switched on, in the order of `MISMATCHES`."""
        return tuple(
            kind
            for kind, neutral in MISMATCHES.items()
            if any(getattr(self, name) != value for name, value in neutral.items())
        )

    @property
    def label(self) -> str:
        """Label for files and titles: "matched world", "mismatched world" or the kinds of mismatch."""
        on = self.kinds
        if not on:
            return "matched world"
        off = [kind for kind in MISMATCHES if kind not in on]
        if not off:
            return "mismatched world"
        if len(off) < len(on):
            return f"mismatched world except {', '.join(off)}"
        return f"world mismatched in {', '.join(on)}"

    def without(self, *kinds: str) -> "World":
        """Return this world with some kinds of mismatch switched off."""
        neutral = {name: value for kind in kinds for name, value in MISMATCHES[kind].items()}
        return self.model_copy(update=neutral)


MISMATCHES: Final[dict[str, dict[str, Any]]] = {
    "mesh": {"elements": 1.0},
    "laws": {"volume": "study", "kappa_factor": 1.0, "fibre_law": "study"},
    "courses": {"course_shift": 0.0},
    "strengths": {"strength": 0.0},
    "delay": {"delay": (0.0, 0.0), "activation_time": 0.0, "deactivation_time": 0.0},
    "recruitment": {"recruitment": 0.0, "left_out": 0.0, "joining": 0.0, "muscle_timing": 0.0},
    "repetition": {
        "repetition_effort": 0.0,
        "repetition_level": 0.0,
        "repetition_side": 0.0,
        "repetition_onset": 0.0,
        "repetition_duration": 0.0,
        "repetition_timing": 0.0,
    },
    "pick-up": {"pick_up": "mapping"},
    "noise": {"snr": None, "amplitude": 1.0},
}
"""Kinds of mismatch, and the values at which each is switched off."""

MATCHED: Final = World().without(*MISMATCHES)
MISMATCHED: Final = World()


def world_of(name: str) -> World:
    """World with the name "matched", "mismatched", or kinds of mismatch joined by "+".

    An example of the latter is "delay+noise". Raises ConfigurationError for any other name.
    """
    if name == "matched":
        return MATCHED
    if name == "mismatched":
        return MISMATCHED
    wanted = name.split("+")
    if unknown := [kind for kind in wanted if kind not in MISMATCHES]:
        raise ConfigurationError(
            f"the world {name!r} has the unknown part {unknown[0]!r}: expected matched, mismatched, or "
            f"some of {', '.join(MISMATCHES)} joined by '+'"
        )
    return mismatched_in(wanted)


def mismatched_in(kinds: Iterable[str]) -> World:
    """World with some kinds of mismatch, of their default sizes."""
    on = set(kinds)
    return configure(
        World, MISMATCHED.without(*(k for k in MISMATCHES if k not in on)).model_dump()
    )
