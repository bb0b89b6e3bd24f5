"""Models that are turned or mirrored relative to their frame are refused, in files and in memory."""

import numpy as np
import pytest
import xarray as xr
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

import emgface as ef
from emgface.anatomy.checked import CHECKS
from emgface.anatomy.head.build import build_head
from emgface.cli import app
from emgface.errors import DataError
from emgface.models.kinds import MODEL_KINDS

TURNS = {
    "LPS": Rotation.from_euler("z", 180, degrees=True).as_matrix(),
    "nose up": Rotation.from_euler("x", 90, degrees=True).as_matrix(),
    "nose down": Rotation.from_euler("x", -90, degrees=True).as_matrix(),
    "on its side": Rotation.from_euler("y", 90, degrees=True).as_matrix(),
    "mirrored": np.diag([-1.0, 1.0, 1.0]),
}
MODELS = {kind.model: name for name, kind in MODEL_KINDS.items() if kind.model in CHECKS}


@pytest.fixture(scope="module")
def models() -> dict[str, xr.Dataset]:
    size = {"jaw": None}
    return {name: ef.build(name, resolution=size.get(name, "coarse")) for name in MODELS.values()}


def turned(model: xr.Dataset, matrix: np.ndarray) -> xr.Dataset:
    """The same model with all vectors turned."""
    vectors = {
        name: values.copy(data=np.moveaxis(np.moveaxis(values.values, k, -1) @ matrix.T, -1, k))
        for name, values in model.data_vars.items()
        if "axis" in values.dims and values.dtype.kind == "f" and values.ndim > 1
        for k in [values.dims.index("axis")]
    }
    return model.assign(vectors)


def test_every_model_with_places_has_a_check():
    assert set(MODELS) == set(CHECKS) and len(MODELS) == 3


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("kind", MODELS)
def test_a_turned_model_is_refused_by_its_check_and_as_a_file(kind, turn, models, tmp_path):
    wrong = turned(models[MODELS[kind]], TURNS[turn])
    with pytest.raises(DataError, match="direction of the|inverted at rest|oriented inwards"):
        CHECKS[kind](wrong)
    path = tmp_path / "turned.nc"
    wrong.to_netcdf(path)
    for command in (["check", str(path)], ["show", str(path), "--out", str(tmp_path / "t.png")]):
        result = CliRunner().invoke(app, command)
        assert result.exit_code == 2, result.output
    for use in (ef.read, ef.show):
        with pytest.raises(DataError, match="direction of the|inverted at rest|oriented inwards"):
            use(path)
    with pytest.raises(DataError, match="direction of the|inverted at rest|oriented inwards"):
        ef.show(wrong)


@pytest.mark.parametrize("kind", MODELS)
@pytest.mark.parametrize("axis", "xyz")
def test_an_inclined_head_is_accepted(kind, axis, models):
    inclined = Rotation.from_euler(axis, 20, degrees=True).as_matrix()
    CHECKS[kind](turned(models[MODELS[kind]], inclined))


def test_in_memory_models_pass_the_same_checks(models):
    with pytest.raises(DataError, match="direction of the face"):
        ef.simulate({"ZYG_L": 0.1}, turned(models["face"], TURNS["LPS"]), duration=0.02)
    with pytest.raises(DataError, match="direction of the jaw"):
        ef.treat(turned(models["jaw"], TURNS["LPS"]), {"step": []})
    with pytest.raises(DataError, match="direction of the face"):
        build_head(("face",), models={"face": turned(models["face"], TURNS["LPS"])})
