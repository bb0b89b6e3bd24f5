"""Face of a person: landmarks and surfaces fitted by the mechanics of the package.

The package can be called to fit a face (`emgface.api.fit`).
"""

from emgface._callable import make_callable
from emgface.api import fit

make_callable(__name__, fit)
del fit
