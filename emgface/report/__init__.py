"""Report of a study as one offline page with the moving face.

The package can be called to write it (`emgface.api.report`).
"""

from emgface._callable import make_callable
from emgface.api import report

make_callable(__name__, report)
del report
