"""Generated tongue and palate of a person, in the frame of the generated face and jaw."""

from emgface.anatomy.tongue.template.build import template_palate, template_tongue

__all__ = ["template_palate", "template_tongue"]
