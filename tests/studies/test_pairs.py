"""Pairs of one muscle's EMG and landmarks of a video: closed forms, and simulated folders both ways."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from emgface.errors import DataError
from studies.pairs.__main__ import main, pairs, trials_of
from studies.pairs.landmarks import in_frame_of_head, read_landmarks
from studies.pairs.scores import STEP, Trial, best_correlation, differences, scored, template
from studies.pairs.simulated import make_folder


def test_the_motion_of_the_head_is_removed() -> None:
    """Points under any turn, scale and shift are those of the median frame over the eye distance."""
    rng = np.random.default_rng(2)
    still = rng.uniform(-1.0, 1.0, 68) + 1j * rng.uniform(-1.0, 1.0, 68)
    turn = np.exp(1j * rng.uniform(-0.3, 0.3, 30)) * rng.uniform(0.8, 1.2, 30)
    shift = rng.uniform(-2, 2, 30) + 1j * rng.uniform(-2, 2, 30)
    z = turn[:, None] * still + shift[:, None]
    positions = in_frame_of_head(np.stack([z.real, z.imag], axis=-1))
    assert np.allclose(positions, positions[0], atol=1e-12)
    z[3] = np.nan
    lost = in_frame_of_head(np.stack([z.real, z.imag], axis=-1))
    assert np.isnan(lost[3]).all() and np.isfinite(lost[4]).all()


def test_a_known_lag_is_found() -> None:
    signal = np.exp(-0.5 * ((np.arange(150) * STEP - 1.2) / 0.2) ** 2)
    rho, lag = best_correlation(signal, np.roll(signal, 15))
    assert rho == pytest.approx(1.0, abs=1e-3) and lag == pytest.approx(15 * STEP)
    assert np.isnan(best_correlation(np.zeros(100), signal)[0])


def test_the_template_contains_no_trial_of_the_volunteer() -> None:
    rng = np.random.default_rng(4)
    trials = [Trial(f"V{k // 2}", "D", 1 + k % 2, rng.random(90), rng.random(90)) for k in range(6)]
    before = template(trials, 0)
    changed = [Trial(t.volunteer, "D", t.repetition, 9.0 * t.measured**2, t.predicted)
               if t.volunteer == "V0" and t.repetition == 2 else t for t in trials]  # fmt: skip
    assert np.array_equal(before, template(changed, 0), equal_nan=True)
    alone = scored(trials[:2])
    assert alone["template"].isna().all() and alone["shuffled EMG"].notna().all()


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> dict[bool, Path]:
    folder = tmp_path_factory.mktemp("pairs")
    return {
        related: make_folder(folder / str(related), related=related) for related in (True, False)
    }


def test_related_emg_is_distinguished_from_template_and_shuffled_emg(
    folders: dict[bool, Path],
) -> None:
    """Positive control: the EMG of the motion; negative control: EMG of other courses."""
    scores_by_relation: dict[bool, pd.DataFrame] = {}
    for related, folder in folders.items():
        trials, simulated = trials_of(folder, folder / "mapping.toml", "ZYG_L")
        assert simulated and len(trials) == 10
        scores_by_relation[related] = scored(trials)
    own, other = scores_by_relation[True], scores_by_relation[False]
    assert own["EMG"].mean() > 0.85
    for values in differences(own).values():
        assert (values > 0.0).all()
    # unrelated EMG is no better than that of another repetition
    spread = differences(other)["shuffled EMG"]
    assert abs(spread.mean()) < 2.8 * spread.std(ddof=1) / np.sqrt(spread.size)
    assert own["EMG"].mean() > other["EMG"].mean() + 0.1


def test_the_command_writes_labelled_results(folders: dict[bool, Path], tmp_path: Path) -> None:
    few = tmp_path / "few"
    few.mkdir()
    for path in folders[True].iterdir():
        if path.name.startswith(("V1", "V2", "README", "mapping")):
            (few / path.name).write_bytes(path.read_bytes())
    (few / "V2_D_2_landmarks.csv").unlink()
    assert pairs(few)[1] == ["V2_D_2"]
    out = tmp_path / "out"
    main([str(few), "--mapping", str(few / "mapping.toml"), "--out", str(out)])
    text = (out / "pairs.md").read_text()
    assert "SIMULATED" in text and "fewer than 5 volunteers give no interval" in text
    assert len(pd.read_csv(out / "pairs.csv")) == 3 and (out / "pairs.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: t.drop(columns=[c for c in t if str(c).strip() == "x_54"]), "lacks the columns x_54"),
        (lambda t: t.iloc[::-1], "do not increase"),
    ],
)  # fmt: skip
def test_damaged_landmarks_are_refused(
    folders: dict[bool, Path], tmp_path: Path, change, message
) -> None:
    table = pd.read_csv(folders[True] / "V1_D_1_landmarks.csv")
    path = tmp_path / "V1_D_1_landmarks.csv"
    change(table).to_csv(path, index=False)
    with pytest.raises(DataError, match=message):
        read_landmarks(path)


def test_a_folder_without_pairs_or_with_another_muscle_is_refused(
    folders: dict[bool, Path], tmp_path: Path
) -> None:
    with pytest.raises(DataError, match="no pair"):
        trials_of(tmp_path, None, "ZYG_L")
    with pytest.raises(DataError, match="expected ZYG_R"):
        trials_of(folders[True], folders[True] / "mapping.toml", "ZYG_R")
