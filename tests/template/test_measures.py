"""Measures: norms, requirements, settings, and their values in the mesh."""

from dataclasses import asdict, fields

import numpy as np
import pytest

from emgface.errors import FaceError
from emgface.face.template import Measures, build, norms_table, parse_measures, template_face
from emgface.face.template.calibrate import (
    MEASURE_TOLERANCE,
    calibrated_surfaces,
    surface_measures,
)
from emgface.face.template.norms import NORMS
from tests.template.conftest import sheets


def test_every_measure_has_a_norm_with_source_and_standing() -> None:
    names = {field.name for field in fields(Measures)} - {"width_asymmetry", "droop"}
    table = norms_table()
    assert set(table.index) == names
    assert (table["source"].str.len() > 5).all()
    assumed = table["standing"] == "assumption"
    assert (table["standing"][~assumed] == "found").all()
    assert 5 <= (~assumed).sum() < len(table)
    assert (table["note"][assumed].str.len() > 5).all(), "an assumption states its basis"
    assert (table[["men_sd", "women_sd"]] > 0).all(axis=None)
    for sex in ("men", "women"):
        assert (table["smallest"] < table[sex] - table[f"{sex}_sd"]).all()
        assert (table["largest"] > table[sex] + table[f"{sex}_sd"]).all()


def test_defaults_lie_between_women_and_men() -> None:
    values = asdict(Measures())
    for norm in NORMS:
        expected = 0.5e-3 * (norm.men[0] + norm.women[0])
        assert values[norm.name] == pytest.approx(expected, rel=1e-14), norm.name


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"mouth_width": 0.2}, "mouth_width is 200 mm, expected 33 mm to 70 mm"),
        ({"skin_thickness": -1e-3}, "skin_thickness is -1 mm"),
        ({"chin_height": float("nan")}, "chin_height is nan mm"),
        ({"upper_vermilion_height": 0.0139, "upper_lip_height": 0.015}, "upper_vermilion_height"),
        (
            {
                "upper_vermilion_height": 0.0135,
                "lower_vermilion_height": 0.0135,
                "mouth_width": 0.04,
            },
            "add up to 27 mm, expected at most 0.6 of mouth_width",
        ),
        ({"nose_width": 0.048, "mouth_width": 0.04}, "nose_width is 48 mm"),
        ({"jaw_rise": 0.04, "chin_height": 0.037}, "jaw_rise is 40 mm, expected at most 1 of chin"),
        ({"width_asymmetry": 0.5}, "width_asymmetry is 0.5, expected -0.2 to 0.2"),
        ({"lip_width": 0.05}, "unknown measure 'lip_width', expected one of mouth_width"),
    ],
)
def test_impossible_measures_are_refused_by_name(values: dict[str, float], message: str) -> None:
    with pytest.raises(FaceError, match=message):
        template_face(resolution="coarse", measures=values)


def test_a_measure_out_of_reach_is_refused_by_name() -> None:
    with pytest.raises(FaceError, match="lower_lip_protrusion of -4.0 mm cannot be reached"):
        calibrated_surfaces(Measures(chin_protrusion=5e-3, lower_lip_protrusion=-4e-3))


