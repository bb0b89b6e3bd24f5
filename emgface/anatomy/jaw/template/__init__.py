"""Generated jaw, hyoid and larynx of a person, in the frame of the generated face."""

from emgface.anatomy.jaw.template.build import template_jaw
from emgface.anatomy.jaw.template.measures import JAW_NORMS, JawMeasures

__all__ = ["JAW_NORMS", "JawMeasures", "template_jaw"]
