"""EMG of motor units: published recruitment, Campbell's theorem, potentials against quadrature."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.signal import welch

from emgface.muscles import CHANNELS, MUSCLES
from emgface.volunteers.action_potentials import (
    ANISOTROPY,
    FibreGeometry,
    action_potentials,
)
from emgface.volunteers.emg import draw_pools, pickup_matrix, synthesise_emg
from emgface.volunteers.instructions import true_activation
from emgface.volunteers.motor_units import (
    HIGHEST_RATE,
    LOWEST_RATE,
    RATE_DIFFERENCE,
    RECRUITMENT_RANGE,
    SIZE_RANGE,
    discharges,
    draw_pool,
    pool_signal,
)

RATE = 2048.0


@pytest.fixture(scope="module")
def pool():
    return draw_pool(np.random.default_rng(3), RATE)


def test_units_are_recruited_by_size_and_fire_as_published(pool) -> None:
    """Fuglevand et al. 1993: thresholds RR^(i/n), rates from 8 up to their peaks, in order."""
    n = pool.threshold.size
    np.testing.assert_allclose(pool.threshold, RECRUITMENT_RANGE ** (np.arange(1, n + 1) / n))
    drawn = [draw_pool(np.random.default_rng(seed), RATE) for seed in range(8)]
    energy = [np.log(np.square(one.potential).sum(axis=(1, 2))) for one in drawn]
    slope = np.polyfit(np.arange(n), np.mean(energy, axis=0), 1)[0]
    # sizes RP^(i/n), squared; places of 100 units in 8 pools scatter the slope by some 5 %, and
    # larger units conduct faster
    assert slope == pytest.approx(2.0 * np.log(SIZE_RANGE) / n, rel=0.2)
    levels = np.linspace(0.0, 1.0, 401)
    rate = pool.rates(levels)
    assert not rate[:, 0].any()
    active = (rate > 0).sum(axis=0)
    assert (np.diff(active) >= 0).all() and active[-1] == n
    for unit in (0, n // 2, n - 1):
        began = np.argmax(rate[unit] > 0)
        assert levels[began] == pytest.approx(pool.threshold[unit] / pool.full, abs=1 / 400)
        assert LOWEST_RATE <= rate[unit, began] <= LOWEST_RATE + pool.full / 400
        assert (np.diff(rate[unit]) >= 0).all()
    assert rate[0, -1] == HIGHEST_RATE
    assert rate[-1, -1] == pytest.approx(HIGHEST_RATE - RATE_DIFFERENCE)
    # At any level, later units have lower rates ("onion skin").
    assert (np.diff(rate[:, 200][rate[:, 200] > 0]) <= 0).all()


def test_discharges_follow_a_changing_rate_and_are_absent_in_silence() -> None:
    rate = np.zeros((200, 8 * 2048))
    rate[:, 2048:6144] = np.linspace(10.0, 40.0, 4096)
    rate[:, 12288:] = 20.0
    unit, time = discharges(rate, RATE, np.random.default_rng(0))
    assert ((time >= 1.0) & (time <= 3.0 + 1e-9) | (time >= 6.0)).all()
    # 50 discharges are expected in the ramp and 40 in the last two seconds, in each of 200 units
    assert (time < 4.0).sum() / 200 == pytest.approx(50.0, abs=0.5)
    assert (time > 6.0).sum() / 200 == pytest.approx(40.0, abs=0.5)
    late = [np.diff(time[(unit == u) & (time > 6.0)]) for u in range(200)]
    intervals = np.concatenate(late)
    assert intervals.mean() == pytest.approx(0.05, rel=0.01)
    assert intervals.std() / intervals.mean() == pytest.approx(0.2, rel=0.03)


@pytest.mark.parametrize("level", [0.05, 0.3, 1.0])
def test_amplitude_is_that_of_campbells_theorem(pool, level: float) -> None:
    signal = pool_signal(pool, np.full(60 * 2048, level), np.random.default_rng(1))
    expected = float(pool.rms(np.array([level]))[0])
    assert signal[2048:-2048].std() == pytest.approx(expected, rel=0.05)
    assert float(pool.rms(np.ones(1))[0]) == pytest.approx(1.0)


def test_the_potential_of_a_unit_is_the_integral_of_its_source() -> None:
    """Compared with adaptive quadrature of the current, differentiated by hand."""
    one = FibreGeometry(
        *(np.array([v]) for v in (4e-3, 12e-3, 22e-3, 4.0, 0.0, 2e-3, 0.3)), distance=0.01
    )
    potentials = action_potentials(one, 8192.0)[0]

    def psi(x: float) -> float:  # dV/dx of Rosenfalck's potential, x in mm
        return 96.0 * x**2 * (3.0 - x) * np.exp(-x) if x > 0 else 0.0

    def slope(x: float) -> float:
        return 96.0 * x * (6.0 - 6.0 * x + x**2) * np.exp(-x) if x > 0 else 0.0

    def weight(z: float) -> float:
        def inverse(sign: float) -> float:
            along, across = 12e-3 + sign * 5e-3 * np.cos(0.3), 2e-3 + sign * 5e-3 * np.sin(0.3)
            return ((z - along) ** 2 + ANISOTROPY * (16e-6 + across**2)) ** -0.5

        return inverse(-1.0) - inverse(1.0)

    for sample in (12, 30, 60):  # before, during and after the wave reaches the ends
        t = sample / 8192.0
        total = 0.0
        for side in (1.0, -1.0):
            # i = d/dz [sign psi]: along the way, a source at the end plate and one at the end
            def current(z: float, side: float = side, t: float = t) -> float:
                return -1e3 * slope(1e3 * (4.0 * t - z)) * weight(side * z)

            front = min(4.0 * t, 22e-3)
            total += quad(current, 0.0, front, epsrel=1e-10, limit=200)[0]
            total += psi(4e3 * t) * weight(0.0) - psi(1e3 * (4.0 * t - 22e-3)) * weight(
                side * 22e-3
            )
        assert potentials[sample] == pytest.approx(
            total, rel=2e-3, abs=1e-3 * np.abs(potentials).max()
        )


def test_the_spectrum_is_that_of_facial_emg(pool) -> None:
    signal = pool_signal(pool, np.full(30 * 2048, 0.4), np.random.default_rng(2))
    frequency, density = welch(signal, RATE, nperseg=2048)
    share = density[(frequency >= 15) & (frequency <= 500)].sum() / density.sum()
    assert share > 0.98
    median = frequency[np.searchsorted(np.cumsum(density), 0.5 * density.sum())]
    assert 80.0 < median < 200.0


def test_channels_record_their_muscles_with_the_stated_gain() -> None:
    activation = true_activation("B", duration=8.0)
    activation[:] = 0.0
    activation.loc["MEN_L"] = 1.0
    quiet = {"cross_talk": 0.0, "baseline_noise": 0.0, "mains_hum": 0.0}
    pools = draw_pools(np.random.default_rng(5))
    weight = pickup_matrix()
    under = {(CHANNELS[i], MUSCLES[j]) for i, j in zip(*np.nonzero(weight), strict=True)}
    # No electrode pair is above the buccinator; its EMG is picked up through the tissue.
    assert len(under) == 22 and set(pools) - under == {("RIS_L", "BUC_L"), ("RIS_R", "BUC_R")}
    assert under < set(pools)
    emg = synthesise_emg(activation, gain=np.full(14, 100e-6), rng=np.random.default_rng(6),
                         pools=pools, **quiet)  # fmt: skip
    rms = emg.isel(time_emg=slice(2048, -2048)).std("time_emg")
    assert float(rms.sel(channel="MEN_L")) == pytest.approx(100e-6, rel=0.06)
    assert float(rms.drop_sel(channel="MEN_L").max()) == 0.0
