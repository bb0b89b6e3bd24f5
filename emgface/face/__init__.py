"""Face model: geometry, muscles and markers as one labelled dataset.

Called, the package generates or reads a face: `emgface.api.face`.
"""

from emgface._callable import make_callable
from emgface.api import face

make_callable(__name__, face)
del face
