"""Eqs 2-8 of the study, and the muscles selected by a strategy."""

import numpy as np
import pytest
import xarray as xr

from emgface.errors import (
    ActivationError,
    ConfigurationError,
    SignalError,
)
from emgface.muscles import CHANNELS, INSTRUCTIONS, MODELLED, MUSCLES, RELEVANT
from emgface.signals.features import feature_of
from emgface.signals.filters import bandpass
from emgface.signals.mapping import map_channels, mapping_matrix
from emgface.signals.normalisation import normalise
from emgface.signals.parameters import NormalisationParameters, SignalChain, StrategyParameters
from emgface.signals.strategies import bilateral_mean, bilateral_variance, select_muscles
from tests.study.recordings import recording_of


def quantity_of(**values) -> xr.DataArray:
    """One sample per channel; left as given, right ten times as much."""
    data = [values[c[:-2]] * (1 if c.endswith("_L") else 10) for c in CHANNELS]
    return xr.DataArray(
        np.array(data, dtype=float)[:, None],
        dims=("channel", "time"),
        coords={"channel": list(CHANNELS), "time": [0.0]},
    )


MEASURED = quantity_of(OOS=1.0, OOI=2.0, RIS=4.0, ZYG=8.0, LLSAN=16.0, DAO=32.0, MEN=64.0)


def muscle(mapped, name) -> list[float]:
    return [float(mapped.sel(muscle=f"{name}_{side}")[0]) for side in "LR"]


def test_equation_2_orbicularis_oris_peripheralis():
    assert muscle(map_channels(MEASURED), "OOP") == pytest.approx([1.5, 15.0])


def test_equation_3_orbicularis_oris_marginalis_text_and_printed():
    assert muscle(map_channels(MEASURED), "OOM") == pytest.approx([0.3, 3.0])  # 0.10 (1 + 2)
    printed = map_channels(MEASURED, "as_printed")
    assert muscle(printed, "OOM") == pytest.approx([0.35, 3.5])  # 0.10 (OOP 1.5 + OOI 2)
    oop, oom = muscle(map_channels(MEASURED), "OOP"), muscle(map_channels(MEASURED), "OOM")
    assert oom == pytest.approx([0.2 * value for value in oop])  # a fifth, as the text says


def test_equation_4_buccinator():
    assert muscle(map_channels(MEASURED), "BUC") == pytest.approx([6.0, 60.0])


def test_equation_5_levator_anguli_oris():
    assert muscle(map_channels(MEASURED), "LAO") == pytest.approx([12.0, 120.0])


def test_equation_6_depressor_labii_inferioris():
    assert muscle(map_channels(MEASURED), "DLI") == pytest.approx([24.0, 240.0])


def test_direct_muscles_and_order():
    mapped = map_channels(MEASURED)
    for name in ("ZYG", "RIS", "LLSAN", "DAO", "MEN"):
        expected = [float(MEASURED.sel(channel=f"{name}_{side}")[0]) for side in "LR"]
        assert muscle(mapped, name) == expected
    assert tuple(mapped["muscle"].values) == MUSCLES
    assert mapping_matrix().shape == (20, 14)


def test_mapping_does_not_depend_on_the_order_of_channels():
    shuffled = MEASURED.isel(channel=np.random.default_rng(0).permutation(14))
    np.testing.assert_array_equal(map_channels(shuffled).values, map_channels(MEASURED).values)
    extra = xr.concat([shuffled, shuffled[:1].assign_coords(channel=["EKG"])], dim="channel")
    np.testing.assert_array_equal(map_channels(extra).values, map_channels(MEASURED).values)


def test_equation_7_is_the_feature_of_the_chain():
    """The printed double sum on the filtered, mapped signal, at three windows."""
    recording = recording_of()
    chain = SignalChain()
    s = map_channels(bandpass(recording["emg"], chain.filter)).values
    feature = feature_of(map_channels(bandpass(recording["emg"], chain.filter)), chain.feature)
    for t in (0, 1234, feature.sizes["time"] - 1):
        g = [sum(abs(row[t + n - 1] - row[t + n]) >= 10e-6 for n in range(1, 410)) for row in s]
        np.testing.assert_array_equal(feature.values[:, t], g)


def test_equation_8_min_max():
    g = xr.DataArray(
        [[2.0, 6.0, 4.0], [-1.0, 0.0, 3.0]],
        dims=("muscle", "time"),
        coords={"muscle": ["a", "b"], "time": [0.0, 1.0, 2.0]},
    )
    got = normalise(g, None, NormalisationParameters())
    np.testing.assert_allclose(got.values, [[0.0, 1.0, 0.5], [0.0, 0.25, 1.0]], rtol=1e-15)


