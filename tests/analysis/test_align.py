"""Alignment recovers what was done to a trajectory, and does nothing of its own."""

import numpy as np
import pytest
import xarray as xr
from scipy.stats import beta
from synthetic_trajectories import DURATION, once, there_and_back, trajectory

from analysis.align import align
from analysis.errors import AlignmentError, TrajectoryError
from analysis.flags import flags_of
from analysis.lag import overlap_correlation
from analysis.matching import CLEAR_COSINE
from analysis.scores import score

COURSES = pytest.mark.parametrize("course", [once, there_and_back])


def timing_bound(course, scale: float, shift: float, noise: float) -> tuple[float, float]:
    """Cramer-Rao bound [1, s]: least standard deviation of scale and shift under white noise.

    Unknown besides: amplitude and offset of the coefficient vector.
    """
    t = np.linspace(0, DURATION, 160)
    size, step = 5e-3 * np.sqrt(10), 1e-5

    def b(k: float, s: float) -> np.ndarray:
        return size * course(k * t + s)

    jacobian = np.column_stack(
        [
            (b(scale + step, shift) - b(scale - step, shift)) / (2 * step),
            (b(scale, shift + step) - b(scale, shift - step)) / (2 * step),
            b(scale, shift),
            np.ones_like(t),
        ]
    )
    bound = noise * np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))
    return float(bound[0]), float(bound[1])


def test_overlap_correlation_against_a_loop() -> None:
    """Every lag against np.corrcoef of the overlapping samples."""
    rng = np.random.default_rng(1)
    x, y = rng.normal(size=23) + 100.0, rng.normal(size=17) - 40.0
    lags, r, overlap, motion, variance = overlap_correlation(x, y)
    assert list(lags) == list(range(-16, 23))
    for lag, found, count, part, var in zip(lags, r, overlap, motion, variance, strict=True):
        pairs = [(x[i], y[i - lag], i) for i in range(23) if 0 <= i - lag < 17]
        a, b = np.array([p[0] for p in pairs]), np.array([p[1] for p in pairs])
        assert count == len(pairs)
        if len(pairs) > 2:
            assert found == pytest.approx(np.corrcoef(a, b)[0, 1], abs=1e-10)
            fractions = a.var() * len(a) / (x.var() * 23), b.var() * len(b) / (y.var() * 17)
            assert part == pytest.approx(min(fractions), rel=1e-9)
            assert var == pytest.approx(b.var(), rel=1e-9)


@COURSES
@pytest.mark.parametrize("scaling", ["length", "search", "none"])
def test_equal_trajectories_stay_as_they_are(course, scaling: str) -> None:
    data = trajectory(course, noise=5e-4)
    found = align(data, data, scaling=scaling)
    assert (float(found["shift"]), float(found["scale"]), int(found["sign"])) == (0.0, 1.0, 1)
    assert float(found["overlap"]) == 1.0
    assert int(found["shift_at_bound"]) == 0
    np.testing.assert_allclose(found["position"], data["position"], atol=1e-15)
    np.testing.assert_allclose(found["b_aligned"], found["b_simulated"], atol=1e-15)


@COURSES
@pytest.mark.parametrize("shift", [-0.2, -0.0437, 0.0, 0.0083, 0.15])
def test_shift_without_noise(course, shift: float) -> None:
    """Recovered to a thousandth of a sampling period; the positions then agree.

    The rest of the error is that of cubic interpolation at 100 Hz.
    """
    model = trajectory(course)
    found = align(trajectory(course, shift=shift, dim="time_marker"), model)
    assert float(found["shift"]) == pytest.approx(shift, abs=1e-5)
    assert float(found["scale"]) == 1.0
    gap = np.abs(found["position"] - model["position"]).max()
    assert float(gap) < 1e-5
    covered = np.isfinite(found["position"]).all(["marker", "axis"])
    assert float(found["overlap"]) == float(covered.mean())
    assert float(found["overlap"]) == pytest.approx(1 - abs(shift) / DURATION, abs=1 / 80)


