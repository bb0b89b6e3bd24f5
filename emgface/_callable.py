"""Packages that can be called: ``ef.face`` and ``ef.study`` are subpackages and functions at once.

Importing a submodule binds its package's name in the parent, so that a function of the same name
would disappear with the first ``import emgface.face.motion``. The package therefore is the function.
"""

import sys
from collections.abc import Callable
from types import ModuleType
from typing import Any


def make_callable(package: str, function: Callable[..., Any]) -> None:
    """Let a package be called as a function.

    Parameters
    ----------
    package : str
        Name of an imported package.
    function : callable
        Called with the arguments that the package is called with.
    """

    class Callables(ModuleType):
        def __call__(self, *args: Any, **choices: Any) -> Any:
            return function(*args, **choices)

        @property
        def __signature__(self) -> Any:
            import inspect

            return inspect.signature(function)

    Callables.__call__.__doc__ = function.__doc__
    Callables.__module__ = function.__module__
    sys.modules[package].__class__ = Callables
