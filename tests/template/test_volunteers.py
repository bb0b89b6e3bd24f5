"""Presets and random volunteers: properties, reproducibility and variance."""

from dataclasses import asdict, replace

import numpy as np
import pytest
import xarray as xr

from emgface.errors import FaceError
from emgface.face.template import (
    GROUP_PRESETS,
    Measures,
    preset_measures,
    random_measures,
    template_face,
    volunteer_face,
)
from emgface.face.template.norms import NORMS


def test_presets() -> None:
    assert preset_measures() == Measures()
    woman, man, girl = (preset_measures(name) for name in ("woman", "man", "girl"))
    assert woman.mouth_width == pytest.approx(47.9e-3) and man.mouth_width == pytest.approx(50.1e-3)
    assert girl.nose_height == pytest.approx(47.2e-3)
    assert girl.cheek_thickness == pytest.approx(0.86 * woman.cheek_thickness)
    older = preset_measures("older_woman")
    assert older.upper_lip_height > woman.upper_lip_height
    assert older.upper_vermilion_height < woman.upper_vermilion_height
    assert all(len(text) > 10 for text in GROUP_PRESETS.values())


def test_unknown_preset_and_spread() -> None:
    with pytest.raises(FaceError, match="unknown preset 'elf', expected one of adult, woman"):
        preset_measures("elf")
    with pytest.raises(FaceError, match="unknown preset 'elf'"):
        random_measures(1, preset="elf")
    with pytest.raises(FaceError, match="the spread of the volunteers is -1"):
        random_measures(1, spread=-1.0)
    with pytest.raises(FaceError, match="the asymmetry of the volunteers is nan"):
        random_measures(1, asymmetry=float("nan"))
    with pytest.raises(FaceError, match="no possible person .* 1000 attempts with spread 1000"):
        random_measures(1, spread=1e3)


@pytest.mark.slow
def test_volunteers_of_a_set() -> None:
    face, drawn = volunteer_face(2017, 2, resolution="coarse", asymmetry=1.0)
    again, same = volunteer_face(2017, 2, resolution="coarse", asymmetry=1.0)
    xr.testing.assert_identical(face, again)
    assert drawn == same
    for name, value in asdict(drawn).items():
        assert face.attrs[f"measure_{name}"] == value
    assert face.attrs["seed"] == 2017 and face.attrs["index"] == 2
    assert drawn.width_asymmetry != 0.0 and drawn.droop != 0.0
    straight, even = volunteer_face(2017, 2, resolution="coarse")
    assert even.width_asymmetry == even.droop == 0.0
    assert even == replace(drawn, width_asymmetry=0.0, droop=0.0)
    assert not straight["position"].equals(face["position"])
    others = [volunteer_face(seed, k, resolution="coarse")[1] for seed, k in ((2017, 1), (2, 2017))]
    assert even not in others


def test_a_seed_determines_a_person() -> None:
    assert random_measures(7) == random_measures(7)
    assert random_measures(7) != random_measures(8)
    assert random_measures(7, preset="man", spread=0.0) == preset_measures("man")


@pytest.mark.parametrize("name", ["mouth_width", "nose_height", "cheek_fullness", "jaw_width"])
def test_volunteers_have_the_published_mean_and_spread(name: str) -> None:
    """Mean within three standard errors; a normal truncated at 2.5 has 0.953 of its deviation."""
    norm = next(norm for norm in NORMS if norm.name == name)
    n = 800
    values = np.array([getattr(random_measures(k, preset="man"), name) for k in range(n)]) * 1e3
    mean, deviation = norm.men
    # Persons with contradictory measures are drawn again, which slightly changes some means.
    assert values.mean() == pytest.approx(mean, abs=3.0 * deviation / np.sqrt(n) + 0.05 * deviation)
    assert values.std(ddof=1) == pytest.approx(0.953 * deviation, rel=0.08)
    assert np.abs(values - mean).max() <= 2.5 * deviation + 1e-9


def test_face_of_a_volunteer() -> None:
    face = template_face(resolution="coarse", preset="woman", seed=3)
    drawn = random_measures(3, preset="woman")
    assert face.attrs["measure_mouth_width"] == drawn.mouth_width
    assert face.attrs["seed"] == 3 and face.attrs["name"] == "template face (woman, volunteer 3)"
    changed = template_face(
        resolution="coarse", preset="woman", seed=3, measures={"lip_gap": 0.003}
    )
    assert changed.attrs["measure_lip_gap"] == 0.003
    assert changed.attrs["measure_mouth_width"] == drawn.mouth_width
    with pytest.raises(FaceError, match="a full set of measures and a seed"):
        template_face(measures=drawn, seed=3)


def test_negative_seed() -> None:
    with pytest.raises(FaceError, match="seed and index are -1 and 3, expected numbers >= 0"):
        volunteer_face(-1, 3)
