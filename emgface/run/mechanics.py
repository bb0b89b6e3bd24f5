"""Modules whose source determines a simulated motion, for all stages that store one."""

from typing import Final

MECHANICS: Final = (
    "sim",
    "emgface.files",
    "emgface.schema.demands",
    "emgface.schema.rules",
    "emgface.schema.declaration",
    "emgface.face.bundles",
    "emgface.face.check",
    "emgface.face.closed",
    "emgface.face.contact",
    "emgface.face.control",
    "emgface.face.event_error",
    "emgface.face.integration",
    "emgface.face.lip_shape",
    "emgface.face.lips",
    "emgface.face.parts",
    "emgface.face.identity",
    "emgface.face.motion",
    "emgface.face.mouth",
    "emgface.face.muscle_force",
    "emgface.face.numerical_error",
    "emgface.face.quality",
    "emgface.face.recipe",
    "emgface.face.stability",
    "emgface.face.support",
    "emgface.face.surface",
    "emgface.face.tension_lines",
    "emgface.face.tissue",
    "emgface.face.treated",
    "emgface.face.waypoints",
    "emgface.reduced.model",
    "emgface.reduced.motion",
    "emgface.reduced.trained",
    "emgface.schema.clocks",
    "emgface.schema.hdf5",
    "emgface.schema.migration",
    "emgface.schema.netcdf",
    "emgface.schema.validation",
    "emgface.run.digest",
)
"""Modules of the mechanics and of the scene, and their imports."""
OF_HEADS: Final = (*MECHANICS, "emgface.anatomy", "emgface.signals")
"""The same for heads, whose levels are computed from the channels of the jaw."""