@COURSES
@pytest.mark.parametrize(("shift", "scale"), [(-0.05, 1.1), (0.05, 0.9), (0.0, 1.2), (-0.1, 0.85)])
def test_scale_without_noise(course, shift: float, scale: float) -> None:
    """To a thousandth; the rest is the common low-pass acting on unequal speeds."""
    found = align(trajectory(course, shift=shift, scale=scale), trajectory(course),
                  scaling="search")  # fmt: skip
    assert float(found["scale"]) == pytest.approx(scale, abs=1e-3)
    assert float(found["shift"]) == pytest.approx(shift, abs=1e-3)


@pytest.mark.slow
@COURSES
def test_shift_and_scale_under_noise_reach_the_cramer_rao_bound(course) -> None:
    """Forty noisy trials scatter no more than 1.4 times the least possible, without bias.

    1.4 is beyond the 99.9 % point of a standard deviation estimated from forty values.
    """
    shift, scale, noise, count = -0.05, 1.1, 5e-4, 40
    model = trajectory(course)
    errors = []
    for seed in range(count):
        data = trajectory(course, shift=shift, scale=scale, noise=noise, seed=seed)
        found = align(data, model, scaling="search")
        errors.append((float(found["scale"]) - scale, float(found["shift"]) - shift))
    for error, bound in zip(np.array(errors).T, timing_bound(course, scale, shift, noise),
                            strict=True):  # fmt: skip
        assert error.std(ddof=1) < 1.4 * bound
        assert abs(error.mean()) < 4 * bound / np.sqrt(count)


@pytest.mark.slow
@COURSES
def test_noise_creates_no_stretch(course) -> None:
    """With marker noise of 0.5 mm a search leaves the time alone in at least 90 % of trials.

    The plain maximum (`least_gain=0`) stretches nearly every one of them.
    """
    model = trajectory(course)
    trials = [trajectory(course, shift=0.083, noise=5e-4, seed=seed) for seed in range(40)]
    kept = [float(align(data, model, scaling="search")["scale"]) == 1.0 for data in trials]
    assert np.mean(kept) >= 0.9
    plain = [align(data, model, scaling="search", least_gain=0.0)["scale"] for data in trials[:10]]
    assert np.mean([float(scale) == 1.0 for scale in plain]) < 0.5


@COURSES
def test_noise_creates_no_bias_of_the_shift(course) -> None:
    """Interpolation averages noise; without the low-pass that pulls shifts between samples."""
    model, noise, count = trajectory(course), 5e-4, 40
    t = np.linspace(0, DURATION, 160)
    rate = 5e-3 * np.sqrt(10) * np.gradient(course(t), t)
    bound = noise / np.sqrt((rate**2).sum())
    errors = np.array(
        [
            float(align(trajectory(course, noise=noise, seed=s), model)["shift"])
            for s in range(count)
        ]
    )
    assert abs(errors.mean()) < 4 * bound / np.sqrt(count)
    assert errors.std(ddof=1) < 1.4 * bound


def test_mirrored_movement_under_both_rules() -> None:
    """A model that moves the opposite way: by correlation at the true shift, by direction not.

    Either way the disagreement is flagged, and the cosine says what was matched with what.
    """
    model = trajectory(amplitude=-5e-3)
    found = align(trajectory(shift=0.08), model, sign="correlation")
    assert float(found["shift"]) == pytest.approx(0.08, abs=1e-3)
    assert float(found["b_correlation"]) > 0.999
    assert float(found["direction_cosine"]) < -0.9
    kept = align(trajectory(shift=0.08), model)
    assert float(kept["direction_cosine"]) > 0.9
    assert float(kept["b_correlation"]) < 0.9
    assert int(found["sign_disagrees"]) == int(kept["sign_disagrees"]) == 1
    same = align(trajectory(shift=0.08), trajectory())
    assert float(same["direction_cosine"]) > 0.9
    assert (int(same["sign_disagrees"]), int(same["sign_by_direction"])) == (0, 1)


