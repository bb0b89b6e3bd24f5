"""What labels of laboratories are taken to mean, and what is left to a person."""

import tomllib
from pathlib import Path

import pytest

from emgface.errors import DataError
from emgface.muscles import CHANNELS, FACE_MARKERS, LIP_MARKERS, MEASURED, MUSCLE_NAMES
from emgface.recordings.dataset import read_recording
from emgface.recordings.labels import read_label_map
from emgface.recordings.proposal import MUSCLES, mapping_text, missing_names, propose_mapping


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
    assert tuple(MUSCLES) == MEASURED
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
    assert "all look like ZYG_L" in table["reason"][0]
    assert "all look like MEN_L" in table["reason"][3]


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
    found = read_recording(path)
    assert set(propose_mapping(found["channel"].values)["certainty"]) == {"unresolved"}
    assert set(propose_mapping(found["marker"].values, "marker")["name"]) == {""}
