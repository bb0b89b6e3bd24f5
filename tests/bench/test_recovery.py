"""Recovery of known activations by the chain, and effects of noise and cross-talk."""

import numpy as np
import pytest

from benchmarks.recovery.recover import Condition, full_effort, recover
from emgface.choices import configure
from emgface.muscles import MODELLED
from emgface.signals.parameters import SignalChain
from emgface.volunteers.settings import VolunteerParameters
from emgface.volunteers.world import MATCHED

pytestmark = pytest.mark.filterwarnings("ignore::emgface.errors.FeatureWarning")


@pytest.fixture(scope="module")
def found():
    zero = {"silent": "zero"}
    chains = {
        "trial": configure(SignalChain, {"feature": {"kind": "rms"}, "normalisation": zero}),
        "reference": configure(
            SignalChain,
            {
                "feature": {"kind": "rms"},
                "normalisation": zero | {"reach": "reference", "outside": "clip"},
            },
        ),
    }
    return recover(
        [Condition(50.0, 0.0), Condition(10.0, 0.0), Condition(50.0, 0.3)], chains,
        n=1, instructions=("A", "E"), settings=VolunteerParameters(emg="noise", world=MATCHED),
    )  # fmt: skip


def test_without_noise_and_cross_talk_the_truth_is_recovered(found) -> None:
    best = found.isel(condition=0)
    assert found.attrs["origin"] == "simulated"
    assert float(best["rank_correlation"].median()) > 0.9
    # EMG of 200 ms has some 20 independent samples of its noise: 15 % of the amplitude
    assert float(best["shape_error"].sel(chain="reference").median()) < 0.25
    assert float(best["error"].sel(chain="reference").median()) < 0.08
    # Normalised per trial, the estimate has the maximum 1, the truth 0.6 or less.
    assert float(best["error"].sel(chain="trial").median()) > 0.15


def test_noise_lowers_the_correlation_and_cross_talk_activates_silent_muscles(found) -> None:
    median = found.median(["muscle", "trial"])
    order = median["rank_correlation"].sel(chain="reference").values
    assert order[1] < order[0] - 0.02
    wrong = median["false_activation"].sel(chain="reference").values
    assert wrong[2] > 2.0 * wrong[0]


def test_only_muscles_that_take_part_have_a_correlation(found) -> None:
    part = np.isfinite(found["error"].isel(condition=0, chain=0).values)
    out = np.isfinite(found["false_activation"].isel(condition=0, chain=0).values)
    assert (part | out).all()
    puckering = dict(zip(MODELLED, part[:, 0], strict=True))
    assert puckering["OOP"] and puckering["BUC"] and not puckering["ZYG"]


def test_full_effort_activates_each_muscle_once() -> None:
    effort = full_effort()
    assert (effort.max("time_true") == 1.0).all()
    together = effort.sum("muscle").values
    assert set(np.unique(together)) == {0.0, 2.0}