def lobes(*sizes: float):
    """Course of left, right, left: half waves of these sizes, of alternating sign."""

    def course(t: np.ndarray) -> np.ndarray:
        phase = np.clip((t - 0.2) / 1.2, 0, 1 - 1e-12) * len(sizes)
        return np.asarray(sizes)[phase.astype(int)] * np.sin(np.pi * phase)

    return course


@pytest.mark.parametrize("noise", [0.0, 3e-4])
def test_left_right_left_matches_itself_and_not_its_mirror(noise: float) -> None:
    """One side stronger in the volunteer, the other in the model: a lobe's shift fits the mirror.

    The larger correlation maximum, 0.92 at 0.4 s, belongs to left matched with right.
    """
    model = trajectory(lobes(0.5, 1.0, 1.0))
    data = trajectory(lobes(1.0, 1.0, 0.5), noise=noise)
    found = align(data, model)
    assert abs(float(found["shift"])) < 0.05
    assert float(score(found, model)["rho"].median()) > 0.7
    assert (int(found["sign_disagrees"]), int(found["sign_by_direction"])) == (1, 1)
    mirrored = align(data, model, sign="correlation")
    assert abs(float(mirrored["shift"])) == pytest.approx(0.4, abs=0.02)
    assert float(mirrored["b_correlation"]) > float(found["b_correlation"])
    assert float(score(mirrored, model)["rho"].median()) < -0.7
    assert (int(mirrored["sign_disagrees"]), int(mirrored["sign_by_direction"])) == (1, 0)
    assert mirrored.attrs["sign_by"] == "correlation"


def test_time_reversed_movement_keeps_its_direction() -> None:
    """Pursing run backwards is still pursing: the signs agree and no mirror is matched."""
    data, model = trajectory(), trajectory()
    backwards = data.isel(time=slice(None, None, -1)).assign_coords(time=data["time"])
    found = align(backwards, model)
    assert float(found["direction_cosine"]) > 0.9
    assert (int(found["sign_disagrees"]), int(found["sign_by_direction"])) == (0, 1)


def test_unrelated_directions_leave_the_sign_to_the_correlation() -> None:
    """Every marker moves along an axis that the model's does not."""
    data, model = trajectory(shift=0.08), trajectory()
    rng = np.random.default_rng(5)
    turned = data.copy(deep=True)
    centred = data["position"] - data["position"].mean("time")
    turned["position"] = data["position"] + 0.0
    for k in range(10):
        axis = np.cross(centred.values[k, :, 60], rng.normal(size=3))
        axis /= np.linalg.norm(axis)
        size = np.linalg.norm(centred.values[k], axis=0) * np.sign(centred.values[k, 0])
        turned["position"].values[k] = axis[:, None] * size
    turned["position"].attrs["units"] = "m"
    by_rule = [align(turned, model, sign=rule) for rule in ("direction", "correlation")]
    assert abs(float(by_rule[0]["direction_cosine"])) < CLEAR_COSINE
    assert int(by_rule[0]["sign_by_direction"]) == 0
    for name in ("shift", "sign", "b_correlation", "position"):
        np.testing.assert_array_equal(by_rule[0][name], by_rule[1][name])


def test_clear_cosine_is_the_point_of_five_per_cent_in_six_dimensions() -> None:
    """cos^2 of a random direction follows Beta(1/2, (d - 1)/2)."""
    assert CLEAR_COSINE == pytest.approx(np.sqrt(beta.ppf(0.95, 0.5, 2.5)), abs=0.005)
    drawn = np.random.default_rng(0).normal(size=(20000, 6))
    cosine = np.abs(drawn[:, 0]) / np.linalg.norm(drawn, axis=1)
    assert np.mean(cosine > CLEAR_COSINE) == pytest.approx(0.05, abs=4 * np.sqrt(0.05 / 20000))