def test_equation_8_over_a_given_range():
    g = xr.DataArray(
        [[2.0, 6.0]], dims=("muscle", "time"), coords={"muscle": ["a"], "time": [0.0, 1.0]}
    )
    extent = xr.Dataset(
        {"minimum": ("muscle", [0.0]), "maximum": ("muscle", [8.0])}, {"muscle": ["a"]}
    )
    session = NormalisationParameters(reach="session")
    np.testing.assert_allclose(normalise(g, extent, session).values, [[0.25, 0.75]])
    with pytest.raises(ActivationError, match=r"muscle a is 1.5 at t = 1 s.*exceeds.*session"):
        normalise(g, extent / 2, session)
    clipped = normalise(g, extent / 2, NormalisationParameters(reach="session", outside="clip"))
    np.testing.assert_allclose(clipped.values, [[0.5, 1.0]])
    assert clipped.attrs["clipped_fraction"] == 0.5


def test_equation_8_is_0_over_0_for_a_constant_feature():
    g = xr.DataArray(
        [[2.0, 2.0], [0.0, 1.0]],
        dims=("muscle", "time"),
        coords={"muscle": ["a", "b"], "time": [0.0, 1.0]},
    )
    with pytest.raises(
        SignalError, match="muscle a is constant over the trial, so that Eq. 8 is 0/0"
    ):
        normalise(g, None, NormalisationParameters())
    tolerant = normalise(g, None, NormalisationParameters(silent="zero"))
    np.testing.assert_array_equal(tolerant.values, [[0.0, 0.0], [0.0, 1.0]])
    assert tolerant.attrs["silent"] == "a"


def feature_with(variances: dict[str, float], left_share=0.5) -> xr.DataArray:
    """Feature whose bilateral mean has the given variances: a sampled square wave."""
    wave = np.tile([1.0, -1.0], 8)
    rows = [2 * left_share * np.sqrt(variances.get(m, 0.0)) * wave for m in MODELLED]
    rows += [2 * (1 - left_share) * np.sqrt(variances.get(m, 0.0)) * wave for m in MODELLED]
    return xr.DataArray(
        np.array(rows) + 3.0,
        dims=("muscle", "time"),
        coords={"muscle": list(MUSCLES), "time": np.arange(16.0)},
    )


def test_bilateral_mean_and_variance():
    feature = feature_with({"BUC": 4.0, "MEN": 1.0}, left_share=0.9)
    np.testing.assert_allclose(bilateral_mean(feature).sel(muscle="BUC").values[:2], [5.0, 1.0])
    variance = bilateral_variance(feature)
    assert float(variance.sel(muscle="BUC")) == pytest.approx(4.0)
    assert float(variance.sel(muscle="MEN")) == pytest.approx(1.0)
    # Sides that move in opposite directions cancel in the mean.
    feature.loc["BUC_R"] = 6.0 - feature.sel(muscle="BUC_L").values
    assert float(bilateral_variance(feature).sel(muscle="BUC")) == pytest.approx(0.0, abs=1e-15)


def test_act_3_selects_the_largest_variances_and_breaks_ties_in_fixed_order():
    few = StrategyParameters()
    feature = feature_with({"DAO": 9.0, "ZYG": 1.0, "OOM": 4.0, "MEN": 0.5})
    assert select_muscles(feature, "act_3", None, few) == ("DAO", "OOM", "ZYG")
    tied = feature_with({"MEN": 4.0, "DLI": 1.0, "LAO": 1.0, "OOP": 1.0})
    assert select_muscles(tied, "act_3", None, few) == ("MEN", "LAO", "OOP")
    assert select_muscles(tied, "act_3", None, StrategyParameters(n=1)) == ("MEN",)


@pytest.mark.parametrize("instruction", list(INSTRUCTIONS))
def test_act_rel_is_table_1(instruction):
    selected = select_muscles(feature_with({}), "act_rel", instruction, StrategyParameters())
    assert set(selected) == set(RELEVANT[instruction])


def test_act_threshold_selects_relative_to_the_most_active():
    feature = feature_with({"DAO": 16.0, "ZYG": 4.1, "OOM": 3.9})  # deviations 4, 2.02, 1.97
    half = StrategyParameters(threshold=0.5)
    assert select_muscles(feature, "act_threshold", None, half) == ("ZYG", "DAO")
    low = StrategyParameters(threshold=0.1)
    assert select_muscles(feature, "act_threshold", None, low) == ("ZYG", "OOM", "DAO")


def test_unknown_strategy_and_instruction():
    feature = feature_with({})
    with pytest.raises(ConfigurationError, match="unknown strategy 'act_al' .did you mean"):
        select_muscles(feature, "act_al", None, StrategyParameters())
    for instruction in ("G", None):
        with pytest.raises(ConfigurationError, match="has no row in the table"):
            select_muscles(feature, "act_rel", instruction, StrategyParameters())
