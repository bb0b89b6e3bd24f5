"""Recordings of some muscles or one side: estimates, selections and messages."""

import numpy as np
import pytest

from emgface.choices import configure
from emgface.errors import ConfigurationError, SchemaError
from emgface.muscles import CHANNELS, MUSCLES
from emgface.signals.activation import activation_of, feature_range
from emgface.signals.montage import COMPLETE, MontageParameters, montage_of
from tests.study.recordings import chain_of, recording_of

LEFT = [name for name in CHANNELS if name.endswith("_L")]


def with_channels(channels, **attrs):
    return recording_of(**attrs).sel(channel=list(channels))


def activation(recording, strategy="act_all", mapping=None, **montage):
    chain = chain_of(montage=montage, mapping=mapping or {})
    return activation_of(recording, chain, strategy=strategy)


def test_every_channel_is_in_one_group():
    choices = configure(
        MontageParameters, {"missing_side": "mirror", "missing_muscle": "leave_out"}
    )
    montage = montage_of(["corrugator", "ZYG_L", "MEN_R"], choices)
    groups = (montage.recorded, montage.mirrored, montage.zero, montage.left_out)
    assert sorted(sum(groups, ())) == sorted(CHANNELS)
    assert montage.recorded == ("ZYG_L", "MEN_R") and montage.mirrored == ("MEN_L", "ZYG_R")
    assert montage.ignored == ("corrugator",)
    assert montage.estimated == ("ZYG_L", "MEN_L", "ZYG_R", "MEN_R")
    assert montage_of(CHANNELS, MontageParameters()) == COMPLETE
    assert COMPLETE.estimated == MUSCLES


def test_a_mirrored_side_moves_as_the_recorded_one():
    whole, one = recording_of(), with_channels(LEFT)
    mirrored = activation(one, missing_side="mirror")
    left = mirrored["activation"].sel(muscle=[m for m in MUSCLES if m.endswith("_L")]).values
    right = mirrored["activation"].sel(muscle=[m for m in MUSCLES if m.endswith("_R")]).values
    np.testing.assert_array_equal(left, right)
    # The result of the recorded side does not depend on the other side.
    both = activation(whole)["activation"].sel(muscle="ZYG_L")
    np.testing.assert_array_equal(mirrored["activation"].sel(muscle="ZYG_L"), both)
    assert "copied from the other side: OOS_R" in mirrored.attrs["montage"]


@pytest.mark.parametrize("stage", ["signal", "feature", "activation"])
def test_zero_estimates_mixtures_and_leave_out_does_not(stage):
    recording = with_channels(["ZYG_L", "ZYG_R"])
    zero = activation(recording, mapping={"mapping_stage": stage}, missing_muscle="zero")
    out = activation(recording, mapping={"mapping_stage": stage}, missing_muscle="leave_out")
    assert list(zero["muscle"].values) == list(out["muscle"].values) == list(MUSCLES)
    moved = {
        str(m)
        for which in (zero, out)
        for m in MUSCLES
        if which["activation"].sel(muscle=m).max() > 0
    }
    assert moved == {"ZYG_L", "ZYG_R", "BUC_L", "BUC_R"}
    assert out["activation"].sel(muscle="BUC_L").max() == 0
    # BUC = 0.5 RIS + 0.5 ZYG: at the level of activations half of ZYG, elsewhere Eq. 8 restores it.
    half = 0.5 if stage == "activation" else 1.0
    assert float(zero["activation"].sel(muscle="BUC_L").max()) == pytest.approx(half, abs=0.1)
    assert out.attrs["selected"] == "ZYG" and zero.attrs["selected"] == "ZYG BUC"


def test_a_strategy_fails_only_if_it_requires_a_missing_muscle():
    # Only LLSAN raises the upper lip (Table 1), so that no other muscle need be recorded.
    recording = with_channels(["LLSAN_L", "LLSAN_R"], instruction="B")
    selected = activation(recording, "act_rel")
    assert selected.attrs["selected"] == "LLSAN"
    for strategy in ("act_all", "act_3", "act_threshold"):
        with pytest.raises(SchemaError, match=r"missing channels OOS_L.*missing_muscle"):
            activation(recording, strategy)
    with pytest.raises(SchemaError, match="missing channel LLSAN_R .*missing_side"):
        activation(with_channels(["LLSAN_L"], instruction="B"), "act_rel")


def test_strategies_select_among_the_recorded_muscles():
    recording = with_channels(["ZYG_L", "MEN_L", "DAO_R", "DAO_L"], instruction="C")
    choices = {"missing_side": "leave_out", "missing_muscle": "leave_out"}
    assert set(activation(recording, "act_3", **choices).attrs["selected"].split()) <= {
        "ZYG", "MEN", "DAO", "DLI",
    }  # fmt: skip
    relevant = activation(recording, "act_rel", **choices)
    assert relevant.attrs["selected"] == "DAO MEN"
    assert relevant["activation"].sel(muscle="MEN_R").max() == 0  # one side is left out
    with pytest.raises(SchemaError, match="activates LLSAN, of which the montage contains none"):
        activation(recording.assign_attrs(instruction="B"), "act_rel", **choices)
    with pytest.raises(SchemaError, match="at least one of OOS_L"):
        activation(recording.assign_coords(channel=list("abcd")), "act_3", **choices)
    with pytest.raises(ConfigurationError, match="missing_side"):
        activation(recording, missing_side="copy")


def test_a_session_may_lack_a_channel_in_some_trials_and_not_in_all():
    chain = chain_of(
        montage={"missing_side": "leave_out"},
        normalisation={"reach": "session"},
    )
    whole, partial = recording_of(0), with_channels([c for c in CHANNELS if c != "MEN_R"], seed=1)
    both = feature_range([whole, partial], chain)
    assert both.sizes["muscle"] == len(MUSCLES)
    alone = feature_range([whole], chain)
    np.testing.assert_array_equal(
        both["maximum"].sel(muscle="MEN_R"), alone["maximum"].sel(muscle="MEN_R")
    )
    less = feature_range([partial], chain)
    with pytest.raises(ConfigurationError, match="range of the session contains no muscle MEN_R"):
        activation_of(whole, chain, session=less)
