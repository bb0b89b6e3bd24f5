"""Public module: imported packages, names, and their collisions."""

import importlib
import inspect
import json
import subprocess
import sys
from importlib.resources import files

import pytest

import emgface as ef

CODE = """
import json, sys
before = set(sys.modules)
import emgface
after = set(sys.modules) - before
emgface.face, emgface.read
named = dir(emgface)
import xarray
import emgface.face.accuracy as accuracy
has = [hasattr(kind, "emg") for kind in (xarray.DataArray, xarray.Dataset)]
light = "emgface.signals.accessor" not in sys.modules
print(json.dumps([sorted(after), named, has, light, accuracy.__name__, callable(emgface.face)]))
"""


@pytest.fixture(scope="module")
def fresh():
    done = subprocess.run([sys.executable, "-c", CODE], capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


def test_import_loads_only_the_standard_library(fresh):
    brought = fresh[0]
    assert len(brought) < 40
    foreign = {name.split(".")[0] for name in brought} - set(sys.stdlib_module_names)
    assert foreign == {"emgface"}


def test_accessor_is_there_once_xarray_is_imported_after_the_package(fresh):
    assert fresh[2] == [True, True]
    assert fresh[3], "its module is imported at the first use"


def test_completion_lists_the_public_names(fresh):
    assert set(fresh[1]) == {*ef.__all__, "__version__"}
    assert all(callable(getattr(ef, name)) for name in ef.__all__)


def test_a_function_and_a_package_share_a_name(fresh):
    assert fresh[4:] == ["emgface.face.accuracy", True]
    assert "resolution" in inspect.signature(ef.face).parameters
    assert "workers" in inspect.signature(ef.study).parameters
    from emgface.face.file import load_face  # still a package

    assert callable(load_face)


def test_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'fase'"):
        ef.fase  # noqa: B018


@pytest.mark.parametrize("name", ef.__all__)
def test_functions_document_arguments_result_errors_and_an_example(name):
    doc = inspect.getdoc(getattr(ef.api, name)) or ""
    for section in ("Parameters", "Returns", "Raises", "Examples"):
        assert f"{section}\n---" in doc, section
    parameters = doc[doc.index("Parameters\n---") : doc.index("Returns\n---")]
    for argument in inspect.signature(getattr(ef.api, name)).parameters:
        assert argument in parameters, argument


@pytest.mark.parametrize("package", ["emgface", "sim", "analysis"])
def test_packages_are_marked_as_typed(package):
    assert (files(package) / "py.typed").is_file()


@pytest.mark.parametrize("package", ["sim", "analysis", "analysis.figures"])
def test_public_names_are_there_and_documented(package):
    module = importlib.import_module(package)
    assert len(set(module.__all__)) == len(module.__all__)
    for name in module.__all__:
        value = getattr(module, name)
        assert not inspect.ismodule(value), f"{name} is a module"
        assert inspect.getdoc(value), name
