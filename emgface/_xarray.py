"""Registration of the accessor ``semg`` of xarray objects without importing xarray.

Importing xarray takes longer than all other imports of ``import emgface``. If xarray has not been
imported, the accessor is registered when it is.
"""

import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

_FORMER = ("emg", "bandpass", "wamp", "rms", "mav", "envelope", "muscles", "normalise")
"""Names that arrays have for one release: the former accessor, and its steps on ``recording.emg``."""


def register_accessor() -> None:
    """Register the accessor, immediately or when xarray is imported."""
    if "xarray" in sys.modules:
        _register()
    else:
        sys.meta_path.insert(0, _Waiting())


def _register() -> None:
    import xarray

    for register, kind in (
        (xarray.register_dataarray_accessor, xarray.DataArray),
        (xarray.register_dataset_accessor, xarray.Dataset),
    ):
        if not hasattr(kind, "semg"):
            register("semg")(_steps)
    if not hasattr(xarray.Dataset, "emg"):
        xarray.Dataset.emg = _Variable()  # pyright: ignore[reportAttributeAccessIssue]
        for name in _FORMER:
            xarray.register_dataarray_accessor(name)(_former(name))


def _steps(signal: Any) -> Any:
    """Return the accessor of one object; its module is imported at the first use."""
    from emgface.signals.accessor import Steps

    return Steps(signal)


def _former(name: str) -> Any:
    """Return a function that returns a former name of an array, with a warning."""

    def get(array: Any) -> Any:
        from emgface.signals.deprecated import former

        return former(array, name)

    return get


class _Variable:
    """The variable ``emg`` of a Dataset."""

    def __get__(self, recording: Any, kind: type | None = None) -> Any:
        """Return the variable; AttributeError leaves the message to xarray."""
        if recording is None:
            return self
        if "emg" not in recording.variables:
            raise AttributeError("emg")
        from emgface.signals.accessor import variable_of

        return variable_of(recording)


class _Waiting:
    """Import finder that registers the accessor after the import of xarray."""

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Find xarray once; leave all other names to the other finders."""
        if name != "xarray":
            return None
        from importlib.util import find_spec

        sys.meta_path.remove(self)
        spec = find_spec(name)
        if spec is None or spec.loader is None:
            return spec
        execute = spec.loader.exec_module

        def exec_module(module: ModuleType) -> None:
            execute(module)
            _register()

        spec.loader.exec_module = exec_module
        return spec
