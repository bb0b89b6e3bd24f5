"""Ranges of recordings with other channels, gains and spellings do not normalise silently."""

import numpy as np
import pytest

from emgface.errors import ActivationError, SchemaError
from emgface.muscles import CHANNELS
from emgface.recordings.findings import findings_in
from emgface.signals.activation import activation_of, feature_range
from tests.study.recordings import chain_of, recording_of

RMS = {"kind": "rms"}
ABSENT = (
    (["OOI_L", "OOI_R"], {"missing_muscle": "zero"}, {"OOP_L", "OOM_L", "OOP_R", "OOM_R"}),
    (["ZYG_L"], {"missing_side": "mirror"}, {"ZYG_L", "BUC_L"}),
)
"""Channels that are absent, their treatment, and the muscles whose signal is then another one."""


def without(absent, *args, **options):
    recording = recording_of(*args, **options)
    return recording.sel(channel=[c for c in CHANNELS if c not in absent])


@pytest.mark.parametrize("stage", ["signal", "feature", "activation"])
@pytest.mark.parametrize(("absent", "montage", "muscles"), ABSENT)
def test_a_range_of_other_channels_is_stated(absent, montage, muscles, stage) -> None:
    """Before, OOP reached 0.75 instead of 0.51 if the maximum effort lacked its lower channel."""
    options = {"feature": RMS, "montage": montage, "mapping": {"mapping_stage": stage}}
    chain = chain_of(**options, normalisation={"reach": "reference", "outside": "clip"})
    whole, partial = recording_of(3, gain=2), without(absent, 3, gain=2)
    for one, other in ((recording_of(), partial), (without(absent), whole)):
        if stage == "activation" and montage != {"missing_side": "mirror"}:
            continue  # channels have their own range, and a missing one has none
        result = activation_of(one, chain, reference=feature_range([other], chain))
        named = {f.name for f in findings_in(result) if f.code == "other_channels"}
        assert named == ({"ZYG_L"} if stage == "activation" else muscles)
    same = activation_of(recording_of(), chain, reference=feature_range([whole], chain))
    assert not [f for f in findings_in(same) if f.code == "other_channels"]


@pytest.mark.parametrize(("absent", "montage", "muscles"), ABSENT)
def test_a_range_is_that_of_the_recordings_with_the_own_channels(absent, montage, muscles) -> None:
    chain = chain_of(feature=RMS, montage=montage, normalisation={"reach": "session"})
    whole, partial = recording_of(0), without(absent, 1, gain=5.0)
    alone = feature_range([whole], chain)
    both = feature_range([whole, partial], chain)
    for extent in (both, feature_range([partial, whole], chain)):
        for name in ("minimum", "maximum"):
            own, joined = (one[name].sel(muscle=sorted(muscles)).values for one in (alone, extent))
            np.testing.assert_array_equal(own, joined)
    others = [m for m in both["muscle"].values if m not in muscles and m in alone["muscle"].values]
    assert (both["maximum"] > alone["maximum"]).sel(muscle=others).all()


@pytest.mark.parametrize(("gain", "share"), [(1e-3, "above"), (1e3, "below")])
def test_a_range_of_another_gain_is_stated_where_it_clips(gain: float, share: str) -> None:
    """Before, every muscle was fully active throughout, or never, without a word."""
    chain = chain_of(feature=RMS, normalisation={"reach": "reference", "outside": "clip"})
    extent = feature_range([recording_of(3, gain=gain)], chain)
    result = activation_of(recording_of(), chain, reference=extent)
    named = [f for f in findings_in(result) if f.code == "outside_range"]
    assert len(named) == 20 and all(f.values[share] == 1.0 for f in named)
    fair = feature_range([recording_of(3, gain=2.0), recording_of(4, gain=0.5)], chain)
    result = activation_of(recording_of(), chain, reference=fair)
    assert not [f for f in findings_in(result) if f.code == "outside_range"]


def test_a_trial_below_the_range_requires_rest_and_not_effort() -> None:
    chain = chain_of(feature=RMS, normalisation={"reach": "reference"})
    extent = feature_range([recording_of(3, gain=1e3)], chain)
    with pytest.raises(ActivationError, match="include rest in it"):
        activation_of(recording_of(), chain, reference=extent)


@pytest.mark.parametrize("spelled", ["zyg_l", "ZYG L", "Zyg-L"])
@pytest.mark.parametrize("treatment", ["zero", "mirror", "leave_out"])
def test_a_channel_in_another_spelling_is_not_missing(spelled: str, treatment: str) -> None:
    recording = recording_of()
    names = [spelled if c == "ZYG_L" else c for c in CHANNELS]
    chain = chain_of(montage={"missing_side": treatment})
    with pytest.raises(SchemaError, match=f"'{spelled}', while ZYG_L counts as missing"):
        activation_of(recording.assign_coords(channel=names), chain)
