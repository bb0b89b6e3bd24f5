"""Targets and sEMG of recordings on a face: variants, lost markers, missing channels, refusals."""

import numpy as np
import pytest
import xarray as xr

from emgface.errors import ConfigurationError, MarkerError, SignalError, UnitsError
from emgface.face.measured import check_lips
from emgface.inverse.markers import marker_nodes, wanted_positions
from emgface.inverse.parameters import InverseParameters
from emgface.inverse.run import invert
from emgface.inverse.signals import estimated_activation
from emgface.inverse.variants import INVERSE_VARIANTS, trust_of
from emgface.muscles import LIP_MARKERS, MUSCLES
from emgface.signals.parameters import HeadFrameParameters, SignalChain
from tests.inverse.recordings import recording_of

TIME = 0.01 * np.arange(121)


@pytest.fixture(scope="module")
def face(coarse):
    return coarse


@pytest.fixture(scope="module")
def recording(face):
    return recording_of(face, 1.25)


def wanted(recording, face, **options):
    rest = face["position"].values[marker_nodes(face)]
    return wanted_positions(recording, rest, face, HeadFrameParameters(), TIME, 0.0, **options)


def lost(recording, name, begin, end):
    """Recording without one marker between two times."""
    position = recording["position"].copy()
    away = (position["time_marker"] >= begin) & (position["time_marker"] <= end)
    position.loc[{"marker": name}] = position.sel(marker=name).where(~away)
    return recording.assign(position=position)


def test_the_variants_are_one_family_of_trust():
    trust = {
        v: dict(zip(MUSCLES, trust_of(v, MUSCLES, 3.0, ["ZYG_L"]), strict=True))
        for v in INVERSE_VARIANTS
    }
    assert set(trust["motion"].values()) == {0.0}
    assert set(trust["driven"].values()) == {np.inf}
    for muscle in ("BUC_L", "LAO_R", "DLI_L", "OOM_R", "ZYG_L"):
        assert trust["hybrid"][muscle] == trust["assisted"][muscle] == 0.0
    assert trust["hybrid"]["ZYG_R"] == np.inf and trust["assisted"]["ZYG_R"] == 3.0
    with pytest.raises(ConfigurationError, match="variant 'both' is unknown"):
        trust_of("both", MUSCLES, 1.0)
    with pytest.raises(ConfigurationError, match="expected a number >= 0"):
        trust_of("assisted", MUSCLES, -1.0)


def test_targets_are_displacements_scaled_to_the_mouth_of_the_face(face, recording):
    target = wanted(recording, face)
    rest = face["position"].values[marker_nodes(face)]
    assert target.scale == pytest.approx(0.8, abs=2e-3)
    moved = target.position.values - rest
    left = LIP_MARKERS.index("corner_left")
    assert moved[60, left] == pytest.approx([-4e-3, 0.0, 0.0], abs=4e-4)
    assert np.abs(moved[:10]).max() < 5e-4 and target.at_rest < 2e-4
    # of a coordinate; 0.1 mm in the recording, and the head frame adds its own
    assert target.noise == pytest.approx(0.8e-4, rel=0.4)


def test_a_lost_marker_is_left_out_while_it_is_lost_and_the_others_stay(face, recording):
    whole = wanted(recording, face).position.values
    m = LIP_MARKERS.index("corner_left")
    for begin, end in ((0.4, 0.8), (0.9, 9.0)):
        x = wanted(lost(recording, "corner_left", begin, end), face).position.values
        gone = np.isnan(x[:, m, 0])
        assert gone.sum() == pytest.approx(100 * (min(end, 1.2) - begin), abs=3)
        others = np.delete(np.arange(10), m)
        assert np.isfinite(x[:, others]).all()
        assert np.abs(x[:, others] - whole[:, others]).max() < 1e-4
        assert np.abs(x[~gone, m] - whole[~gone, m]).max() < 3e-4
    brief = wanted(lost(recording, "corner_left", 0.5, 0.54), face).position.values
    assert np.isfinite(brief).all()