def test_sign_resolves_half_a_period() -> None:
    """Left-right-left shifted by little must not match right-left at half a period."""
    found = align(trajectory(there_and_back, shift=0.05, noise=1e-3), trajectory(there_and_back))
    assert float(found["shift"]) == pytest.approx(0.05, abs=0.02)
    assert float(found["direction_cosine"]) > 0.9


def test_periodic_movement_takes_the_nearest_peak() -> None:
    """A steady oscillation fits equally well at every period; the smallest shift is right."""

    def wave(t: np.ndarray) -> np.ndarray:
        return np.sin(2 * np.pi * t / 0.2)

    for shift in (0.0, 0.03, -0.03):
        for seed in range(5):
            data = trajectory(wave, shift=shift, noise=5e-4, seed=seed)
            found = align(data, trajectory(wave))
            assert float(found["shift"]) == pytest.approx(shift, abs=0.01)


def test_length_is_normalised() -> None:
    """A movement twice as slow, recorded twice as long, with another rate and marker order."""
    model = trajectory()
    slow = trajectory(scale=0.5, shift=0.04, duration=2 * DURATION, count=401, dim="time_marker")
    slow = slow.isel(marker=slice(None, None, -1))
    found = align(slow, model)
    assert float(found["scale"]) == pytest.approx(0.5, rel=1e-12)
    assert float(found["shift"]) == pytest.approx(0.04, abs=1e-4)
    assert list(found["marker"].values) == list(model["marker"].values)
    assert float(np.abs(found["position"] - model["position"]).max()) < 2e-5


def test_durations_within_a_period_are_not_stretched() -> None:
    """159 samples against 160 are the same duration, not a slower movement."""
    model = trajectory()
    assert float(align(model.isel(time=slice(None, -1)), model)["scale"]) == 1.0


def test_start_times_do_not_matter() -> None:
    model = trajectory()
    late = trajectory(shift=0.06).assign_coords(time=model["time"] + 12.0)
    assert float(align(late, model)["shift"]) == pytest.approx(0.06, abs=1e-4)


def test_uneven_simulated_time() -> None:
    """A simulation with halved steps keeps its own instants."""
    keep = np.r_[0:60, 61:100:2, 100:160]
    model = trajectory().isel(time=keep)
    found = align(trajectory(shift=0.06), model)
    assert float(found["shift"]) == pytest.approx(0.06, abs=1e-4)
    np.testing.assert_array_equal(found["time"], model["time"])


def test_whole_samples_on_request() -> None:
    model = trajectory()
    found = align(trajectory(shift=0.083), model, subsample=False)
    period = DURATION / 159
    assert float(found["shift"]) == pytest.approx(round(0.083 / period) * period, abs=1e-12)


def test_bound_on_the_shift() -> None:
    """The true shift lies outside: the nearest allowed one is taken, and said to be the bound."""
    found = align(trajectory(shift=0.2), trajectory(), max_shift=0.1)
    assert abs(float(found["shift"])) <= 0.1
    assert int(found["shift_at_bound"]) == 1
    assert float(align(trajectory(shift=0.2), trajectory(), max_shift=0.0)["shift"]) == 0.0


@pytest.mark.parametrize("sign", ["direction", "correlation"])
@pytest.mark.parametrize("shift", [0.45, 0.6, 0.8])
def test_shift_beyond_the_overlap_is_said(sign: str, shift: float) -> None:
    """The allowed shifts hold lesser peaks, of which the mirror's fits at -0.75."""
    for one in (shift, -shift):
        found = align(trajectory(there_and_back, shift=one), trajectory(there_and_back), sign=sign)
        assert int(found["shift_at_bound"]) == 1
        inside = np.sign(one) * (shift - 0.41)
        near = align(
            trajectory(there_and_back, shift=inside), trajectory(there_and_back), sign=sign
        )
        assert int(near["shift_at_bound"]) == 0


