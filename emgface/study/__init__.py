"""Studies: run table, stored stages and retry policy, from recordings to the scored cube.

The package can be called to run a study (`emgface.api.study`).
"""

from emgface._callable import make_callable
from emgface.api import study

make_callable(__name__, study)
del study
