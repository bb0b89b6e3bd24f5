"""Face model: geometry, muscles and markers as one labelled dataset.

The package can be called to generate or read a face (`emgface.api.face`).
"""

from emgface._callable import make_callable
from emgface.api import face

make_callable(__name__, face)
del face