def test_burst_shifted_out_of_the_overlap_is_a_weak_match() -> None:
    """Where less than half of the motion is left, no shift can be told from another."""
    found = align(trajectory(shift=0.8), trajectory())
    assert float(found["b_correlation"]) < 0.7
    assert int(found["weak_match"]) == 1
    assert int(align(trajectory(shift=0.3), trajectory())["weak_match"]) == 0


@COURSES
def test_noise_raises_no_flags(course) -> None:
    model = trajectory(course)
    for seed in range(10):
        found = align(trajectory(course, shift=0.1, noise=5e-4, seed=seed), model)
        assert flags_of(found) == []


def test_stretch_outside_the_range_is_said() -> None:
    """A quarter of a second is stretched 6.4 times by its length; a search ends at its bound."""
    short = trajectory(duration=0.25, count=26, scale=6.4)
    found = align(short, trajectory())
    assert float(found["scale"]) == pytest.approx(6.4)
    assert int(found["scale_at_bound"]) == 1
    searched = align(trajectory(scale=1.5), trajectory(), scaling="search")
    assert int(searched["scale_at_bound"]) == 1
    for scale in (0.9, 1.0, 1.15):
        inside = align(trajectory(scale=scale), trajectory(), scaling="search")
        assert int(inside["scale_at_bound"]) == 0


@pytest.mark.parametrize("lost", [slice(0, 20), slice(-20, None)])
@pytest.mark.parametrize("shift", [0.0, 0.083, -0.06])
def test_unseen_ends_are_left_out_and_stretch_nothing(lost: slice, shift: float) -> None:
    """One marker is not seen for an eighth of the trial: shift and scale are those without."""
    model, data = trajectory(), trajectory(shift=shift, dim="time_marker")
    data["position"].values[4, :, lost] = np.nan
    found = align(data, model)
    assert float(found["scale"]) == 1.0
    assert float(found["shift"]) == pytest.approx(shift, abs=1e-4)
    period = DURATION / 159
    assert float(found["unseen_ends"]) == pytest.approx(20 * period, rel=1e-9)
    covered = np.isfinite(found["position"]).all(["marker", "axis"])
    assert float(found["overlap"]) == float(covered.mean()) < 0.9
    np.testing.assert_allclose(score(found, model)["rho"], 1.0, atol=1e-5)
    whole = align(trajectory(shift=shift), model)
    both = covered & np.isfinite(whole["position"]).all(["marker", "axis"])
    gap = (found["position"] - whole["position"]).where(both)
    assert float(abs(gap).max()) < 1e-5
    assert flags_of(found) == []


def test_little_overlap_is_said() -> None:
    data = trajectory()
    data["position"].values[:, :, 110:] = np.nan
    found = align(data, trajectory())
    assert float(found["overlap"]) == pytest.approx(110 / 160, abs=1 / 160)
    assert flags_of(found) == ["little_overlap"]


def test_small_overlap_cannot_win() -> None:
    """Two trajectories that agree only in a corner are not shifted to that corner."""
    rng = np.random.default_rng(3)
    t = np.linspace(0, DURATION, 160)
    tail = np.interp(t, np.linspace(0, DURATION, 12), rng.normal(size=12))
    head = np.interp(t, np.linspace(0, DURATION, 12), rng.normal(size=12))
    head[:30] = tail[-30:]
    model = trajectory(lambda own: np.interp(own, t, head))
    data = trajectory(lambda own: np.interp(own, t, tail))
    lags, r, *_ = overlap_correlation(head, tail)
    assert r[lags == -130] == pytest.approx(1.0, abs=1e-9)  # the trap is there
    found = align(data, model)
    assert float(found["overlap"]) >= 0.74
    assert abs(float(found["shift"])) <= 0.26 * DURATION


