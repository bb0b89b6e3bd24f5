"""Typed errors of emgface.

Each message is one sentence: what was found, what was expected, what to try.
"""

from collections.abc import Iterable
from typing import Literal


def listed(names: Iterable[object], most: int = 6) -> str:
    """Return names as a readable list, shortened after `most`."""
    names = [str(n) for n in names]
    shown = ", ".join(names[:most])
    return shown if len(names) <= most else f"{shown} and {len(names) - most} more"


class EmgfaceError(Exception):
    """Base class of the errors of emgface."""


class DataError(EmgfaceError, ValueError):
    """A recording, face model or stored result cannot be used as it is."""


class RecordingChanged(DataError):
    """A recording that was identified can no longer be read, or has other content."""


class SchemaError(DataError):
    """Names, dims or ranges of a dataset differ from its declared schema."""


class UnitsError(DataError):
    """A variable has no unit, or not the declared one."""


class SignalError(DataError):
    """A signal cannot be processed: gap, constant, too short, rate too low."""


class MarkerError(DataError):
    """Markers are absent or have gaps that cannot be interpolated."""


class FaceError(DataError):
    """A face model is invalid, for example an inverted element or a muscle without element."""


Refused = Literal[
    "too wide", "at the commissure", "tumour", "surface", "off the skin", "off the lip", "bone",
    "too small", "degenerate", "not layered", "folds", "invalid", "strength", "stiffness",
    "other model", "repeated",
]  # fmt: skip
"""Reasons why a treatment is refused."""


class TreatmentError(FaceError):
    """A step of a plan of treatment cannot be applied to a face, for a reason that programs can read.

    Attributes
    ----------
    reason : str
        One of `Refused`: the gap is "too wide" to close; the excision is "at the commissure", where
        no direct closure exists; the "tumour" is elsewhere; the file of its "surface" cannot be used;
        the excision is "off the skin" or "off the lip", at "bone", or "too small" for the mesh; the
        elements at the cut would be "degenerate"; the face is "not layered" there, as at an earlier
        suture; the closure "folds" elements, or the result is otherwise "invalid"; the "strength" of a
        muscle or the "stiffness" of tissue is out of range; the step belongs to an "other model"; or the
        face already carries the plan, which would be "repeated".
    """

    def __init__(self, reason: Refused, text: str) -> None:
        self.reason: Refused = reason
        super().__init__(text)

    def __reduce__(self) -> tuple[type["TreatmentError"], tuple[Refused, str]]:  # noqa: D105
        return type(self), (self.reason, str(self))


class JawError(DataError):
    """A jaw model, excitation or task is unusable: file absent, unknown muscle or exciter."""


class TongueError(DataError):
    """A tongue model or excitation is unusable: file absent, unknown muscle, body or exciter."""


class HeadError(DataError):
    """A head is unusable: unknown part or contact pair, or a part that one needs is absent."""


class FitError(DataError):
    """A face cannot be fitted: unusable landmarks or surfaces, or no admissible result."""


class ActivationError(DataError):
    """An activation is outside 0-1 or not finite."""


class ConfigurationError(EmgfaceError, ValueError):
    """A study file contains an unknown parameter or a value out of range."""


class StoreError(EmgfaceError):
    """Results cannot be written, or their parameters cannot be expressed as JSON."""


class ExecutionError(EmgfaceError):
    """Jobs cannot be executed: no scheduler, workers of other code, or no common file system."""


class WorkerDied(ExecutionError):
    """A process that executed a job was killed or ran out of memory."""


class JournalWarning(UserWarning):
    """The journal of a study has damaged lines, which are ignored."""


class MotionWarning(UserWarning):
    """A simulated motion is inaccurate, depends on rounding, or its reduction is not trusted."""


class FitWarning(UserWarning):
    """Landmarks were ignored, or are too few or of a doubtful size."""


class TreatmentWarning(UserWarning):
    """A length of a plan may be in another unit, or a step of a treatment is doubtful."""


class FeatureWarning(UserWarning):
    """A feature is zero, saturated, or of a narrowed pass-band, or a series begins late."""