def test_a_marker_that_is_never_visible_can_be_left_out(face, recording):
    away = lost(recording, "corner_left", 0.0, 9.0)
    with pytest.raises(MarkerError, match="corner_left is not visible in the first 0.1 s"):
        wanted(away, face)
    absent = recording.sel(marker=[m for m in recording["marker"].values if m != "corner_left"])
    for one in (away, absent):
        target = wanted(one, face, left_out=("corner_left",))
        assert target.scale == pytest.approx(0.8, rel=0.03)
    with pytest.raises(MarkerError, match="missing marker corner_left"):
        wanted(absent, face)


def test_the_size_of_the_mouth_does_not_depend_on_the_markers_left_out(face, recording):
    target = wanted(recording, face, left_out=LIP_MARKERS[1:])
    assert target.scale == wanted(recording, face).scale


@pytest.mark.parametrize("factor", [1e3, 10.0, 0.1])
def test_lip_markers_in_another_unit_than_those_of_the_head_are_refused(face, recording, factor):
    other = recording.copy(deep=True)
    other["position"].loc[{"marker": list(LIP_MARKERS)}] *= factor
    with pytest.raises(UnitsError, match="check the unit of the lip markers"):
        wanted(other, face)


def test_unknown_and_all_markers_to_leave_out_are_refused():
    with pytest.raises(MarkerError, match="left_out contains 'chin'"):
        invert(xr.Dataset(), xr.Dataset(), parameters=InverseParameters(left_out=("chin",)))
    with pytest.raises(MarkerError, match="all lip markers are left out"):
        invert(xr.Dataset(), xr.Dataset(), parameters=InverseParameters(left_out=LIP_MARKERS))


def test_lip_markers_with_exchanged_names_are_refused(recording):
    lips = recording["position"].sel(marker=list(LIP_MARKERS))
    check_lips(lips)
    exchanged = lips * xr.where(lips["axis"] == "x", -1.0, 1.0)
    with pytest.raises(MarkerError, match="corner_right is not to the right of corner_left"):
        check_lips(exchanged)
    pair = {"upper_lateral_left": "lower_lateral_left", "lower_lateral_left": "upper_lateral_left"}
    names = [pair.get(str(m), str(m)) for m in lips["marker"].values]
    with pytest.raises(MarkerError, match="upper_lateral_left is not above lower_lateral_left"):
        check_lips(lips.assign_coords(marker=names))


@pytest.mark.filterwarnings("ignore::emgface.errors.FeatureWarning")
def test_muscles_without_own_sEMG_are_free_and_named(recording):
    chain = SignalChain()

    def missing(one, variant="assisted"):
        return set(estimated_activation(one, chain, variant, None).attrs["missing"].split())

    assert missing(recording) == set()
    left = recording.sel(channel=[c for c in recording["channel"].values if c.endswith("_L")])
    assert missing(left) == {m for m in MUSCLES if m.endswith("_R")}
    flat = recording.copy(deep=True)
    flat["emg"].loc[{"channel": "OOS_L"}] = 3e-5
    assert missing(flat) == {"OOP_L", "OOM_L"}  # half of their signal is lost
    with pytest.raises(ConfigurationError, match="no sEMG, which the variant 'assisted' needs"):
        missing(recording.drop_vars("emg"))


@pytest.mark.filterwarnings("ignore::emgface.errors.FeatureWarning")
def test_the_motion_alone_needs_no_sEMG(recording):
    chain = SignalChain()
    gap = recording.copy(deep=True)
    gap["emg"][3, 100:400] = np.nan
    with pytest.raises(SignalError, match="gap"):
        estimated_activation(gap, chain, "assisted", None)
    for one in (gap, recording.drop_vars("emg")):
        estimate = estimated_activation(one, chain, "motion", None)
        assert float(estimate["activation"].max()) == 0.0
        assert estimate.attrs["montage"].startswith("the sEMG is not used: ")
        assert float(estimate["time"][-1]) == pytest.approx(1.2)


@pytest.mark.filterwarnings("ignore::emgface.errors.FeatureWarning")
def test_sEMG_in_another_unit_is_refused(recording):
    other = recording.assign(emg=(1e3 * recording["emg"]).assign_attrs(units="V"))
    with pytest.raises(UnitsError, match="expected sEMG of at most 0.01 V: check the unit"):
        estimated_activation(other, SignalChain(), "assisted", None)