def test_uncentred_on_request() -> None:
    found = align(trajectory(shift=0.08), trajectory(), centred=False)
    assert found.attrs["centred"] == 0
    assert float(found["explained_variance_measured"]) > 0.97
    assert float(found["shift"]) == pytest.approx(0.08, abs=0.02)


def test_choices_and_identity_are_recorded() -> None:
    data = trajectory(origin="simulated", volunteer="v1", instruction="A", repetition=2)
    model = trajectory(strategy="act_3", origin="simulated")
    found = align(data, model, scaling="search", max_shift=0.3)
    assert found.attrs["origin"] == "simulated"
    assert (found.attrs["volunteer"], found.attrs["repetition"]) == ("v1", 2)
    assert found.attrs["strategy"] == "act_3"
    assert (found.attrs["scaling"], found.attrs["max_shift"]) == ("search", 0.3)
    assert all("units" in found[name].attrs for name in found.data_vars)


def test_result_survives_netcdf(tmp_path) -> None:
    found = align(trajectory(shift=0.05), trajectory())
    found.to_netcdf(tmp_path / "aligned.nc")
    with xr.open_dataset(tmp_path / "aligned.nc") as again:
        xr.testing.assert_equal(again.load(), found)


def still(data: xr.Dataset) -> xr.Dataset:
    data["position"].values[:] = data["position"].values[:, :, :1]
    return data


def gap(data: xr.Dataset) -> xr.Dataset:
    data["position"].values[3, :, 20:25] = np.nan
    return data


@pytest.mark.parametrize(
    ("spoil", "error", "words"),
    [
        (still, AlignmentError, "measured trajectory does not move"),
        (gap, TrajectoryError, r"gaps at 5 of 160 instants \(marker_3\)"),
        (lambda d: d.isel(marker=slice(1, None)), TrajectoryError, "not measured: marker_0"),
        (lambda d: d.isel(time=slice(0, 7)), TrajectoryError, "7 samples, expected at least 8"),
    ],
)
def test_degenerate_trajectories(spoil, error: type, words: str) -> None:
    with pytest.raises(error, match=words):
        align(spoil(trajectory()), trajectory())


def test_extra_markers_are_refused() -> None:
    with pytest.raises(TrajectoryError, match="not simulated: marker_9"):
        align(trajectory(), trajectory().isel(marker=slice(0, 9)))


def test_model_that_does_not_move() -> None:
    with pytest.raises(AlignmentError, match="simulated trajectory does not move"):
        align(trajectory(), trajectory(amplitude=1e-11))


@pytest.mark.parametrize(
    ("option", "words"),
    [
        ({"scaling": "linear"}, "'linear', expected 'length'"),
        ({"sign": "up"}, "'up', expected 'direction'"),
        ({"clear_cosine": 1.5}, "clear_cosine is 1.5"),
        ({"scale_range": (1.1, 1.2)}, "expected 0 < least <= 1"),
        ({"scale_step": 0.0}, "scale_step is 0.0"),
        ({"max_shift": -1.0}, "max_shift is -1.0 s"),
        ({"least_overlap": 0.0}, "least_overlap is 0.0"),
        ({"cutoff": 0.0}, "cutoff is 0.0 Hz"),
        ({"least_gain": 1.0}, "least_gain is 1.0"),
    ],
)
def test_options_out_of_range(option: dict, words: str) -> None:
    with pytest.raises(AlignmentError, match=words):
        align(trajectory(), trajectory(), **option)


def test_no_allowed_shift() -> None:
    """All the measured motion lies outside what overlaps."""

    def early(t: np.ndarray) -> np.ndarray:
        return np.exp(-(((t - 0.05) / 0.01) ** 2))

    def late(t: np.ndarray) -> np.ndarray:
        return np.exp(-(((t - 2.95) / 0.01) ** 2))

    data = trajectory(late, duration=3.0, count=300)
    with pytest.raises(AlignmentError, match="no shift leaves an overlap"):
        align(data, trajectory(early), scaling="none", max_shift=0.1)