def test_measures_without_a_valid_mesh_are_refused_by_name(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """If the mesh is invalid, the message contains the measure furthest from its norm."""

    def refuse(**given: object) -> None:
        raise FaceError("element 64 is inverted at rest")

    monkeypatch.setattr(build, "build_face", refuse)
    with pytest.raises(FaceError, match=r"^cheek_thickness of 15 mm, 3.1 standard dev.*element 64"):
        template_face(resolution="coarse", measures={"cheek_thickness": 0.015})


@pytest.mark.slow
def test_any_measures_give_a_valid_face_or_are_refused_by_name() -> None:
    """Half of the measures are drawn from the whole range between their bounds."""
    rng, built = np.random.default_rng(3), 0
    for _ in range(8):
        values = {n.name: 1e-3 * rng.uniform(*n.bounds) for n in NORMS if rng.random() < 0.5}
        try:
            template_face(resolution="coarse", measures=values)
            built += 1
        except FaceError as error:
            assert any(norm.name in str(error) for norm in NORMS), error
    assert 0 < built < 8


@pytest.mark.parametrize(
    ("text", "name", "value"),
    [
        ("mouth_width=52mm", "mouth_width", 0.052),
        (" mouth_width = 5.2 cm ", "mouth_width", 0.052),
        ("chin_protrusion=-0.004m", "chin_protrusion", -0.004),
        ("droop=1e3um", "droop", 1e-3),
        ("nose_width=33 millimetres", "nose_width", 0.033),
        ("width_asymmetry=.05", "width_asymmetry", 0.05),
    ],
)
def test_settings(text: str, name: str, value: float) -> None:
    assert parse_measures([text]) == {name: pytest.approx(value, rel=1e-15)}


@pytest.mark.parametrize(
    ("texts", "message"),
    [
        (["mouth_width"], "is not a setting, expected name=value"),
        (["mouth=52mm"], "unknown measure 'mouth'"),
        (["mouth_width=wide"], "mouth_width is 'wide', expected a number"),
        (["mouth_width=52"], "the unit of mouth_width is '', expected one of m, cm, mm, um"),
        (["mouth_width=52s"], "the unit of mouth_width is 's'"),
        (["width_asymmetry=5mm"], "the unit of width_asymmetry is 'mm', expected no unit"),
        (["droop=1mm", "droop=2mm"], "droop is specified twice"),
    ],
)
def test_bad_settings(texts: list[str], message: str) -> None:
    with pytest.raises(FaceError, match=message):
        parse_measures(texts)


@pytest.mark.parametrize(
    "changes", [{}, {"mouth_width": 0.044}, {"upper_lip_height": 0.026, "nose_protrusion": 0.024}]
)
def test_surface_has_the_measures(changes: dict[str, float]) -> None:
    wanted = Measures(**changes)
    for name, value in surface_measures(calibrated_surfaces(wanted)).items():
        assert value == pytest.approx(getattr(wanted, name), abs=MEASURE_TOLERANCE), name


def test_mesh_has_the_measures() -> None:
    """Distances between nodes; the mesh agrees with the skin only at its nodes."""
    face = template_face(resolution="fine", measures={"mouth_width": 0.050, "lip_gap": 0.004})
    skin = sheets(face)[:, :, 3]
    quarter, half = len(skin) // 4, len(skin) // 2
    corners = skin[quarter, 0], skin[-quarter, 0]
    assert np.linalg.norm(corners[0] - corners[1]) == pytest.approx(0.050, abs=MEASURE_TOLERANCE)
    gap = skin[0, 0] - skin[half, 0]
    assert gap[2] == pytest.approx(0.004, abs=MEASURE_TOLERANCE)
    assert np.ptp(skin[..., 0]) == pytest.approx(Measures().face_width, abs=0.5e-3)
    assert -skin[..., 2].min() == pytest.approx(Measures().chin_height, abs=0.5e-3)
    assert skin[0, -1, 2] - Measures().upper_lip_height == pytest.approx(
        Measures().nose_height, abs=2 * MEASURE_TOLERANCE
    )


def test_thickness_of_the_tissue(medium) -> None:
    """The thickness of every region is close to its measure, and that of the skin exact."""
    place = sheets(medium)
    m = Measures()
    whole = np.linalg.norm(place[:, :, 3] - place[:, :, 0], axis=-1)
    rays = len(place)
    assert whole[0, 2] == pytest.approx(m.upper_lip_thickness, rel=0.1)
    assert whole[rays // 2, 2] == pytest.approx(m.lower_lip_thickness, rel=0.1)
    assert whole[rays // 4, 9] == pytest.approx(m.cheek_thickness, rel=0.1)
    assert whole[0, -1] == pytest.approx(m.nose_thickness, rel=0.15)
    skin = np.linalg.norm(place[:, :, 3] - place[:, :, 2], axis=-1)
    np.testing.assert_allclose(skin, m.skin_thickness, rtol=1e-9)
    lower = np.linalg.norm(place[:, :, 1] - place[:, :, 0], axis=-1)
    np.testing.assert_allclose(lower, 0.5 * (whole - skin), rtol=1e-9)
