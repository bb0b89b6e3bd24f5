"""Modules that compute a simulated motion, for all stages that store one."""

from typing import Final

MECHANICS: Final = ("sim", "emgface.face.motion")
"""The mechanics, and the motion of a face."""
HEAD_MECHANICS: Final = (*MECHANICS, "emgface.anatomy.head.recorded")
"""The same for heads, whose levels are computed from the channels of the jaw."""
