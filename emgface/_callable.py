"""Packages that can be called: ``ef.face`` and ``ef.study`` are both subpackages and functions.

Importing a submodule binds its package's name in the parent, so that ``import emgface.face.motion``
would replace a function of the same name. The package itself is therefore callable.
"""

import sys
from collections.abc import Callable
from importlib import import_module
from inspect import cleandoc
from types import ModuleType
from typing import Any


def make_callable(package: str, function: Callable[..., Any]) -> None:
    """Make an imported package callable as a function."""

    class Callables(ModuleType):
        def __call__(self, *args: Any, **choices: Any) -> Any:
            return function(*args, **choices)

        def __reduce__(self) -> Any:  # so that a function can be sent to another process
            return import_module, (package,)

        @property
        def __signature__(self) -> Any:
            import inspect

            return inspect.signature(function)

    Callables.__call__.__doc__ = function.__doc__
    Callables.__module__ = function.__module__
    module = sys.modules[package]
    # help of the name that users call; the first line of the package stays at its end
    own, of_package = cleandoc(function.__doc__ or ""), cleandoc(module.__doc__ or "")
    module.__doc__ = f"{own}\n\n{package}: {of_package}"
    sys.modules[package].__class__ = Callables
