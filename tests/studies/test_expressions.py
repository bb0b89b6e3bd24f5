"""Expressions: the mouth corner has the largest displacement, which a stiffer skin reduces."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from studies.mechanics.expressions import EXPRESSIONS, SKINS, express, landmarks, summary


@pytest.fixture(scope="module")
def table(coarse: xr.Dataset) -> pd.DataFrame:
    return express(coarse, skins=(SKINS[0], SKINS[2]))[0]


def test_landmarks_lie_where_their_names_say(coarse: xr.Dataset) -> None:
    X, at = coarse["position"].values, landmarks(coarse)
    assert X[at["upper_margin"], 2] > X[at["lower_margin"], 2] > X[at["chin"], 2] + 0.01
    for side, sign in (("left", -1), ("right", 1)):
        outward = (X[at[f"cheek_{side}"]] - X[at[f"corner_{side}"]]) * [sign, 1, 1]
        assert outward[0] > 0.005 and outward[2] > 0.005


def test_the_mouth_corner_moves_most_in_every_expression(table: pd.DataFrame) -> None:
    summary_text = summary(table)
    assert set(summary_text["expression"]) == set(EXPRESSIONS)
    assert (summary_text["moves most"] == "corner").all()
    assert np.allclose(summary_text["largest (mm)"], summary_text["corners (mm)"], rtol=1e-3)
    assert (summary_text["corners (mm)"] > 2.0).all()


def test_expressions_move_landmarks_as_named(table: pd.DataFrame) -> None:
    own = table[table.skin == SKINS[0].name].set_index(["expression", "landmark"])
    corner = own.xs("corner_left", level="landmark")
    for smile in ("closed-mouth smile", "open-mouth smile"):
        assert corner.loc[smile, "medially (mm)"] < -2 and corner.loc[smile, "up (mm)"] > 2
    assert corner.loc["pursing of the lips", "medially (mm)"] > 2
    assert corner.loc["pursing of the lips", "forward (mm)"] > 2
    assert corner.loc["lips turned downwards", "up (mm)"] < -2
    margins = own["up (mm)"].unstack()
    opening = margins["upper_margin"] - margins["lower_margin"]
    assert opening["open-mouth smile"] > opening["closed-mouth smile"] + 1


def test_a_stiffer_skin_moves_landmarks_less(table: pd.DataFrame) -> None:
    size = summary(table).set_index(["expression", "skin"])
    for expression in EXPRESSIONS:
        soft, stiff = (size.loc[(expression, SKINS[k].name)] for k in (0, 2))
        for name in ("corners (mm)", "all landmarks (mm)"):
            assert stiff[name] < 0.97 * soft[name], (expression, name)


def test_older_orthotropic_skin_moves_less(coarse: xr.Dataset) -> None:
    """Fig. 11.15 b: skin types of the publication, from young to old, in a smile."""
    smile = {"open-mouth smile": EXPRESSIONS["open-mouth smile"]}
    ages = tuple(skin for skin in SKINS if skin.name.startswith("anisotropic"))
    summary_text = summary(express(coarse, expressions=smile, skins=ages)[0])
    assert [name.split()[-1] for name in summary_text["skin"]] == ["young", "mature", "old"]
    assert (np.diff(summary_text["corners (mm)"]) < -0.1).all()
    assert (np.diff(summary_text["all landmarks (mm)"]) < -0.1).all()
