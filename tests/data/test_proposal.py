"""Proposed names of labels, and labels without a proposal."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from scipy.spatial.transform import Rotation

from emgface.errors import DataError
from emgface.muscles import CHANNELS, FACE_MARKERS, LIP_MARKERS, MEASURED, MUSCLE_NAMES
from emgface.recordings.dataset import read_recording
from emgface.recordings.labels import read_label_map
from emgface.recordings.places import with_places
from emgface.recordings.proposal import mapping_text, missing_names, propose_mapping
from emgface.recordings.quality.markers import LAYOUT
from emgface.recordings.words import MUSCLE_WORDS


@pytest.mark.parametrize(
    ("label", "name", "certainty"),
    [
        ("ZYG_L", "ZYG_L", "sure"),
        ("zyg_r", "ZYG_R", "sure"),
        ("Left Zygomaticus Major", "ZYG_L", "sure"),
        ("M. risorius rechts", "RIS_R", "sure"),
        ("EMG 03 - depressor anguli oris (R)", "DAO_R", "sure"),
        ("OrbicularisOrisSuperior_L", "OOS_L", "sure"),
        ("orb. oris inf. left", "OOI_L", "sure"),
        ("LMEN", "MEN_L", "sure"),
        ("mentR", "MEN_R", "sure"),
        ("levator labii superioris alaeque nasi, links", "LLSAN_L", "sure"),
        ("right zygomaticuss", "ZYG_R", "likely"),
        ("left mentallis", "MEN_L", "likely"),
        ("Zygomaticus", "", "unresolved"),
        ("left right zygomaticus", "", "unresolved"),
        ("Biceps L", "", "unresolved"),
        ("EMG 7", "", "unresolved"),
        ("upper lip lower lip L", "", "unresolved"),
        ("Trigger", "", "unresolved"),
        ("", "", "unresolved"),
    ],
)
def test_a_channel_is_proposed(label: str, name: str, certainty: str) -> None:
    row = propose_mapping([label]).iloc[0]
    assert (row["label"], row["name"], row["certainty"]) == (label, name, certainty)
    assert row["reason"]


@pytest.mark.parametrize(
    ("label", "name"),
    [
        ("corner_left", "corner_left"),
        ("Mouth corner R", "corner_right"),
        ("upper lip lateral left", "upper_lateral_left"),
        ("lower_med_R", "lower_paramedian_right"),
        ("nasion", "nasion"),
        ("Nose bridge", "nasion"),
        ("temple L", "temple_left"),
        ("LCommissure", "corner_left"),
        ("upper lip left", ""),
        ("marker 4", ""),
    ],
)
def test_a_marker_is_proposed(label: str, name: str) -> None:
    assert propose_mapping([label], "marker").iloc[0]["name"] == name


def test_all_names_of_the_study_are_proposed_from_themselves_and_from_their_words() -> None:
    assert tuple(MUSCLE_WORDS) == MEASURED
    assert propose_mapping(CHANNELS)["name"].to_list() == list(CHANNELS)
    markers = FACE_MARKERS + LIP_MARKERS
    assert propose_mapping(markers, "marker")["name"].to_list() == list(markers)
    words = [f"{MUSCLE_NAMES[c[:-2]]} {'left' if c.endswith('L') else 'right'}" for c in CHANNELS]
    assert propose_mapping(words)["name"].to_list() == list(CHANNELS)
    spaced = [m.replace("_", " ").upper() for m in markers]
    assert propose_mapping(spaced, "marker")["name"].to_list() == list(markers)


def test_no_name_is_given_twice() -> None:
    table = propose_mapping(["zyg left", "left zygomaticus", "MEN L", "mentallis left"])
    assert table["name"].to_list() == ["", "", "MEN_L", ""]
    assert "all match ZYG_L" in table["reason"][0]
    assert "all match MEN_L" in table["reason"][3]


def test_the_proposal_is_a_mapping_file(tmp_path: Path) -> None:
    channels = propose_mapping(["Left Zygomaticus", 'odd "label" \\ é', "right mentallis"])
    text = mapping_text(channels, propose_mapping(["nasion", "T10"], "marker"))
    content = tomllib.loads(text)
    assert content == {
        "channels": {"Left Zygomaticus": "ZYG_L", "right mentallis": "MEN_R"},
        "markers": {"nasion": "nasion"},
    }
    assert "unresolved: no known muscle" in text and "# no label found for: OOS_L" in text
    (tmp_path / "map.toml").write_text(text, encoding="utf-8")
    assert read_label_map(tmp_path / "map.toml").channels == content["channels"]
    completed = text.replace('# "T10" = ""  #', '"T10" = "rhinion"  #')
    assert tomllib.loads(completed)["markers"]["T10"] == "rhinion"
    assert missing_names(propose_mapping(CHANNELS[1:])) == ["OOS_L"]


def test_an_unknown_kind_is_refused() -> None:
    with pytest.raises(DataError, match="'channels'; expected 'channel' or 'marker'"):
        propose_mapping([], "channels")  # type: ignore[arg-type]


def test_a_recording_of_the_shoulder_stays_unresolved(shared: Path) -> None:
    path = shared / "recordings" / "pyomeca" / "markers_analogs.c3d"
    if not path.is_file():
        pytest.skip("the recording is not there")
    recording = read_recording(path)
    assert set(propose_mapping(recording["channel"].values)["certainty"]) == {"unresolved"}
    assert set(propose_mapping(recording["marker"].values, "marker")["name"]) == {""}


@pytest.mark.parametrize(
    ("label", "name", "reason"),
    [
        ("ZM li", "ZYG_L", ""),
        ("Zyg maj re", "ZYG_R", ""),
        ("OO_sup_R", "OOS_R", ""),
        ("Oberlippe li", "OOS_L", ""),
        ("EMG5: lev. lab. sup. L", "LLSAN_L", ""),
        ("Levator labii superioris alesque nasi left", "LLSAN_L", ""),
        ("Zyg_L [µV]", "ZYG_L", ""),
        ("Orbicularis oris L", "", "neither superior nor inferior"),
        ("orbicularis oculi R", "", "does not record"),
        ("levator anguli oris R", "", "does not record"),
        ("zygomaticus minor L", "", "does not record"),
        ("Corrugator supercilii re", "", "does not record"),
        ("zygomaticus and risorius L", "", "several muscles"),
    ],
)
def test_spellings_of_laboratories(label: str, name: str, reason: str) -> None:
    row = propose_mapping([label]).iloc[0]
    assert row["name"] == name and reason in row["reason"]


def test_a_side_or_a_target_muscle_is_taken_from_elsewhere() -> None:
    labels = ["zygomaticus", "EMG2", "DAO R", "EMG4"]
    targets = {"EMG2": "Mentalis", "EMG4": "platysma"}
    table = propose_mapping(labels, side="L", targets=targets)
    assert table["name"].to_list() == ["ZYG_L", "MEN_L", "DAO_R", ""]
    assert table["certainty"].to_list() == ["likely", "likely", "sure", "unresolved"]
    assert "target muscle is 'Mentalis'" in table["reason"][1]


def placed(names, turn, seed, scale=0.026, noise=0.002) -> xr.DataArray:
    rng = np.random.default_rng(seed)
    points = scale * np.array([LAYOUT[n] for n in names]) @ turn.as_matrix().T + [1.0, 2.0, 0.5]
    points += noise * rng.standard_normal(points.shape)
    return xr.DataArray(points[:, :, None], dims=("marker", "axis", "time_marker"))


@pytest.mark.parametrize("seed", range(5))
def test_markers_without_names_are_proposed_by_their_places(seed: int) -> None:
    names = list(np.random.default_rng(seed).permutation(list(LAYOUT)))
    turn = Rotation.random(random_state=seed)
    labels = propose_mapping([f"M{k}" for k in range(16)], "marker")
    table = with_places(labels, placed(names, turn, seed))
    right = [a == b for a, b in zip(table["name"], names, strict=True)]
    assert sum(right) >= 14 and set(table["certainty"]) <= {"likely", "unresolved"}
    # A layout of another size, and too few markers to tell left from right, propose nothing.
    assert not with_places(labels, placed(names, turn, seed, scale=0.2))["name"].any()
    few = propose_mapping([f"M{k}" for k in range(10)], "marker")
    assert not with_places(few, placed(list(LAYOUT)[6:], turn, seed))["name"].any()


def test_known_markers_determine_the_names_of_the_others() -> None:
    names = ["nasion", "corner_left", "corner_right", "lower_lateral_right", "temple_left"]
    labels = propose_mapping([*names[:3], "*101", "*102"], "marker")
    table = with_places(labels, placed(names, Rotation.random(random_state=3), 3, noise=5e-4))
    assert table["name"].to_list() == names
    assert table["certainty"].to_list() == ["sure"] * 3 + ["likely"] * 2
