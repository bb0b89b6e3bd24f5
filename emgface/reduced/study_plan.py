"""Activations that a study derives from the sEMG of simulated volunteers, to train a reduced face.

Every drive is one trial of another volunteer in the mismatched world: excitation of an instruction,
sEMG as noise of modulated amplitude with the signal-to-noise ratios of that world and an amplitude
between those of the mismatched and of the matched world, and a strategy with the default chain of
signals. Instructions and strategies follow each other in turn, so that any eighteen successive drives
contain each of their pairs once.
"""

import warnings
from collections.abc import Sequence
from typing import Final

import numpy as np

from emgface.errors import FeatureWarning
from emgface.muscles import INSTRUCTIONS
from emgface.reduced.plan import (
    PURPOSES,
    SAMPLE_INTERVAL,
    Floats,
    Sequences,
    TrainingDrive,
    random_drives,
)
from emgface.signals.activation import activation_of
from emgface.signals.parameters import SignalChain
from emgface.volunteers.emg import synthesise_emg
from emgface.volunteers.mismatch import draw_mismatch
from emgface.volunteers.person import SimulatedVolunteer, draw_volunteer
from emgface.volunteers.session import trial_excitation
from emgface.volunteers.settings import VolunteerParameters

PLANNED_DURATION: Final = 1.3
"""Duration of the sEMG of a trial [s]; its activation lasts a window of 0.2 s less."""
PUBLISHED_STRATEGIES: Final = ("act_all", "act_3", "act_rel")
"""Strategies of Eskes et al. 2017."""
ACTIVE_AMPLITUDE: Final = 0.5
"""Amplitude of an active channel, relative to that at full activation, for its noise [1]."""
PEOPLE: Final = 100_000
"""Volunteers of each purpose; those of two purposes never share an index."""


def sequences_of(activations: str) -> Sequences:
    """Drives of the kind `ReductionParameters.activations`."""
    return {"study": study_drives, "random": random_drives}[activations]


def study_drives(muscles: Sequence[str], n: int, purpose: str, seed: int) -> list[TrainingDrive]:
    """Activations of n trials, each of another simulated volunteer."""
    world = VolunteerParameters().world.without("pick-up")
    settings = VolunteerParameters(world=world, emg="noise", duration=PLANNED_DURATION)
    first = 1 + PEOPLE * PURPOSES.index(purpose)
    i, s = list(INSTRUCTIONS), PUBLISHED_STRATEGIES
    pairs = [(i[k % len(i)], s[(k + k // len(i)) % len(s)]) for k in range(n)]
    return [
        _drive(muscles, draw_volunteer(first + k, seed), *pair, purpose, settings)
        for k, pair in enumerate(pairs)
    ]


def _drive(
    muscles: Sequence[str],
    person: SimulatedVolunteer,
    instruction: str,
    strategy: str,
    purpose: str,
    settings: VolunteerParameters,
) -> TrainingDrive:
    """Activation of one trial from its time 0 on."""
    snr = draw_mismatch(person.seed, person.index, settings.world).snr
    assert snr is not None  # The mismatched world has it.
    rng = person.rng(instruction, 0)
    gain = settings.world.amplitude ** rng.uniform() * np.array(list(person.gain.values()))
    decibels = np.array([snr[channel] for channel in person.gain])
    emg = synthesise_emg(
        trial_excitation(person, instruction, 1, settings).sel(
            time_true=slice(None, PLANNED_DURATION)
        ),
        gain=gain,
        cross_talk=person.cross_talk,
        baseline_noise=ACTIVE_AMPLITUDE * gain / 10.0 ** (decibels / 20.0),
        mains_hum=person.mains_hum,
        rng=rng,
        sampling_rate=settings.sampling_rate,
        mains_frequency=settings.mains_frequency,
    )
    recording = emg.assign_attrs(units="V").rename("emg").to_dataset()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FeatureWarning)  # A muscle at rest is part of a study.
        activation = activation_of(
            recording, SignalChain(), strategy=strategy, instruction=instruction
        )
    given = activation["activation"].transpose("time", "muscle").sel(muscle=list(muscles))
    since = given["time"].values - float(given["time"][0])
    time: Floats = SAMPLE_INTERVAL * np.arange(
        int(since[-1] / SAMPLE_INTERVAL + 1e-9) + 1, dtype=np.float64
    )
    values = np.array([np.interp(time, since, row) for row in given.values.T]).T
    label = f"{purpose} {person.index % PEOPLE} {instruction} {strategy}"
    return TrainingDrive(label, purpose, time, np.clip(values, 0.0, 1.0))
